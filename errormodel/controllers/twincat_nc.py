"""Beckhoff TwinCAT NC PTP: ``MC_TableBasedPositionCompensation``, an array in Structured Text.

Positions are equidistant and increase; the correction is added to the position of the same axis; linear interpolation.

Source: Beckhoff Infosys Tc2_MC2, pages 17316396939, 12929471627 and 12929466635.
"""

from __future__ import annotations

import re
from typing import ClassVar

import numpy as np

from errormodel.controllers.base import Controller, header
from errormodel.controllers.dialect import Dialect
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Table, Tables, Term, check_points, even_step
from errormodel.controllers.text import Comment, Files, one_file
from errormodel.exceptions import InputError

ARRAY_TEXT = re.compile(r"(\w)_(both|plus|minus)\s*:\s*ARRAY\[1\.\.(\d+)\][^;]*?:=\s*\[(.*?)\];", re.DOTALL)
ELEMENT_TEXT = re.compile(r"Position\s*:=\s*([-+.\deE]+)\s*,\s*Compensation\s*:=\s*([-+.\deE]+)")
DIRECTION_WORDS = {0: "both", 1: "plus", -1: "minus"}  # names of tables by direction of travel


class TwinCatNc(Controller):
    """Tables for each axis, for one direction or both."""

    name: ClassVar[str] = "twincat-nc"
    title: ClassVar[str] = "Beckhoff TwinCAT NC PTP (MC_TableBasedPositionCompensation)"
    source: ClassVar[str] = "infosys.beckhoff.com tcplclib_tc2_mc2: 17316396939, 12929471627, 12929466635"
    needs: ClassVar[str] = "TwinCAT NC PTP with the PLC library Tc2_MC2; axes that home"
    back: ClassVar[str] = "Enable := FALSE at standstill"
    comment: ClassVar[Comment | None] = Comment("// ")
    sign_known: ClassVar[bool] = True
    dialect: ClassVar[Dialect | None] = None  # NC PTP has no programmes: the PLC moves the axes
    backlash_parameter: ClassVar[str] = "Backlash of MC_BacklashCompensation for {axis}"
    bidirectional: ClassVar[bool] = True
    most_points: ClassVar[int] = 2000

    def terms(self, setup: Setup) -> list[Term]:
        return self.curves(setup, [(m, m) for m in setup.linear if m in setup.moving])

    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        lines = [*header(self, setup), "VAR_GLOBAL CONSTANT"]
        for table in tables:
            term = table.term
            check_points(term, self.most_points)
            even_step(term)
            side, n = DIRECTION_WORDS[term.direction], len(table.values)
            lines.append(f"  {term.output}_{side} : ARRAY[1..{n}] OF ST_PositionCompensationTableElement := [")
            cells = [
                f"    (Position := {x:.9g}, Compensation := {v:.6f})"
                for x, v in zip(term.grids[0], table.values, strict=True)
            ]
            lines += [",\n".join(cells), "  ];"]
            ends = f"MinPosition := {term.grids[0][0]:.9g}, MaxPosition := {term.grids[0][-1]:.9g}"
            lines.append(f"  // {ends}, NoOfTableElements := {n}, Direction: {side}, Modulo := FALSE")
        return {"compensation.st": "\n".join([*lines, "END_VAR"]) + "\n"}

    def read(self, files: Files, setup: Setup) -> Tables:
        name, text = one_file(files, ".st")
        directions = {v: k for k, v in DIRECTION_WORDS.items()}
        out = []
        plain = "\n".join(line.split("//")[0] for line in text.splitlines())
        for axis, side, count, body in ARRAY_TEXT.findall(plain):
            data = np.array([[float(v) for v in e] for e in ELEMENT_TEXT.findall(body)]).reshape(-1, 2)
            if len(data) != int(count):
                found = f"{len(data)} elements in an array of {count}"
                raise InputError(f"{name}, axis {axis}", found, "Copy the file again")
            term = Term(axis, (axis,), (tuple(data[:, 0].tolist()),), direction=directions[side])
            even_step(term)
            out.append(Table(term, data[:, 1]))
        if not out:
            raise InputError(name, "no compensation arrays", "Give the file that was written")
        return tuple(out)

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "import compensation.st as a global variable list (library Tc2_MC2)",
            "one MC_TableBasedPositionCompensation an axis, with its table and the parameters beside it",
            "home the axis, then Enable := TRUE at standstill; the value is added to the position",
        ]
