"""Correction of G-code programmes and tables of commands, for controllers without compensation tables.

A programme is parsed by the strict grammar of its dialect and refused as a whole, with line and word, where anything is
not understood or not known; see `errormodel.gcode.rewrite` for the words of corrected lines. The result is executed
and compared with the original before it is handed over. A CSV has one column per joint, in mm and degrees,
and any others beside them, which stay.

Sources: RS274/NGC (NIST IR 6556) for words and modal groups, the manuals of LinuxCNC and FANUC, Marlin's documentation.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.base import Rewriter
from errormodel.controllers.command_table import CommandTable
from errormodel.controllers.setup import Setup
from errormodel.exceptions import InputError
from errormodel.gcode.divide import Correct
from errormodel.gcode.programme import Corrected, Source, corrected, outside_measured
from errormodel.gcode.reading import Reading


class GCode(Rewriter):
    """Corrected programmes."""

    name: ClassVar[str] = "gcode"
    title: ClassVar[str] = "corrected G-code or CSV of commands (controllers without tables)"
    source: ClassVar[str] = "NIST IR 6556 (RS274/NGC); manuals of LinuxCNC, FANUC 30i, Marlin, Klipper"
    needs: ClassVar[str] = (
        "the programme, the work offsets and tool lengths that are active when it runs, and where the axes stand "
        "before it"
    )
    test: ClassVar[str] = "compare the corrected programme with the plain one, and run it above the part first"
    back: ClassVar[str] = "run the plain programme"
    general: ClassVar[bool] = True

    def quantum(self, setup: Setup) -> float:
        return 0.5 * 10.0 ** -self._figures(setup)

    @staticmethod
    def _figures(setup: Setup) -> int:
        return int(np.ceil(-np.log10(setup.resolution or 1e-4) - 1e-9))

    def positions(self, name: str, text: str, setup: Setup, reading: Reading | None = None) -> Array:
        if name.lower().endswith(".csv"):
            return CommandTable.of(name, text, setup).q
        steps = Source.of(name, text, reading or Reading()).without_cycles(setup).steps(setup)
        ends = [s.q for s in steps if s.path is not None]
        return np.vstack(ends) if ends else np.zeros((0, len(setup.axes)))

    def rewrite(
        self, name: str, text: str, setup: Setup, correct: Correct, reading: Reading | None = None
    ) -> Corrected:
        figures = self._figures(setup)
        if not name.lower().endswith(".csv"):
            return corrected(name, text, setup, correct, reading or Reading(), figures)
        if reading is not None:
            raise InputError(name, "a CSV of commands takes no --dialect, --offset, --at", "Leave them out")
        table = CommandTable.of(name, text, setup)
        outside = [k for k, row in enumerate(table.q, start=1) if outside_measured(row, setup)]
        leave = [f"{len(outside)} rows leave the measured region (first row {outside[0]})"] if outside else []
        written = table.text(correct(table.q, _arrivals(table.q)), figures)
        return Corrected(written, tuple(f"{name}: {said}" for said in (*table.notes(setup), *leave)))

    def checklist(self, setup: Setup) -> list[str]:
        return [
            f"positions are written with {self._figures(setup)} decimals: --resolution where the control takes fewer",
            "work offsets and tool lengths at the control are those that were given (--offset); where they change, "
            "write the programme again",
            "a datum that was touched off keeps the machine's error there, and the corrected programme moves it by the "
            "correction (compare both programmes at the datum): where features must keep their distance from a "
            "touched edge, shift the work offset back by that",
            "switch off every compensation that was off when the survey was measured; no tool centre point control",
            "compare the programmes, and run the corrected one above the part first: positions differ by micrometres",
        ]


def _arrivals(q: Array) -> Array:
    """Directions of approach of the rows of a table."""
    step = np.sign(np.diff(q, axis=0, prepend=q[:1]))
    for k in range(1, len(step)):
        step[k] = np.where(step[k] == 0, step[k - 1], step[k])
    return np.where(step == 0, 1.0, step)
