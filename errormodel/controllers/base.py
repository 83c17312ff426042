"""Interface of controllers: what their tables can express, how files are written and read, how corrections are applied.

Positions are in the units of controllers: mm for linear axes, degrees for rotary ones. Tables of axes hold
*corrections*, which are added to a commanded position, whatever sign the file itself uses; tables of error parameters
(ISO 230-1) hold errors, actual minus nominal.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cache
from typing import ClassVar

import numpy as np

from errormodel.arrays import Array, Mask
from errormodel.controllers.dialect import Dialect
from errormodel.controllers.probing import Gap, Probing
from errormodel.controllers.rotary_lines import Line
from errormodel.controllers.setup import Axis, Setup
from errormodel.controllers.tables import Table, Tables, Term
from errormodel.controllers.text import Comment, Files, printable
from errormodel.controllers.thermal import States, Thermal
from errormodel.discovery import by_word, classes
from errormodel.exceptions import InputError, nearest
from errormodel.gcode.divide import Correct
from errormodel.gcode.programme import Corrected
from errormodel.gcode.reading import Reading

# characters of a machine's name in a comment, which leaves room for the rest of the line
MOST_MACHINE_NAME = 60
EDGE_HOLDS = "beyond it the correction of its edge is held"


class Target(ABC):
    """Target of a compensation. A new one is a class in a file of this package; the registry finds it."""

    name: ClassVar[str]  # word for --controller
    title: ClassVar[str]
    source: ClassVar[str]  # where grammar and sign come from
    needs: ClassVar[str] = "nothing but the control as it was during the survey"  # options, versions, access
    back: ClassVar[str] = "take the files out again, and restore what was backed up"  # how to undo it
    test: ClassVar[str] = ""  # how to test it at the machine; empty: with an indicator, by the check of signs
    doubt: ClassVar[str] = ""  # what no public source says; empty: nothing
    scale_setting: ClassVar[str] = ""  # where the scale of an axis is set, which no table of it holds; empty: not said
    general: ClassVar[bool] = False  # holds any error of any machine: messages name it where another cannot

    @abstractmethod
    def checklist(self, setup: Setup) -> list[str]:
        """Steps for the operator at the machine, in order."""

    def address(self, setup: Setup, name: str) -> str:
        """Name of an axis in the controller's files: its letter."""
        return name

    def legend(self, setup: Setup) -> str:
        """Joint of each axis of the controller, in the controller's order, in words."""

        def one(axis: Axis) -> str:
            address = self.address(setup, axis.name)
            number = f" = {address}" if address != axis.name else ""
            return f"{axis.name}{number}{f' (joint {axis.joint})' if axis.joint != axis.name else ''}"

        return ", ".join(map(one, setup.ordered))

    def suits(self, setup: Setup) -> None:
        """Raise InputError if the machine does not suit this controller."""
        if setup.numbers:
            found = f"numbers, and {self.title} names axes by letters"
            raise InputError("--axes", found, "Leave --axes out, or give letters only, such as bridge=Y")


class Rewriter(Target):
    """A target without tables: the commands of a programme are corrected."""

    @abstractmethod
    def positions(self, name: str, text: str, setup: Setup, reading: Reading | None = None) -> Array:
        """Positions (n, axes), mm and deg, that a program commands, in order.

        Raises
        ------
        InputError
            The program has commands that cannot be corrected line by line.
        """

    @abstractmethod
    def rewrite(
        self, name: str, text: str, setup: Setup, correct: Correct, reading: Reading | None = None
    ) -> Corrected:
        """The same program with corrected commands, and the result of its check.

        Raises
        ------
        InputError
            A word is not understood, a position is unknown or out of reach.
        """

    @abstractmethod
    def quantum(self, setup: Setup) -> float:
        """Half a unit of the last written digit (mm, deg)."""


