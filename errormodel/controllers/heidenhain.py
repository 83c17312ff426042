"""Heidenhain: compensation tables ``.COM`` with their assignment file ``config.cma``.

One ``.COM`` per axis that causes errors: its position from the machine datum, a column for each axis that is corrected,
and BACKLASH, the values met in minus direction. ``config.cma`` assigns tables to axes; the line with a star is active.
Interpolation is linear.

Constant errors of rotary axes belong into the description table of the kinematics, which goes from the tool to the
workpiece: ``Trans`` lines shift and turn all that follows, ``MachAxis`` lines are the axes.

Source: technical manuals of the MANUALplus 620 (p. 716-718), TNC 407 (p. 151-156) and iTNC 530 HSCI (p. 666-686, 722).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from errormodel.controllers.base import Controller, header
from errormodel.controllers.dialect import Dialect
from errormodel.controllers.rotary_lines import Line, remark
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Table, Tables, Term, check_increasing, check_points
from errormodel.controllers.text import Comment, Files, Lines
from errormodel.exceptions import InputError

COLUMN_WIDTH = 14  # characters of a column
SHIFT_DIGITS, TILT_DIGITS = 4, 6  # behind the point, of mm and of degrees: 0.1 um, and 0.02 um at a metre


def _row(cells: list[str]) -> str:
    return "".join(f"{c:<{COLUMN_WIDTH}}" for c in cells).rstrip()


class Heidenhain(Controller):
    """Tables of the axes that cause errors."""

    name: ClassVar[str] = "heidenhain"
    title: ClassVar[str] = "Heidenhain compensation tables (.COM, config.cma)"
    source: ClassVar[str] = "HEIDENHAIN technical manuals MANUALplus 620 p. 716-718, TNC 407 p. 151-156"
    needs: ClassVar[str] = (
        "a TNC or MANUALplus with compensation tables (.COM and .CMA), and access to its machine parameters"
    )
    back: ClassVar[str] = "take the star away in config.cma, or put back the one that was saved"
    doubt: ClassVar[str] = (
        "the sign (taken as that of MP720: positive where the travel is too long, so the file holds errors), the "
        "layout of columns in the file, and where the first and last values hold"
    )
    comment: ClassVar[Comment | None] = Comment("; ")
    sign_known: ClassVar[bool] = False
    other_sign: ClassVar[str] = "write the tables again with --invert"
    backlash_parameter: ClassVar[str] = "MP_backLash of {axis} (MP710 on TNC 4xx)"
    dialect: ClassVar[Dialect | None] = Dialect(
        suffix=".H",
        comment=Comment("; "),
        opening=("BEGIN PGM {name} MM",),
        head=("TOOL CALL 0 Z",),
        move="L {axis}{to:+.3f} R0 F{feed:g} M91",
        end=("STOP", "END PGM {name} MM"),
        stop="STOP",
        block="{n} ",
        needs=(
            "M91 counts from the machine datum; tool 0 has no length; TCPM, tilted plane and mirror image off first",
            "call tool 0 by hand, spindle empty, before the indicator is mounted: TOOL CALL 0 may start a change",
        ),
        source="HEIDENHAIN TNC 360 user's manual p. 5-39 (M91 in a positioning block), TNC 426 p. 119 (L, R0, F, M)",
    )
    most_points: ClassVar[int] = 256

    def describe(self, lines: Sequence[Line], setup: Setup) -> list[str]:
        """``Trans`` lines of the description table around each rotary axis (iTNC 530 HSCI, p. 670 and 722)."""
        out = [
            "description table of the active kinematics (columns KEY AXIS COORD; mm and degrees, from the tool to the "
            "workpiece): around the MachAxis line of each axis, where it stands; values of a Trans line that is there "
            "already add up"
        ]
        for line in lines:
            values = [*line.shift, *np.degrees(line.tilt)]
            std = [*line.std[:3], *np.degrees(line.std[3:])] if line.spread else 6 * [None]
            digits = 3 * (SHIFT_DIGITS,) + 3 * (TILT_DIGITS,)
            rows = [
                (f"Trans {a} {v:+.{d}f}", remark(None if s is None else [s], d, self.comment))
                for a, v, s, d in zip("XYZABC", values, std, digits, strict=True)
                if abs(v) >= 0.5 * 10.0**-d
            ]
            back = [re.sub(r"[-+](?=\d)", lambda m: "-+"["+-".index(m[0])], row) for row, _ in rows[::-1]]
            there = [f"{row}{said}" for row, said in rows]
            out += [f"around {line.axis}:", *(f"  {row}" for row in (*there, f"MachAxis {line.axis}", *back))]
        return [
            *out,
            "the Trans lines before are taken to end at the points that are named above (a tilt shifts others)",
            "a description holds 50 lines of Trans and MachAxis; the signs are to be tested",
        ]

    def terms(self, setup: Setup) -> list[Term]:
        return self.curves(setup, [(m, i) for i in setup.moving for m in setup.linear])

    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        files: dict[str, str] = {}
        causes = list(dict.fromkeys(t.term.inputs[0] for t in tables))
        for cause in causes:
            own = [t for t in tables if t.term.inputs == (cause,)]
            term = own[0].term
            if any(t.term.grids != term.grids for t in own):
                raise InputError(f"table of {cause}", "columns with different positions", "Give one grid a cause axis")
            check_points(term, self.most_points)
            check_increasing(term)
            names = ["NR", "AXISPOS", "BACKLASH", *(t.term.output for t in own)]
            rows = [
                _row([str(k), f"{x:.5f}", "", *(f"{-t.values[k]:.6f}" for t in own)])
                for k, x in enumerate(term.grids[0])
            ]
            files[f"{cause}.COM"] = "\n".join([f"BEGIN {cause}.COM MM", _row(names), *rows, "[END]"]) + "\n"
        cma = [_row(["NR", "ACTIVE", *causes]), _row(["0", "*", *(f"{c}.COM" for c in causes)])]
        files["config.cma"] = "\n".join(["BEGIN config.cma", *cma, "[END]"]) + "\n"
        files["README.txt"] = "\n".join(header(self, setup)) + "\n"
        return files

    def read(self, files: Files, setup: Setup) -> Tables:
        lines = Lines.of("config.cma", files.get("config.cma", ""), ("BEGIN", "[END]"))
        if len(lines.lines) < 2:
            raise InputError("config.cma", "no assignment of tables to axes", "Give the whole folder")
        causes = lines.lines[0][1].split()[2:]
        active = next((s.split() for _, s in lines.lines[1:] if "*" in s.split()), None)
        if active is None or len(active) != len(causes) + 2:
            raise InputError("config.cma", "no active line (*)", "Mark one line with a star")
        out: list[Table] = []
        for cause, file in zip(causes, active[2:], strict=True):
            if file not in files:
                raise InputError("config.cma", f"{file}, which is not there", "Give the whole folder")
            out += _table(file, files[file], cause)
        return tuple(out)

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "back up config.cma and the tables it names; AXISPOS counts from the machine datum (MP_refPosition), "
            "and is here the position as the survey counted it: add the difference where its zero was another",
            "copy the tables, check the column names against CfgAxes/axisList",
            "only one line of config.cma is active (*); take the star away to switch all of them off",
            "BACKLASH is empty: backlash along an axis stays with its machine parameter, and other reversal errors are "
            "left",
        ]


def _table(file: str, text: str, cause: str) -> list[Table]:
    lines = Lines.of(file, text, ("BEGIN", "[END]"))
    if "[END]" not in text:
        raise InputError(file, "no [END]: the table is not whole", "Copy the file again")
    head = lines.lines[0][1].split()
    outputs = [h for h in head if h not in ("NR", "AXISPOS", "BACKLASH")]
    data = lines.rows(1, 2 + len(outputs))
    term = Term("", (cause,), (tuple(data[:, 1].tolist()),))
    check_increasing(term, name=file)
    return [Table(Term(o, term.inputs, term.grids), -data[:, 2 + k]) for k, o in enumerate(outputs)]
