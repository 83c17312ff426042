"""ETALON exchange format of error parameters, read by the ISG kernel and by programs for tracking interferometers.

Sections by error parameter: ``VALUE = x`` for a constant, or ``Gridpoints = {`` with a position and a value per line.

Source: Beckhoff Infosys TF5280, page 296430091 (Etalon Exchange Format, vendor variant).
"""

from __future__ import annotations

import re
from typing import ClassVar

import numpy as np

from errormodel.controllers.base import header
from errormodel.controllers.isg import SIGN_DOUBT, Kernel, configuration
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Table, Tables, Term, check_increasing, check_points
from errormodel.controllers.text import Files, Lines
from errormodel.controllers.volumetric import ISO_MOTIONS, KINEMATIC
from errormodel.exceptions import InputError

SECTION_LINE = re.compile(r"\[(\w+)\]")


class Etalon(Kernel):
    """One curve per error parameter."""

    name: ClassVar[str] = "etalon"
    title: ClassVar[str] = "ETALON exchange format (Beckhoff TF5280 / ISG kernel)"
    source: ClassVar[str] = "infosys.beckhoff.com TF5280: 296430091"
    needs: ClassVar[str] = (
        "an ISG kernel or TwinCAT CNC with volumetric compensation (licence TF5280); linear axes X, Y and Z"
    )
    back: ClassVar[str] = "#VOLCOMP OFF [ID0]; take vol_comp[0] out of the start-up list and restart"
    doubt: ClassVar[str] = SIGN_DOUBT
    most_points: ClassVar[int] = 2000

    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        lines = header(self, setup)
        for name, value in self.kinematics(setup).items():
            lines += [f"[{name}]", f"VALUE = {value:.9g}"]
        for table in tables:
            check_points(table.term, self.most_points)
            check_increasing(table.term)
            lines += [f"[{table.term.output}]", "Gridpoints = {"]
            lines += [f"{x:.9g} {v:.9e}" for x, v in zip(table.term.grids[0], table.values, strict=True)]
            lines.append("}")
        names = self.measured(setup)
        return {
            "exchange.etalon": "\n".join(lines) + "\n",
            "vol_comp_0.lis": configuration(self, setup, "exchange.etalon", "ETALON_EXCHANGE", names),
        }

    def read(self, files: Files, setup: Setup) -> Tables:
        name = next((n for n in files if not n.endswith(".lis")), "")
        lines = Lines.of(name, files.get(name, ""), ("//",))
        out: list[Table] = []
        section, rows = "", list[list[float]]()
        for number, line in lines.lines:
            match = SECTION_LINE.fullmatch(line)
            if match:
                section = match[1]
            elif line.upper().startswith("VALUE"):
                value = lines.numbers(number, line.split("=")[1], 1)
                if KINEMATIC.fullmatch(section):
                    continue
                out.append(_table(lines, number, section, [[0.0, *value]], setup))
            elif line.startswith("Gridpoints"):
                rows = []
            elif line == "}":
                out.append(_table(lines, number, section, rows, setup))
            else:
                rows.append(lines.numbers(number, line, 2))
        if not out:
            raise InputError(name or "files", "no error parameters", "Give a file in the ETALON exchange format")
        return tuple(t for t in out if t.term.output)

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "compare the logical axis numbers in vol_comp_0.lis; set its path in the start-up list",
            "#VOLCOMP ON [ID0]; to load again: #VOLCOMP OFF, then #VOLCOMP [ID0 UPDATE]",
            "leave leadscrew and cross compensations of these axes as they were when the survey was measured",
        ]


def _table(lines: Lines, number: int, section: str, rows: list[list[float]], setup: Setup) -> Table:
    """Parse a component error (EXY), or a location error (C0B), which is a constant of its axis."""
    axis = section[-1:]
    if axis not in setup.names:
        found = f"parameter {section or '(none)'} of an axis that this machine has not"
        raise lines.error(number, found, "Leave its section out")
    output = f"E{section[0]}{axis}" if section[1:2] == "0" else section
    if output[:2] not in ISO_MOTIONS:
        raise lines.error(number, f"'{section}' is no error parameter", "Write EXX ... ECC or X0X ... C0C")
    data = np.array(rows).reshape(-1, 2)
    term = Term(output, (axis,), (tuple(data[:, 0].tolist()),))
    check_increasing(term)
    return Table(term, data[:, 1])