class Controller(Target):
    """A target with correction tables.

    Attributes
    ----------
    comment : comment syntax of its files; None: they have no comments.
    sign_known : whether a public source documents the sign of its tables.
    other_sign : instruction for the case that the check shows the other sign; required if `sign_known` is False.
    dialect : syntax of its programmes, for the check; None: not documented, the check is then described in words.
    backlash_parameter : name of the control's parameter, with the axis as ``{axis}`` or ``{number}``; empty: none.
    first_number : number of the first axis, if files name axes by numbers; `number_form`: how they are then written.
    most_tables : number of tables that the control holds; None: no bound.
    few_tables : tables that the smaller controls of this kind hold, where the user may bound them; None: all alike.
    """

    comment: ClassVar[Comment | None] = None
    sign_known: ClassVar[bool]
    other_sign: ClassVar[str] = ""
    dialect: ClassVar[Dialect | None] = None
    backlash_parameter: ClassVar[str] = ""
    backlash_beside: ClassVar[str] = "leave {} as it was during the survey"  # where tables hold the backlash
    first_number: ClassVar[int | None] = None
    number_form: ClassVar[str] = "{}"
    describes: ClassVar[bool] = True  # whether the control has a kinematic description of rotary axes
    describes_tilt: ClassVar[bool] = True  # whether its kinematic description takes a tilted rotary axis; else tables
    lettered: ClassVar[bool] = True  # whether files need the controller's own letters
    most_tables: ClassVar[int | None] = None
    few_tables: ClassVar[int | None] = None
    bidirectional: ClassVar[bool] = False  # whether there are tables for each direction of travel
    linear_only: ClassVar[bool] = True  # whether linear axes only are corrected
    follows_tool: ClassVar[bool] = False  # whether corrections follow the length of the tool
    most_points: ClassVar[int] = 10_000  # per axis
    beyond: ClassVar[str] = EDGE_HOLDS  # what the correction is outside the measured region

    @abstractmethod
    def terms(self, setup: Setup) -> list[Term]:
        """Structure: all tables that the format can express on this machine."""

    @abstractmethod
    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        """Write the tables: text of each file, by name.

        Raises
        ------
        InputError
            The format cannot hold the tables.
        """

    @abstractmethod
    def read(self, files: Files, setup: Setup) -> Tables:
        """Read the tables from files of this format.

        Raises
        ------
        InputError
            A file is not of the format.
        """

    def backlash_value(self, setup: Setup, axis: str, size: float) -> str:
        """Change of the control's backlash parameter, with its unit.

        Parameters
        ----------
        axis : letter of the axis.
        size : mm or deg; positive if the axis lags behind its direction of travel (ordinary backlash).
        """
        return f"{size:+.4f} {'deg' if setup.axis(axis).rotary else 'mm'}"

    def moved(self, output: str) -> str:
        """Axis that an output of a table moves directly; empty: the output acts through a lever."""
        return output

    def about(self, tables: Tables, setup: Setup) -> list[str]:
        """Checklist lines about these tables, such as how many the control must hold."""
        return []

    def describe(self, lines: Sequence[Line], setup: Setup) -> list[str]:
        """Steps that put rotary axes as they lie into the controller's kinematic description, with uncertainties."""
        return [
            "where the kinematic description of this control takes these values is not public, or not known here: "
            "give them to whoever maintains it"
        ]

    def used(self, terms: Sequence[Term]) -> int:
        """Number of the control's tables that terms need, where controls of one kind hold different numbers of them."""
        return sum(bool(t.inputs) for t in terms)

    def needed(self, tables: Tables) -> str:
        """How many tables the control must hold, and how many such controls have; only with `few_tables`."""
        return f"{self.used([t.term for t in tables])} tables are needed"

    def heed(self, tables: Tables) -> list[str]:
        """What comes first about these tables: that they are more than the smaller controls hold."""
        if self.few_tables is None or self.used([t.term for t in tables]) <= self.few_tables:
            return []
        return [f"{self.needed(tables)}. With fewer: --max-tables N takes those that gain most, and says what is left"]

    def own_check(self, setup: Setup, tables: Tables) -> dict[str, str] | None:
        """Files of a check other than that with an indicator, by name; None: the usual check."""
        return None

    def by_itself(self, tables: Tables, setup: Setup, q: Array) -> dict[str, float]:
        """Corrections (mm) by axis at a position (1, axes) if tables that only multiply others acted directly."""
        return {}

    def address(self, setup: Setup, name: str) -> str:
        if self.first_number is None:
            return name
        return self.number_form.format(setup.number(name, self.first_number))

    def number(self, setup: Setup, name: str) -> int:
        """Number of an axis in files of this controller."""
        return setup.number(name, self.first_number or 0)

    def numbered(self, setup: Setup, number: float) -> str:
        """Axis of a number in a file."""
        return setup.numbered(int(number), self.first_number or 0)

    def structures(self, setup: Setup) -> list[list[Term]]:
        """Structures to try, the plainest first; the search stops at one with a sufficiently small residual."""
        return [self.terms(setup)]

    def thermal(self, states: States, setup: Setup) -> Thermal | None:
        """The controller's own temperature compensation, from tables at several temperatures; None: it has none."""
        return None

    def probing(self, setup: Setup, gap: Gap) -> Probing:
        """Correction that the controller adds to the readings of a probe at ``setup.probe``.

        Raises
        ------
        InputError
            The controller does not correct readings.
        """
        able = [n for n, k in registry().items() if issubclass(k, Controller) and k.probing is not Controller.probing]
        cure = f"Leave it out, or use --controller {' or '.join(able)}"
        raise InputError("--probe", f"{self.title} corrects no readings", cure)

    def quantum(self, setup: Setup) -> float:
        """Largest change (mm, deg) of a correction by writing and reading back."""
        return 1e-6

    def most_slope(self, setup: Setup, term: Term) -> float | None:
        """Largest permitted slope of a table (mm per mm or deg); None: no bound."""
        if term.output not in setup.movers:
            return None
        return 0.01 * (50.0 if any(setup.axis(i).rotary for i in term.inputs) else 1.0)

    def influence(self, setup: Setup, output: str, q: Array) -> Array:
        """Effect of a unit of an output on the commands of the movers, (n, movers) in mm or deg."""
        out = np.zeros((len(q), len(setup.movers)))
        out[:, setup.movers.index(output)] = 1.0
        return out

    def emulate(
        self, tables: Tables, setup: Setup, q: Array, direction: Array | None = None, longer: Array | None = None
    ) -> Array:
        """Corrections (n, movers) in mm or deg at commands (n, axes), interpolated as the controller does.

        Parameters
        ----------
        direction : (n, axes) +-1, directions of approach; None: all positive.
        longer : (n,) mm by which tools are longer than that of the tables; None: they are that one.
        """
        sign = np.ones_like(q) if direction is None else direction
        out = np.zeros((len(q), len(setup.movers)))
        for table in tables:
            out += table.at(setup, q, sign, longer)[:, None] * self.influence(setup, table.term.output, q)
        return out

    def acts(self, tables: Tables, setup: Setup, q: Array) -> Mask:
        """Whether the control corrects at commands (n, axes) at all; where it does not, :meth:`emulate` gives zero."""
        return np.ones(len(q), dtype=bool)

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
        """Directions of travel for which an axis gets a table of its own."""
        return (1, -1) if self.bidirectional and name in setup.reversing else (0,)

    def curves(self, setup: Setup, pairs: Sequence[tuple[str, str]], zero: bool = False) -> list[Term]:
        """One-dimensional terms for (output, input) pairs."""
        return [
            Term(output, (name,), (setup.grid(name, self.most_points),), direction=sign, zero=zero)
            for output, name in pairs
            for sign in self.directions(setup, name)
        ]


