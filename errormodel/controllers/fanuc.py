"""FANUC: stored pitch error compensation, and three-dimensional error compensation on a lattice, as parameter files.

Pitch: integer detection units from one point to the next, seen from the minus end, rounded so that their sum stays
close to the wanted curve. The value at the reference point is zero. Lattice: a vector of integer units at every node
of a box, trilinear between the eight corners of a cell. The correction stays constant beyond the last point.

Source: B-63330EN (tape format), A-79351E (three-dimensional error compensation, p. 3), cnc.wiki on parameters
3620-3627.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers import instead
from errormodel.controllers.base import Controller, header
from errormodel.controllers.dialect import Dialect
from errormodel.controllers.grids import spaced
from errormodel.controllers.rotary_lines import Line, remark, uncertainties
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import (
    Table,
    Tables,
    Term,
    check_points,
    even_step,
    shift_lines,
    shift_terms,
    shifts_of,
)
from errormodel.controllers.text import Comment, Files, one_file
from errormodel.exceptions import InputError

PARAMETER_BLOCK = re.compile(r"^N(\d+)((?:A\d+P[-+.\d]+|P[-+.\d]+)+)\s*;?$", re.MULTILINE)
PARAMETER_WORD = re.compile(r"(?:A(\d+))?P([-+.\d]+)")
FIRST_PITCH_POINT = 10000  # number of pitch error point 0 in parameter files
LATTICE_PARAMETER = 10800  # first parameter of the lattice


def blocks(name: str, text: str) -> dict[int, dict[int, float]]:
    """Values by parameter number and axis (0 where a block names none)."""
    if text.count("%") < 2:
        raise InputError(name, "no % at both ends: the tape is not whole", "Copy the file again")
    out: dict[int, dict[int, float]] = {}
    for number, words in PARAMETER_BLOCK.findall(text):
        out.setdefault(int(number), {}).update({int(a or 0): float(v) for a, v in PARAMETER_WORD.findall(words)})
    return out


CAPITAL_COMMENT = Comment("(", ")", upper=True)


@dataclass(frozen=True)
class FanucDialect(Dialect):
    """Programme syntax with work coordinates equal to machine coordinates, since G53 is always a rapid on a FANUC.

    The operator sets G59 and the external offset to zero; macro lines stop the programme with an alarm before any
    motion if the position in work coordinates differs from that in machine coordinates.
    """

    def prepare(self, numbers: Mapping[str, int]) -> list[str]:
        """Modal state, and a comparison of both positions of every axis (#5021 to #5028, #5041 to #5048)."""
        known = [n for n in sorted(numbers.values()) if n <= 8]
        # G49 with an active length offset may move the axis itself, so the programme is refused in that state
        return ["IF[#4008NE49]GOTO900", *self.head, *(f"IF[ABS[#{5040 + n}-#{5020 + n}]GT0.01]GOTO900" for n in known)]


class Fanuc(Controller):
    """Common part of both formats: detection units, capital letters, and the programme of the check."""

    comment: ClassVar[Comment | None] = CAPITAL_COMMENT
    sign_known: ClassVar[bool] = False
    other_sign: ClassVar[str] = "write the tables again with --invert"
    backlash_parameter: ClassVar[str] = "parameter 1851 of axis {axis} (and 1852 where 1800#4 is 1)"
    first_number: ClassVar[int | None] = 1
    number_form: ClassVar[str] = "A{}"
    describes_tilt: ClassVar[bool] = False
    dialect: ClassVar[Dialect | None] = FanucDialect(
        suffix=".nc",
        comment=CAPITAL_COMMENT,
        opening=("%", "O{number}"),
        head=("G69", "G21 G90 G94 G40 G80 G59"),
        move="G1 {axis}{to:.3f} F{feed:g}",
        end=("M30", "N900 #3000=1(LENGTH G59 OR EXT NOT ZERO)", "%"),
        stop="M0",
        needs=(
            "for machining centres: in lathe G code system A, G90 and G94 are cycles: do not run it there",
            "no tool in the spindle; cancel its length offset by hand, the axis free: G49 may move it",
            "the programme numbers O7001 and on must be free",
            "write down G59 and the external offset (EXT), set both to zero, and put them back at the end",
            "an alarm 3001 or an unknown word at the IF lines means: nothing moved, go there by hand",
        ),
        source="not checked in FANUC's manual: G53 as a rapid of one block, #5021 and #5041 of custom macro B",
    )

    def backlash_value(self, setup: Setup, axis: str, size: float) -> str:
        unit = self.unit(setup)
        return f"{round(size / unit):+d} detection units of {1000 * unit:g} um"

    def describe(self, lines: Sequence[Line], setup: Setup) -> list[str]:
        """Changes of the vectors of tool centre point control (A-79348E p. 74-84, A-78712E p. 61-62)."""
        made = _tool_centre(lines)
        if not made:
            return super().describe(lines, setup)
        std = uncertainties(_tool_centre, lines)
        rows = {k: " ".join(f"{v + 0.0:+.4f}" for v in value) for k, value in made.items()}
        return [
            "parameters of tool centre point control on a 30i (machine unit; older ones count in 0.001 mm): add x y z",
            *(f"  {k}: {numbers}{remark(std.get(k), 4, self.comment)}" for k, numbers in rows.items()),
            "the vectors are taken to end at the points of the axes that are named above; the sign is to be tested",
            "19682 and 19687 name the direction of an axis; of what 19683 and 19688 behind them hold no public source "
            "was found: no tilt is entered, and the tables are for axes that lie as tilted as they are",
        ]

    def unit(self, setup: Setup) -> float:
        """Detection unit, mm."""
        return setup.resolution or 0.001

    def quantum(self, setup: Setup) -> float:
        return 0.5 * self.unit(setup) + 1e-9

    def _tape(self, lines: list[str], setup: Setup, said: Sequence[str] = ()) -> str:
        return "\n".join(["%", *header(self, setup, *said), *lines, "%"]) + "\n"


def _tool_centre(lines: Sequence[Line]) -> dict[str, Array]:
    """Changes of the vectors of tool centre point control, by parameters; none for other machines."""
    heads, tables = ([x for x in lines if x.side == side] for side in ("head", "table"))
    at = {x.axis: np.array(x.shift) for x in lines}
    made: dict[str, Array] = {}
    if tables:
        first = tables[-1]  # the one that carries the other
        made["19700 to 19702 (position of the rotary table)"] = at[first.axis]
        if len(tables) == 2:
            made["19703 to 19705 (first to second table axis)"] = at[tables[0].axis] - at[first.axis]
    if heads:
        last = heads[-1]
        made["19709 to 19711 (tool axis to rotary axis)"] = at[last.axis]
        if len(heads) == 2:
            made["19712 to 19714 (second to first tool axis)"] = at[heads[0].axis] - at[last.axis]
    return made if len(heads) + len(tables) == len(lines) else {}


def _real(value: float) -> str:
    """A position or interval with its decimal point: without it some controls count in detection units."""
    text = f"{value:.9g}"
    return text if "." in text or "e" in text else f"{text}.0"


class FanucPitch(Fanuc):
    """Stored pitch error compensation."""

    name: ClassVar[str] = "fanuc-pitch"
    title: ClassVar[str] = "FANUC stored pitch error compensation (parameters 3620-3624, data from N10000)"
    source: ClassVar[str] = "FANUC B-63330EN p. 25; cnc.wiki/en/fanuc-pitch-error-compensation"
    needs: ClassVar[str] = "the option stored pitch error compensation; leave to write parameters, and a restart"
    back: ClassVar[str] = "read the parameters that were backed up (3620 to 3624 and all points) and switch off and on"
    doubt: ClassVar[str] = (
        "the sign (taken as a correction, added to the command), the range of an increment (taken as -7 to 7 detection "
        "units) and the first point's number (taken as N10000 for point 0)"
    )
    most_points: ClassVar[int] = 128
    most_step: ClassVar[int] = 7

    def terms(self, setup: Setup) -> list[Term]:
        # all available points are used, since the steps between them are limited
        curves = [
            Term(m, (m,), (setup.grid(m, self._most(setup, m), anchored=True, every=True),), zero=True)
            for m in setup.linear
            if m in setup.moving
        ]
        return [*curves, *shift_terms(curves)]

    def _most(self, setup: Setup, name: str) -> int:
        """Points that the measured part of an axis may have: the reference point must be one of the axis' points."""
        low, high = setup.axis(name).measured
        span, gap = high - low, max(low, -high, 0.0)
        # two intervals are lost where a round step does not end at the ends
        most = int((self.most_points - 3) * span / (span + gap)) if gap else self.most_points
        if most < 2:
            found = f"a machine zero {gap:.0f} mm from a measured part of {span:.0f} mm"
            cure = "The reference point must be one of its points: measure a larger part of the travel"
            raise InputError(f"--controller {self.name}, axis {name}", found, cure)
        return most

    @staticmethod
    def _with_reference(table: Table, step: float) -> Table:
        """The table with further points to the reference point, where it lies outside; its edge holds up to there."""
        grid = np.asarray(table.term.grids[0])
        before, behind = max(round(grid[0] / step), 0), max(-round(grid[-1] / step), 0)
        if not before and not behind:
            return table
        new = spaced(float(grid[0]) - before * step, step, len(grid) + before + behind)
        return Table(replace(table.term, grids=(new,)), np.pad(table.values, (before, behind), mode="edge"))

    def most_slope(self, setup: Setup, term: Term) -> float | None:
        if not term.inputs:
            return None
        g = term.grids[0]
        return (self.most_step - 1) * self.unit(setup) / (g[1] - g[0])

    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        unit, lines, start = self.unit(setup), list[str](), 0
        for bare in (t for t in tables if t.term.inputs):
            axis, step = self.number(setup, bare.term.output), even_step(bare.term)
            check_points(bare.term, self.most_points)
            place = bare.term.grids[0][0] / step
            if abs(place - round(place)) > 1e-6:
                found = f"positions from {bare.term.grids[0][0]:g}, no whole multiple of the interval {step:g}"
                raise InputError(f"table {bare.term.output}", found, "The reference point 0 must be one of the points")
            table = self._with_reference(bare, step)
            term, place = table.term, table.term.grids[0][0] / step
            check_points(term, self.most_points)
            whole = np.rint(table.values / unit).astype(int)
            steps = np.diff(whole, prepend=0)
            if np.abs(steps[1:]).max(initial=0) > self.most_step:
                most = int(np.abs(steps[1:]).max())
                found = f"a step of {most} detection units, of which one point holds {self.most_step}"
                raise InputError(f"table {term.output}", found, "Give more points, or a coarser --resolution")
            if start + len(steps) > 1024:
                raise InputError("tables", f"{start + len(steps)} points, of which the control has 1024", "Give fewer")
            lines += [
                CAPITAL_COMMENT.line(f"axis A{axis} is {term.output}"),
                f"N3620A{axis}P{start - round(place)}",
                f"N3621A{axis}P{start}",
                f"N3622A{axis}P{start + len(steps) - 1}",
                f"N3623A{axis}P1",
                f"N3624A{axis}P{_real(step)}",
            ]
            # the value of the first point only shifts the axis: the curve is zero at the reference point
            lines += [f"N{FIRST_PITCH_POINT + start + k}P{v}" for k, v in enumerate([0, *steps[1:]])]
            start += len(steps)
        return {"pitch.txt": self._tape(lines, setup, shift_lines(tables))}

    def about(self, tables: Tables, setup: Setup) -> list[str]:
        return [
            "the reference point of each axis is taken to be at its machine position 0 (parameter 1240): where it is "
            "not, the numbers of 3620 shift by its distance over 3624"
        ]

    def read(self, files: Files, setup: Setup) -> Tables:
        name, text = one_file(files, ".txt")
        n, unit, out = blocks(name, text), self.unit(setup), []
        for axis in n.get(3620, {}):
            reference, first, last, scale, step = (n.get(k, {}).get(axis) for k in (3620, 3621, 3622, 3623, 3624))
            if reference is None or first is None or last is None or scale is None or not step or last <= first:
                raise InputError(
                    name, f"parameters 3620 to 3624 of axis {axis} are not all there", "Copy the file again"
                )
            points = range(int(first), int(last) + 1)
            try:
                steps = [n[FIRST_PITCH_POINT + k][0] for k in points]
            except KeyError as error:
                raise InputError(name, f"no N{error.args[0]}", "Copy the file again") from error
            grid = tuple(float(round((k - reference) * step, 9)) for k in points)
            values = np.cumsum(steps) * unit * scale
            letter = self.numbered(setup, axis)
            at_zero = np.interp(0.0, grid, values)  # the correction is zero at the reference point
            out.append(Table(Term(letter, (letter,), (grid,), zero=True), values - at_zero))
        return (*out, *shifts_of(text))

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "compare the axis numbers above, and that no other axis uses the same pitch points",
            "parameter write enable, read pitch.txt as parameters; the detection unit must be as written; intervals "
            "(3624) stand in mm with a decimal point, as a 30i or 0i-D reads them: enter them by hand on older ones",
            "switch the control off and on, G28 all axes, then check with an indicator",
        ]


