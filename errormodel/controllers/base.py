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
from errormodel.controllers import instead, registry
from errormodel.controllers.dialect import Dialect
from errormodel.controllers.probing import Gap, Probing
from errormodel.controllers.setup import Axis, Setup
from errormodel.controllers.tables import Table, Tables, Term
from errormodel.controllers.text import Comment, Files, printable
from errormodel.controllers.thermal import States, Thermal
from errormodel.exceptions import InputError
from errormodel.gcode.divide import Correct
from errormodel.gcode.programme import Corrected
from errormodel.gcode.reading import Reading

NAME = 60  # characters of a machine's name in a file


class Target(ABC):
    """What a compensation is made for. A new one is one class in one file of this package; it is found by itself."""

    name: ClassVar[str]  # the word of --controller
    title: ClassVar[str]
    source: ClassVar[str]  # where grammar and sign come from
    doubt: ClassVar[str] = ""  # what no public source says; empty: nothing
    general: ClassVar[bool] = False  # holds any error of any machine: messages name it where another cannot

    @abstractmethod
    def checklist(self, setup: Setup) -> list[str]:
        """What to do at the machine, in order."""

    def address(self, setup: Setup, name: str) -> str:
        """How the controller's files name an axis: by its letter."""
        return name

    def legend(self, setup: Setup) -> str:
        """Which axis of the controller each joint is taken for, in the controller's order."""

        def one(axis: Axis) -> str:
            address = self.address(setup, axis.name)
            number = f" = {address}" if address != axis.name else ""
            return f"{axis.name}{number}{f' (joint {axis.joint})' if axis.joint != axis.name else ''}"

        return ", ".join(map(one, setup.ordered))

    def suits(self, setup: Setup) -> None:
        """Raise InputError where the machine is none for this controller."""
        if setup.numbers:
            found = f"numbers, and {self.title} names axes by letters"
            raise InputError("--axes", found, "Leave --axes out, or give letters only, such as bridge=Y")


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
    """A target with tables.

    Attributes
    ----------
    comment : how its files mark comments; None: they have none.
    sign_known : whether a public source settles the sign of its tables.
    other_sign : what to do where the check shows the other sign; needed where `sign_known` is False.
    dialect : its language of programmes, for the check; None: no public source settles it, and words take its place.
    backlash_parameter : of the control, the axis' name in it as ``{axis}``, its number as ``{number}``; empty: none.
    first_number : of the first axis, where files name axes by numbers; `number_form`: how they are then written.
    """

    comment: ClassVar[Comment | None] = None
    sign_known: ClassVar[bool]
    other_sign: ClassVar[str] = ""
    dialect: ClassVar[Dialect | None] = None
    backlash_parameter: ClassVar[str] = ""
    backlash_beside: ClassVar[str] = "leave {} as it was during the survey"  # where tables hold the backlash
    first_number: ClassVar[int | None] = None
    number_form: ClassVar[str] = "{}"
    lettered: ClassVar[bool] = True  # needs the controller's own letters
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

    def backlash_value(self, setup: Setup, axis: str, size: float) -> str:
        """What the control's parameter gains, with its unit.

        Parameters
        ----------
        size : mm or deg; positive where the axis stays behind its direction of travel (ordinary backlash).
        """
        return f"{size:+.4f} {'deg' if setup.axis(axis).rotary else 'mm'}"

    def moved(self, output: str) -> str:
        """The axis that an output of a table moves directly; empty: it takes a lever."""
        return output

    def about(self, tables: Tables, setup: Setup) -> list[str]:
        """What the checklist says of the tables as they are, such as how many the control must hold."""
        return []

    def own_check(self, setup: Setup, tables: Tables) -> dict[str, str] | None:
        """Files of a check of another kind than the indicator's, by name; None: that one."""
        return None

    def by_itself(self, tables: Tables, setup: Setup, q: Array) -> dict[str, float]:
        """What tables that must not act by themselves would add to axes at a position (1, axes), if they did, mm."""
        return {}

    def address(self, setup: Setup, name: str) -> str:
        if self.first_number is None:
            return name
        return self.number_form.format(setup.number(name, self.first_number))

    def number(self, setup: Setup, name: str) -> int:
        """The number of an axis in files of this controller."""
        return setup.number(name, self.first_number or 0)

    def numbered(self, setup: Setup, number: float) -> str:
        """The axis of a number that a file has."""
        return setup.numbered(int(number), self.first_number or 0)

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
        able = [n for n, k in registry().items() if issubclass(k, Controller) and k.probing is not Controller.probing]
        cure = f"Leave it out, or use --controller {' or '.join(able)}"
        raise InputError("--probe", f"{self.title} corrects no readings", cure)

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
        if self.first_number is None:
            super().suits(setup)
        low = min(setup.numbers.values(), default=self.first_number or 0)
        if self.first_number is not None and low < self.first_number:
            found = f"the number {low}, and {self.title} counts axes from {self.first_number}"
            raise InputError("--axes", found, "Give the controller's own numbers")
        if self.linear_only and not any(not setup.axis(m).rotary for m in setup.movers):
            raise InputError(
                f"--controller {self.name}",
                f"{setup.machine} moves by rotary joints only, and tables of this format correct linear axes",
                f"Use --controller {instead(Rewriter)}, which corrects the commands themselves "
                f"(or {instead(Controller)}, if few axes moved)",
            )
        if self.lettered and setup.unsure:
            found = f"it cannot be known which axes of the controller the joints {', '.join(setup.unsure)} are"
            letters = ",".join(f"{a.joint}={a.name}" for a in setup.axes)
            raise InputError("--axes", found, f"Say it, in the form --axes {letters}")

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


def header(controller: Controller, setup: Setup, *more: str) -> list[str]:
    """What every file that allows comments says at its top, as comments; `more` lines after it."""
    region = ", ".join(f"{a.name} {a.measured[0]:.1f} to {a.measured[1]:.1f}" for a in setup.ordered)
    lines = [
        f"errormodel: {controller.title}",
        f"axes: {controller.legend(setup)}",
        f"measured region: {region}; edge values hold beyond it",
    ]
    if setup.inverted:
        lines.append("SIGN TURNED ROUND (--invert)")
    if controller.doubt:
        lines += [f"NOT CERTAIN: {controller.doubt}", f"{CHECK} before these tables are used"]
    comment = controller.comment or Comment("")
    return [comment.line(f"machine: {printable(setup.machine)[:NAME]}"), *comment.lines([*lines, *more])]


CHECK = "follow sign_test/steps.txt"


def written(controller: Controller, tables: Tables, setup: Setup) -> dict[str, str]:
    """The files of tables, with the other sign where the user asks for it."""
    return controller.write(_turned(tables, setup), setup)


def read_back(controller: Controller, files: Files, setup: Setup) -> Tables:
    """The tables of files that :func:`written` made."""
    return _turned(controller.read(files, setup), setup)


def _turned(tables: Tables, setup: Setup) -> Tables:
    """Tables with the other sign where that is wanted; constants are no part of a file's sign."""
    if not setup.inverted:
        return tables
    return tuple(Table(t.term, -t.values + 0.0) if t.term.inputs else t for t in tables)
