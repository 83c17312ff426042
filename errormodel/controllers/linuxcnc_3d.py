"""LinuxCNC in three dimensions: a component of HAL between motion controller and drives, and its table.

LinuxCNC itself has tables of one joint over its own position only. Its hardware abstraction layer lets a component
change what the motion controller sends to the drives: ``linuxcnc_3d.c``, which the user builds with halcompile. The
table holds corrections on a lattice over all axes, multilinear between nodes, the edge's beyond them; for each node
also how they change with the length of the tool.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.base import Controller, header
from errormodel.controllers.dialect import RS274, Dialect
from errormodel.controllers.lattices import lattice_terms
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import LONGER, Table, Tables, Term, check_increasing, check_points
from errormodel.controllers.text import Comment, Files, Lines, one_file
from errormodel.exceptions import InputError

COMPONENT = "errormodel_3d"
PREFIX = "errormodel-3d"  # of its pins
VERSION = 1
MOST_AXES = 9  # of a table, as in the component
SLOPE_DIGITS = 12  # behind the point, of corrections per mm of tool length
CURE = "Write the table again with compensate"


class LinuxCnc3d(Controller):
    """A table, the component's source, and lines of HAL that load and connect it."""

    name: ClassVar[str] = "linuxcnc-3d"
    title: ClassVar[str] = "LinuxCNC with errormodel's HAL component (lattice over all axes)"
    source: ClassVar[str] = "errormodel's own; pins of LinuxCNC's motion controller: man 9 motion"
    needs: ClassVar[str] = (
        "LinuxCNC in mm (tested in 2.9), its package -dev for halcompile, joints that are the axes themselves "
        "(trivkins)"
    )
    back: ClassVar[str] = (
        "setp errormodel-3d.enable 0 (the correction is ramped off); take out the HALFILE line and restart"
    )
    comment: ClassVar[Comment | None] = Comment("# ")
    sign_known: ClassVar[bool] = True
    backlash_parameter: ClassVar[str] = "BACKLASH in [{axis}]"
    first_number: ClassVar[int | None] = 0
    number_form: ClassVar[str] = "JOINT_{}"
    dialect: ClassVar[Dialect | None] = RS274
    follows_tool: ClassVar[bool] = True
    describes: ClassVar[bool] = False  # trivkins knows no rotary axes
    most_points: ClassVar[int] = 1025

    def terms(self, setup: Setup) -> list[Term]:
        plain = lattice_terms(self, setup)
        return plain + ([replace(t, factor=LONGER) for t in plain] if any(setup.along_tool) else [])

    def quantum(self, setup: Setup) -> float:
        return 1e-7

    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        source = Path(__file__).with_suffix(".c").read_text(encoding="ascii")
        return {
            f"{COMPONENT}.table": self._table(tables, setup),
            f"{COMPONENT}.hal": self._hal(tables, setup),
            f"{COMPONENT}.c": source,
        }

    def _table(self, tables: Tables, setup: Setup) -> str:
        first, size = tables[0].term, [len(g) for g in tables[0].term.grids]
        for axis in range(len(first.inputs)):
            check_points(first, self.most_points, axis)
            check_increasing(first, axis)
        plain = {t.term.output: t.values for t in tables if not t.term.factor}
        longer = {t.term.output: t.values for t in tables if t.term.factor}
        moves = _moves(tables, setup)
        nothing = np.zeros(size)
        columns = [np.ravel(plain.get(m, nothing)) for m in moves]
        slopes = [np.ravel(longer.get(m, nothing)) for m in moves] if longer else []
        turns = "".join(n for n in first.inputs if setup.axis(n).turns)
        lines = [f"{PREFIX} {VERSION}", f"axes {''.join(first.inputs)}", f"moves {''.join(moves)}"]
        lines += [f"turns {turns or '-'}", f"tool {int(bool(longer))}"]
        for name, grid in zip(first.inputs, first.grids, strict=True):
            lines.append(f"grid {name} {len(grid)} {' '.join(f'{x:.9g}' for x in grid)}")
        lines.append(f"values {math.prod(size)}")
        rows = zip(*columns, *slopes, strict=True)
        form = " ".join(["%.7f"] * len(columns) + [f"%.{SLOPE_DIGITS}f"] * len(slopes))
        lines += [form % row for row in rows]
        head, body = ("\n".join(part) + "\n" for part in (header(self, setup), lines))
        return f"{head}{body}check {_check(body)}\n"

    def _hal(self, tables: Tables, setup: Setup) -> str:
        first, moves = tables[0].term, _moves(tables, setup)
        lines = header(
            self,
            setup,
            "after the lines that load and add the motion controller; for every corrected joint N the drive takes "
            f"{PREFIX}.LETTER.motor-out in place of joint.N.motor-pos-cmd, and its feedback goes to "
            f"{PREFIX}.LETTER.feedback-in in place of joint.N.motor-pos-fb",
        )
        letters = f"axes={''.join(first.inputs)} moves={''.join(moves)}"
        lines += [
            f"loadrt {COMPONENT} file=$(CONFIG_DIR)/{COMPONENT}.table {letters}",
            f"addf {PREFIX} servo-thread",
            f"net {PREFIX}-inhibit {PREFIX}.inhibit => motion.feed-inhibit",
            f"setp {PREFIX}.enable 1",
        ]
        for name in first.inputs:
            joint = f"joint.{self.number(setup, name)}"
            lines.append(f"net {PREFIX}-{name}-position {joint}.pos-cmd => {PREFIX}.{name}.position")
            lines.append(f"net {PREFIX}-{name}-homed {joint}.homed => {PREFIX}.{name}.homed")
        for name in moves:
            joint = f"joint.{self.number(setup, name)}"
            lines.append(f"net {PREFIX}-{name}-motor {joint}.motor-pos-cmd => {PREFIX}.{name}.motor-in")
            lines.append(f"net {PREFIX}-{name}-feedback {PREFIX}.{name}.feedback-out => {joint}.motor-pos-fb")
        if any(t.term.factor for t in tables):
            lines += [
                "# corrections follow the tool's length: set tool-reference to the Z offset that the tool of the",
                "# tables has in the tool table, then tool-follow to 1; G43 must then be active whenever it cuts",
                f"net {PREFIX}-tool motion.tooloffset.z => {PREFIX}.tool-length",
                f"setp {PREFIX}.tool-reference 0",
                f"setp {PREFIX}.tool-follow 0",
            ]
        return "\n".join(lines) + "\n"

    def read(self, files: Files, setup: Setup) -> Tables:
        name, text = one_file(files, ".table")
        while text.startswith("#"):
            text = text.partition("\n")[2]
        body, mark, check = text.rpartition("check ")
        if not mark or check.strip() != _check(body):
            raise InputError(name, "a table that is damaged: its check sum is another, or missing", CURE)
        lines = Lines.of(name, body)
        words = [(k, s.split()) for k, s in lines.lines[: 5 + MOST_AXES]]
        keys = {w[0]: w[1:] for _, w in words[:5]}
        if [*keys] != [PREFIX, "axes", "moves", "turns", "tool"] or any(len(v) != 1 for v in keys.values()):
            raise lines.error(1, "a head that is not of this version", CURE)
        axes, moves, tool = keys["axes"][0], keys["moves"][0], keys["tool"][0] == "1"
        heads = words[5 : 5 + len(axes)]
        grids = tuple(tuple(lines.numbers(k, " ".join(w[3:]), int(w[2]))) for k, w in heads)
        shape = tuple(map(len, grids))
        values = _values(lines, 6 + len(axes), len(moves) * (1 + tool), math.prod(shape))
        out = [Term(m, tuple(axes), grids) for m in moves]
        out += [replace(t, factor=LONGER) for t in out] if tool else []
        found = tuple(Table(t, values[:, k].reshape(shape)) for k, t in enumerate(out))
        for axis in range(len(axes)):
            check_increasing(found[0].term, axis)
        return found

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "the table is in mm and degrees: [TRAJ] LINEAR_UNITS must be mm (where it is inch, do not load it)",
            f"build the component once, on the machine's computer: halcompile --install {COMPONENT}.c (package "
            "linuxcnc-uspace-dev)",
            f"copy {COMPONENT}.table and {COMPONENT}.hal beside the INI file; add HALFILE = {COMPONENT}.hal to its "
            "[HAL], after the file that loads the motion controller; let drives and feedback go through the component, "
            "as its first lines say; compare the joints' numbers with [TRAJ] COORDINATES",
            "COMP_FILE and BACKLASH of the corrected joints stay as they were during the survey, but for what is said "
            "of backlash above",
            f"restart LinuxCNC and home: halcmd show pin {PREFIX} must say valid TRUE, and active TRUE after a second; "
            "'inhibit' holds the feed until then, and for good where the table is missing or damaged",
        ]


def _check(body: str) -> str:
    """Check sum of all that is read: CRC-32 of the bytes behind the comments."""
    return f"{zlib.crc32(body.encode('utf-8')):08x}"


def _moves(tables: Tables, setup: Setup) -> list[str]:
    """Letters of the axes that the tables correct, in the order of the setup."""
    outputs = {t.term.output for t in tables}
    return [m for m in setup.movers if m in outputs]


def _values(lines: Lines, start: int, columns: int, count: int) -> Array:
    """Rows of values (count, columns) behind the line that says how many there are."""
    rows = lines.lines[start:]
    if not lines.lines[start - 1][1].startswith("values ") or len(rows) != count:
        raise lines.error(rows[-1][0] if rows else 1, f"{len(rows)} nodes, of which the grids have {count}", CURE)
    return lines.rows(start, columns)