class Fanuc3d(Fanuc):
    """Three-dimensional error compensation.

    Parameters from N11000 hold the values in detection units: that of axis a (0, 1, 2 in the order of N10800 to N10802)
    at the point with the indices i, j, k along these axes is N(11000 + 3 (i + n0 (j + n1 k)) + a), with n0 and n1 the
    numbers of points (N10803, N10804). Point 0 lies at N10806 to N10808.
    """

    name: ClassVar[str] = "fanuc-3d"
    title: ClassVar[str] = "FANUC three-dimensional error compensation (lattice)"
    source: ClassVar[str] = "FANUC A-79351E p. 3 (trilinear over eight corners)"
    needs: ClassVar[str] = (
        "a 30i or newer with the option three-dimensional error compensation; three linear axes, leave to write "
        "parameters"
    )
    back: ClassVar[str] = "read the parameters that were backed up, and switch off and on"
    doubt: ClassVar[str] = (
        "parameter numbers from 10800 (axes, points, reference, magnification, interval), the order of the points "
        "(the axis of N10800 fastest; from N11000 on, at each point a value for each axis, in the order of N10800 on) "
        "and the sign (taken as a correction)"
    )
    most_points: ClassVar[int] = 128
    most_nodes: ClassVar[int] = 500
    POINTS: ClassVar[int] = 11000

    def suits(self, setup: Setup) -> None:
        super().suits(setup)
        if len(setup.linear) != 3:
            found = f"{len(setup.linear)} linear axes that correct, and the lattice has three"
            raise InputError(
                f"--controller {self.name}", found, f"Use --controller {FanucPitch.name} or {instead(Controller)}"
            )
        still = [m for m in setup.linear if m not in setup.moving]
        if still:
            found = f"errors along {' '.join(setup.linear)} are asked for, and {' '.join(still)} was not measured"
            raise InputError(f"--controller {self.name}", found, "Use --controller fanuc-pitch")

    def terms(self, setup: Setup) -> list[Term]:
        self.suits(setup)
        grids = setup.lattice(setup.linear, self.most_points, self.most_nodes)
        return [Term(m, setup.linear, grids) for m in setup.linear]

    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        unit, term = self.unit(setup), tables[0].term
        if len(tables) != 3 or any(t.term.grids != term.grids for t in tables):
            raise InputError("tables", "not three tables over one lattice", "Give X, Y and Z on the same nodes")
        lines = []
        for k, name in enumerate(term.inputs):
            check_points(term, self.most_points, k)
            step = even_step(term, k)
            lines += [
                CAPITAL_COMMENT.line(f"axis {self.number(setup, name)} is {name}"),
                f"N{LATTICE_PARAMETER + k}P{self.number(setup, name)}",
                f"N{LATTICE_PARAMETER + 3 + k}P{len(term.grids[k])}",
                f"N{LATTICE_PARAMETER + 6 + k}P{_real(term.grids[k][0])}",
                f"N{LATTICE_PARAMETER + 9 + k}P1",
                f"N{LATTICE_PARAMETER + 12 + k}P{_real(step)}",
            ]
        whole = [np.rint(t.values / unit).astype(int).ravel(order="F") for t in tables]
        lines += [f"N{self.POINTS + 3 * k + axis}P{int(whole[axis][k])}" for k in range(term.size) for axis in range(3)]
        return {"lattice.txt": self._tape(lines, setup)}

    def read(self, files: Files, setup: Setup) -> Tables:
        name, text = one_file(files, ".txt")
        n, unit = blocks(name, text), self.unit(setup)
        try:
            axis, count, low, _, step = ([n[LATTICE_PARAMETER + 3 * j + k][0] for k in range(3)] for j in range(5))
            shape = tuple(int(c) for c in count)
            flat: Array = np.array([n[self.POINTS + k][0] for k in range(3 * math.prod(shape))]).reshape(-1, 3)
        except KeyError as error:
            raise InputError(name, f"no N{error.args[0]}", "Copy the file again") from error
        names = tuple(self.numbered(setup, a) for a in axis)
        grids = tuple(map(spaced, low, step, shape))
        return tuple(
            Table(Term(m, names, grids), unit * flat[:, k].reshape(shape, order="F")) for k, m in enumerate(names)
        )

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "compare every parameter number with this control's manual before reading the file: they are not public",
            "back up the parameters; parameter write enable, read lattice.txt as parameters",
            "switch the control off and on, G28 all axes, then check with an indicator",
        ]
