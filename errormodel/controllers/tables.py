"""Correction tables over positions of axes: their structure, values, interpolation, and the requirements of formats.

Positions in mm and deg; values in mm, deg, or the unit of an error parameter (mm, rad).
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.controllers.grids import corners, sparse
from errormodel.controllers.setup import FULL_TURN, Setup
from errormodel.exceptions import InputError

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


LONGER = "tool"  # factor of a table per mm by which a tool is longer than that of the other tables


@dataclass(frozen=True)
class Term:
    """Structure of one table: the axes that it is a function of, and the axis that it corrects.

    Attributes
    ----------
    output : the axis that it corrects, or an error parameter such as EXX.
    inputs, grids : axes that it is a function of, and its positions along each; empty: a single number.
    factor : axis whose position multiplies the value; ``sin`` or ``cos`` before it: that function of a rotary axis;
        `LONGER`: the length by which the tool exceeds that of the other tables, mm.
    direction : direction of travel of the first input that it applies to, +1 or -1; 0: both.
    zero : whether it must be zero at the reference point, where its inputs are (closest to) zero.
    """

    output: str
    inputs: tuple[str, ...]
    grids: tuple[tuple[float, ...], ...]
    factor: str = ""
    direction: int = 0
    zero: bool = False

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(len(g) for g in self.grids)

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    def nodes(self, setup: Setup, q: Array, direction: Array, longer: Array | None = None) -> tuple[Index, Array]:
        """Values (n, k), by number, that act at positions (n, axes) reached in directions (n, axes), and their weights.

        `longer` (n,): mm by which the tools are longer than that of the tables; None: they are that one.
        """
        places = q[:, [setup.place(i) for i in self.inputs]]
        for k, axis in enumerate(map(setup.axis, self.inputs)):
            if axis.turns:  # a turn further is the same place
                places[:, k] = axis.measured[0] + np.mod(places[:, k] - axis.measured[0], FULL_TURN)
        column, weight = corners(self.grids, places)
        if self.factor == LONGER:
            scale = np.zeros(len(q)) if longer is None else longer
        else:
            scale = factor(setup, self.factor, q)
        if self.direction:
            scale = scale * (np.sign(direction[:, setup.place(self.inputs[0])]) == self.direction)
        return column, weight * scale[:, None]

    def weights(self, setup: Setup, q: Array, direction: Array, longer: Array | None = None) -> csr_matrix:
        """Weights (n, size) of all values; parameters as those of :meth:`nodes`."""
        return sparse(*self.nodes(setup, q, direction, longer), self.size)


def factor(setup: Setup, name: str, q: Array) -> Array:
    """Multiplier (n,) of a table's value: 1, an axis in m, or the sine or 1 - cosine of a rotary axis."""
    if not name:
        return np.ones(len(q))
    kind, _, axis = name.rpartition(" ")
    position = q[:, setup.place(axis)]
    if not kind:
        return position / 1000.0
    return np.sin(np.radians(position)) if kind == "sin" else 1.0 - np.cos(np.radians(position))


@dataclass(frozen=True)
class Table:
    """A term with its values, of the term's shape, in mm, deg, or the unit of an error parameter (mm, rad)."""

    term: Term
    values: Array

    def at(self, setup: Setup, q: Array, direction: Array, longer: Array | None = None) -> Array:
        """Corrections (n,) at positions (n, axes) with tools longer by `longer` (n,), mm."""
        node, weight = self.term.nodes(setup, q, direction, longer)
        return np.asarray(np.einsum("nk,nk->n", weight, self.values.ravel()[node]))


Tables = tuple[Table, ...]


def even_step(term: Term, axis: int = 0, name: str = "") -> float:
    """Step of an equidistant grid.

    Raises
    ------
    InputError
        The positions do not increase, or their steps differ.
    """
    where, g = f"table {name or term.output}", np.asarray(term.grids[axis])
    check_increasing(term, axis, name)
    steps = np.diff(g)
    if len(g) < 2 or np.abs(steps - steps[0]).max() > 1e-6 * max(abs(steps[0]), 1e-6):
        found = f"positions {g[0]:g} to {g[-1]:g} of {term.inputs[axis]} that no step divides evenly"
        raise InputError(where, found, "Give equidistant positions")
    return float(round((g[-1] - g[0]) / (len(g) - 1), 9))


def check_increasing(term: Term, axis: int = 0, name: str = "") -> None:
    """Raise InputError unless positions strictly increase."""
    g = np.asarray(term.grids[axis])
    bad = np.flatnonzero(np.diff(g) <= 0)
    if len(bad):
        found = f"positions do not increase: {g[bad[0]]:g}, then {g[bad[0] + 1]:g}"
        raise InputError(f"table {name or term.output}", found, "Give positions in increasing order, each once")


def check_points(term: Term, most: int, axis: int = 0) -> None:
    """Raise InputError if there are more points than the format holds."""
    count = len(term.grids[axis])
    if count > most:
        raise InputError(
            f"table {term.output} over {term.inputs[axis]}",
            f"{count} points, of which the format holds {most}",
            "Give fewer: --points sets how many",
        )


# comment that states a constant
ZERO_SHIFT_LINE = re.compile(r"^\W*zero shift of (\w+): ([-+.\d]+)", re.MULTILINE | re.IGNORECASE)


def shift_terms(terms: Sequence[Term]) -> list[Term]:
    """A constant for every axis whose tables must be zero at the reference point: a shift of its zero."""
    return [Term(m, (), ()) for m in dict.fromkeys(t.output for t in terms if t.zero)]


def shift_lines(tables: Tables) -> list[str]:
    """Comment lines with the constants that tables which are zero at the reference point cannot represent."""
    return [f"zero shift of {t.term.output}: {float(t.values):.6f} mm" for t in tables if not t.term.inputs]


def shifts_of(text: str) -> Tables:
    """Constants stated in the comments of a file."""
    return tuple(Table(Term(name, (), ()), np.array(float(value))) for name, value in ZERO_SHIFT_LINE.findall(text))


def merged(tables: Tables) -> dict[tuple[str, tuple[str, ...], str], dict[int, Table]]:
    """Tables that differ in direction only, side by side."""
    out: dict[tuple[str, tuple[str, ...], str], dict[int, Table]] = {}
    for t in tables:
        out.setdefault((t.term.output, t.term.inputs, t.term.factor), {})[t.term.direction] = t
    return out


def split(output: str, name: str, grid: tuple[float, ...], plus: Array, minus: Array) -> list[Table]:
    """One table for both directions where they agree, else one for each."""
    term = Term(output, (name,), (grid,))
    if np.array_equal(plus, minus):
        return [Table(term, plus)]
    return [Table(replace(term, direction=s), v) for s, v in ((1, plus), (-1, minus))]
