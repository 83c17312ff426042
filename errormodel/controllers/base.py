"""What a controller is: what its tables can express, how they are written and read, and what it makes of them.

Positions are in the units of controllers: mm for linear axes, degrees for rotary ones. Tables of axes hold
*corrections*, what is added to a commanded position, whatever sign the file itself wants; tables of error parameters
(ISO 230-1) hold errors, actual minus nominal.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.klipper_probe import Gap, Probing
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Tables, Term
from errormodel.controllers.text import Files
from errormodel.controllers.thermal import States, Thermal
from errormodel.exceptions import InputError
from errormodel.gcode.divide import Correct
from errormodel.gcode.programme import Corrected
from errormodel.gcode.reading import Reading


class Target(ABC):
    """What a compensation is made for. A new one is one class in one file of this package; it is found by itself."""

    name: ClassVar[str]  # the word of --controller
    title: ClassVar[str]
    source: ClassVar[str]  # where grammar and sign come from
    doubt: ClassVar[str] = ""  # what no public source says; empty: nothing

    @abstractmethod
    def checklist(self, setup: Setup) -> list[str]:
        """What to do at the machine, in order."""


class Rewriter(Target):
    """A target without tables: the commands themselves are corrected."""

    @abstractmethod
    def positions(self, name: str, text: str, setup: Setup, reading: Reading | None = None) -> Array:
        """Positions (n, axes) that a program commands, in order.

        Raises
        ------
        InputError
            The program has what cannot be corrected line by line.
        """

    @abstractmethod
    def rewrite(
        self, name: str, text: str, setup: Setup, correct: Correct, reading: Reading | None = None
    ) -> Corrected:
        """The same program with corrected commands, and what a check of it found.

        Raises
        ------
        InputError
            The program has what is not understood, not known or out of reach.
        """

    @abstractmethod
    def quantum(self, setup: Setup) -> float:
        """Half a step of the figures that are written (mm, deg)."""


class Controller(Target):
    """A target with tables."""

    most_tables: ClassVar[int | None] = None
    bidirectional: ClassVar[bool] = False  # has tables for each direction
    linear_only: ClassVar[bool] = True  # corrects linear axes only
    most_points: ClassVar[int] = 10_000  # an axis

    @abstractmethod
    def terms(self, setup: Setup) -> list[Term]:
        """The structure: everything that the tables can express on this machine."""

    @abstractmethod
    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        """Files by name.

        Raises
        ------
        InputError
            The format cannot hold the tables.
        """

    @abstractmethod
    def read(self, files: Files, setup: Setup) -> Tables:
        """The tables that files hold.

        Raises
        ------
        InputError
            A file is not of the format.
        """

    def structures(self, setup: Setup) -> list[list[Term]]:
        """Structures to try, the plainest first: one that leaves next to nothing is taken."""
        return [self.terms(setup)]

    def thermal(self, states: States, setup: Setup) -> Thermal | None:
        """The controller's own temperature compensation, from tables at several temperatures; None: it has none."""
        return None

    def probing(self, setup: Setup, gap: Gap) -> Probing:
        """What the controller adds to the readings of a probe at ``setup.probe``.

        Raises
        ------
        InputError
            It adds nothing.
        """
        found = f"{self.title} corrects no readings"
        raise InputError("--probe", found, "Leave it out, or use --controller klipper")

    def quantum(self, setup: Setup) -> float:
        """Largest change (mm, deg) of a correction by writing and reading back."""
        return 1e-6

    def most_slope(self, setup: Setup, term: Term) -> float | None:
        """Steepest change of a table that the format or sense allows (mm per mm or deg), None: no bound."""
        if term.output not in setup.movers:
            return None
        return 0.01 * (50.0 if any(setup.axis(i).rotary for i in term.inputs) else 1.0)

    def influence(self, setup: Setup, output: str, q: Array) -> Array:
        """What a unit of an output does to the commands of the movers, (n, movers) in mm or deg."""
        out = np.zeros((len(q), len(setup.movers)))
        out[:, setup.movers.index(output)] = 1.0
        return out

    def emulate(self, tables: Tables, setup: Setup, q: Array, direction: Array | None = None) -> Array:
        """Corrections (n, movers) at commands (n, axes), as the controller interpolates, and holds at the ends."""
        sign = np.ones_like(q) if direction is None else direction
        out = np.zeros((len(q), len(setup.movers)))
        for table in tables:
            out += table.at(setup, q, sign)[:, None] * self.influence(setup, table.term.output, q)
        return out

    def suits(self, setup: Setup) -> None:
        """Raise InputError where the machine is none for this controller."""
        if self.linear_only and not any(not setup.axis(m).rotary for m in setup.movers):
            raise InputError(
                f"--controller {self.name}",
                f"{setup.machine} moves by rotary joints only, and tables of this format correct linear axes",
                "Use --controller gcode, which corrects the commands themselves (or csv, if few axes moved)",
            )

    def directions(self, setup: Setup, name: str) -> tuple[int, ...]:
        """Directions for which an axis gets a table of its own."""
        return (1, -1) if self.bidirectional and name in setup.reversing else (0,)

    def curves(self, setup: Setup, pairs: Sequence[tuple[str, str]], zero: bool = False) -> list[Term]:
        """One-dimensional terms for (output, input) pairs."""
        return [
            Term(output, (name,), (setup.grid(name, self.most_points),), direction=sign, zero=zero)
            for output, name in pairs
            for sign in self.directions(setup, name)
        ]


def header(controller: Controller, setup: Setup) -> list[str]:
    """What every file that allows comments says at its top."""
    region = ", ".join(f"{a.name} {a.measured[0]:.1f} to {a.measured[1]:.1f}" for a in setup.axes)
    lines = [f"{setup.machine}: {controller.title}", f"measured region: {region}; edge values hold beyond it"]
    if controller.doubt:
        lines += [f"NOT CERTAIN: {controller.doubt}", "run sign_test.nc before these tables are used"]
    return lines
