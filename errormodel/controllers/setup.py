"""Description of a machine for controllers: axes with letters, travels, grids; mm and degrees."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.axes import in_order
from errormodel.controllers.grids import anchored_grid, even_grid, turn_grid
from errormodel.exceptions import InputError, nearest
from errormodel.machine import Vector

FULL_TURN = 360.0  # deg
MOST_TURN_POINTS = 361  # positions of a full turn where a format would take more; by judgement
MOST_LATTICE_NODES = 100_000  # nodes of a lattice over all axes, a bound on size and time; by judgement


@dataclass(frozen=True)
class Axis:
    """An axis of the controller.

    Attributes
    ----------
    name : its letter on the controller; `joint` : its name in ``machine.yaml``.
    travel, measured : ends of the travel, and of its surveyed part (mm or deg).
    along : direction of the joint at the machine's zero (unit vector in the reference's axes).
    intervals : number of equal intervals in which linear interpolation represents the errors along it.
    centre : origin of its errors (of a rotary one: its centre) from the tool's tip, all axes at zero (mm, in the
        reference's axes).
    """

    name: str
    joint: str
    rotary: bool
    travel: tuple[float, float]
    measured: tuple[float, float]
    along: Vector = (1.0, 0.0, 0.0)
    intervals: int = 16
    centre: Vector = (0.0, 0.0, 0.0)

    @property
    def turns(self) -> bool:
        """Whether it goes round: its measured part is a full turn, of which both ends are the same place."""
        return self.rotary and abs(self.measured[1] - self.measured[0] - FULL_TURN) < 1e-6


@dataclass(frozen=True)
class Reversal:
    """Reversal value of an axis (ISO 230-2): mean position approached in plus direction less that in minus direction.

    Negative values are ordinary backlash: the axis lags behind its direction of travel.

    Attributes
    ----------
    low, high : values at the two ends of the travel (mm or deg); equal if it is constant along the travel.
    """

    low: float
    high: float

    @property
    def mean(self) -> float:
        """Single value for the whole travel."""
        return (self.low + self.high) / 2


@dataclass(frozen=True)
class Setup:
    """The machine as described to a controller.

    Attributes
    ----------
    axes : in the order of the kinematic chain, from the workpiece.
    movers : names of the axes that carry out corrections, one per direction of space.
    reversing : axes whose errors depend on the direction of approach.
    resolution : least increment of the controller (mm, deg), None: the format's usual one.
    probe : x and y of a probe from the nozzle (mm), None: there is none, or it is not known.
    points : points per axis requested by the user, None: as many as the errors need.
    levers : motion of the tool tip, (n, 3, 6 axes), in mm per unit (mm, rad) of the six error motions of each axis, at
        positions (n, axes); and the tip's motion (n, 3, axes) per mm or deg of each axis.
    read : measured error motions by axis, in a survey of single-joint error motions; None: positions were measured.
    numbers : numbers of axes given by the user, by name; empty: those that follow from the letters.
    unsure : joints whose letter is ambiguous and was not given.
    reversals : fitted reversal values, by axis.
    inverted : whether the files get the other sign, because the check of the control showed it.
    follow : whether corrections may follow the length of the tool; no: the survey does not show how.
    aligned : whether nothing is aligned again once the tables act: the frame of the errors then does not turn.
    most_tables : number of tables that may be used at most; None: as many as the format takes.
    x_stated : how the control counts X (`errormodel.controllers.turning`), as the user says; empty: not said.
    conditions : channels that the corrections do not follow (load, temperatures), each with its value in words.
    """

    machine: str
    axes: tuple[Axis, ...]
    movers: tuple[str, ...]
    reversing: frozenset[str] = frozenset()
    tool: Vector = (0.0, 0.0, 0.0)
    resolution: float | None = None
    points: int | None = None
    levers: Callable[[Array], tuple[Array, Array]] | None = None
    probe: tuple[float, float] | None = None
    read: Mapping[str, Collection[str]] | None = None
    numbers: Mapping[str, int] = field(default_factory=dict)
    unsure: tuple[str, ...] = ()
    reversals: Mapping[str, Reversal] = field(default_factory=dict)
    inverted: bool = False
    follow: bool = True
    aligned: bool = False
    most_tables: int | None = None
    x_stated: str = ""
    conditions: Mapping[str, str] = field(default_factory=dict)

    def place(self, name: str) -> int:
        """Column of an axis in positions (n, axes)."""
        for k, axis in enumerate(self.axes):
            if axis.name == name:
                return k
        raise InputError(f"axis {name}", "the machine has no such axis", nearest(name, [a.name for a in self.axes]))

    def axis(self, name: str) -> Axis:
        return self.axes[self.place(name)]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(a.name for a in self.axes)

    @property
    def ordered(self) -> tuple[Axis, ...]:
        """Axes in the order X Y Z A B C U V W, or in that of the user's numbers."""
        names = sorted(self.numbers, key=lambda n: self.numbers[n]) if self.numbers else in_order(self.names)
        return tuple(map(self.axis, names))

    def number(self, name: str, first: int) -> int:
        """Number of an axis on a controller that counts from `first`: the user's, else by letter."""
        return self.numbers[name] if self.numbers else in_order(self.names).index(name) + first

    def numbered(self, number: int, first: int) -> str:
        """Axis of a number.

        Raises
        ------
        InputError
            There is none.
        """
        for name in self.names:
            if self.number(name, first) == number:
                return name
        raise InputError(f"axis {number}", "the machine has no axis of that number", "Give the file that was written")

    @property
    def moving(self) -> tuple[str, ...]:
        """Axes whose travel the survey covered; nothing is known of the others."""
        return tuple(a.name for a in self.axes if a.measured[1] > a.measured[0])

    @property
    def linear(self) -> tuple[str, ...]:
        """Linear axes that carry out corrections."""
        return tuple(m for m in self.movers if not self.axis(m).rotary)

    @property
    def along_tool(self) -> Vector:
        """Direction in which a longer tool's tip lies, a unit vector in the last frame; zero if nothing follows it."""
        length = float(np.linalg.norm(self.tool)) if self.follow else 0.0
        x, y, z = (float(v) / length if length else 0.0 for v in self.tool)
        return x, y, z

    @property
    def watched(self) -> tuple[str, ...]:
        """The linear axes that carry out corrections, in the controller's order."""
        return tuple(a.name for a in self.ordered if a.name in self.linear)

    def grid(self, name: str, most: int, anchored: bool = False, every: bool = False) -> tuple[float, ...]:
        """Equidistant positions over the measured range of an axis: as many as its errors need, at most `most`.

        `anchored` positions are integer multiples of their step, so that the reference point 0 is one of them; with
        `every` there are as many as permitted.
        """
        axis, make = self.axis(name), anchored_grid if anchored else even_grid
        if axis.turns and (self.points is None or self.points <= most):
            least = axis.intervals if self.points is None else self.points - 1
            grid = _turn(axis, most, anchored=anchored) if every else _turn(axis, min(least, most - 1), most, anchored)
            if grid:
                return grid
        if self.points is None:
            wanted = most - 1 if every else axis.intervals * (2 if anchored else 1)
            return make(*axis.measured, max(1, min(wanted, most - 1)))
        if not 2 <= self.points <= most:
            found = f"{self.points} points, and the format holds 2 to {most} an axis"
            raise InputError(f"--points, axis {name}", found, f"Ask for 2 to {most} points")
        return make(*axis.measured, self.points - 1)

    def lattice(self, names: Sequence[str], most: int, nodes: int) -> tuple[tuple[float, ...], ...]:
        """Grids of several axes with at most `nodes` nodes together, coarsened by a common factor; bends are kept.

        Raises
        ------
        InputError
            The requested points make more nodes than `MOST_LATTICE_NODES`.
        """
        grids = tuple(self.grid(name, most) for name in names)
        share = 1.0
        while self.points is None and math.prod(len(g) for g in grids) > nodes and share > 0.02:
            share *= 0.95
            grids = tuple(
                _turn(axis, count, most) if axis.turns else even_grid(*axis.measured, count)
                for axis in map(self.axis, names)
                for count in [max(min(2, axis.intervals), round(share * min(axis.intervals, most - 1)))]
            )
        count = math.prod(len(g) for g in grids)
        if self.points is not None and count > MOST_LATTICE_NODES:
            found = f"{self.points} points on {len(names)} axes are {count} nodes, more than {MOST_LATTICE_NODES}"
            raise InputError("--points", found, "Ask for fewer points")
        return grids


def _turn(axis: Axis, intervals: int, most: int = MOST_TURN_POINTS, anchored: bool = False) -> tuple[float, ...]:
    """Positions of an axis round a full turn, at most `most` of them; none where no `anchored` ones are that few."""
    grid = turn_grid(axis.measured[0], intervals, anchored)
    while len(grid) > most and intervals > 1:
        intervals -= 1
        grid = turn_grid(axis.measured[0], intervals, anchored)
    return grid if len(grid) <= most or not anchored else ()