def header(controller: Controller, setup: Setup, *more: str) -> list[str]:
    """Comment lines at the head of every file that allows comments, followed by the lines `more`."""
    region = ", ".join(f"{a.name} {a.measured[0]:.1f} to {a.measured[1]:.1f}" for a in setup.ordered)
    lines = [
        f"errormodel: {controller.title}",
        f"axes: {controller.legend(setup)}",
        f"measured region (mm, deg): {region}; {controller.beyond}",
    ]
    if setup.inverted:
        lines.append("SIGN TURNED ROUND (--invert)")
    if controller.doubt:
        lines += [f"NOT CERTAIN: {controller.doubt}", f"{SIGN_TEST_STEP} before these tables are used"]
    comment = controller.comment or Comment("")
    return [comment.line(f"machine: {printable(setup.machine)[:MOST_MACHINE_NAME]}"), *comment.lines([*lines, *more])]


SIGN_TEST_STEP = "follow sign_test/steps.txt"


def written(controller: Controller, tables: Tables, setup: Setup) -> dict[str, str]:
    """Files of tables, with the sign reversed if the user asks for it."""
    return controller.write(_turned(tables, setup), setup)


def read_back(controller: Controller, files: Files, setup: Setup) -> Tables:
    """Tables of files that :func:`written` made."""
    return _turned(controller.read(files, setup), setup)


def _turned(tables: Tables, setup: Setup) -> Tables:
    """Tables with the sign reversed if that is set; constants have no sign of a file and stay."""
    if not setup.inverted:
        return tables
    return tuple(Table(t.term, -t.values + 0.0) if t.term.inputs else t for t in tables)


@cache
def registry() -> Mapping[str, type[Target]]:
    """All controllers by name; a name that is registered twice raises an error."""
    found = by_word((kind.name, kind) for kind in classes("errormodel.controllers", Target))  # type: ignore[type-abstract]
    return dict(sorted(found.items()))


def instead(kind: type[Target] | None = None) -> str:
    """What to use where a controller cannot hold the errors of a machine: words of those that hold any, with "or".

    Parameters
    ----------
    kind : `Controller` or `Rewriter`, to have those only.
    """
    return " or ".join(n for n, k in registry().items() if k.general and (kind is None or issubclass(k, kind)))


def target(name: str) -> Target:
    """Controller of a given name.

    Raises
    ------
    InputError
        There is no such controller.
    """
    if name not in registry():
        titled = " or ".join(f"'{own}'" for own, kind in registry().items() if name.lower() in kind.title.lower())
        hint = f"Did you mean {titled}? Valid: {', '.join(registry())}" if titled else ""
        raise InputError(f"--controller {name}", "there is no such controller", hint or nearest(name, registry()))
    return registry()[name]()
