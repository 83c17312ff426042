"""Common part of printer firmwares: skew of three axes, and a height map over X and Y."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers import instead
from errormodel.controllers.base import Controller
from errormodel.controllers.dialect import Dialect
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Table, Tables, Term
from errormodel.controllers.text import printable
from errormodel.exceptions import InputError

# of firmwares that count motor steps; a printer whose motors are not its axes (CoreXY, delta) shows others
COUNTED = (
    "Home all axes. Load skew and heights as the checklist says; no work offset, no babystepping, no offset of a tool.",
    "At each place: G90, G1 X.. Y.. Z.. F1200 (first Z, then X and Y), M400, M114. M92 shows the steps a mm.",
    "Steps behind 'Count', over steps a mm, minus the coordinate (where each motor moves one axis), must be:",
)
SKEW_AXES = (("X", "Y"), ("X", "Z"), ("Y", "Z"))  # (corrected axis, axis of which it is a function)


class Printer(Controller):
    """Skew (mm per mm) and heights (mm)."""

    test: ClassVar[str] = "`sign_test/steps.txt` names places, and what the firmware itself must show there"
    sign_known: ClassVar[bool] = True
    dialect: ClassVar[Dialect | None] = None
    backlash_parameter: ClassVar[str] = ""
    describes: ClassVar[bool] = False
    least_points = 3
    shown: ClassVar[tuple[str, ...]]  # where the firmware shows what it adds; last, a line that ends with "must be:"

    def suits(self, setup: Setup) -> None:
        super().suits(setup)
        if not {"X", "Y"} <= {*setup.linear}:
            found = f"corrections by {', '.join(setup.movers)}; the firmware wants linear axes X, Y (and Z)"
            raise InputError(f"--controller {self.name}", found, f"Use --controller {instead()}")

    def own_check(self, setup: Setup, tables: Tables) -> dict[str, str]:
        """What the firmware must show at a few places: the sign is documented, and no indicator fits a nozzle."""
        lines = [
            "CHECK: does the firmware add what the tables say? No indicator is needed. Nothing may stand on the bed.",
            f"machine: {printable(setup.machine)}",
            *self.shown,
        ]
        for share in (0.25, 0.5, 0.75):
            q = np.array([[a.measured[0] + share * (a.measured[1] - a.measured[0]) for a in setup.axes]])
            q = np.round(q, 1)
            moved = self.emulate(tables, setup, q)[0]
            place = " ".join(f"{a.name}{q[0, setup.place(a.name)]:.1f}" for a in setup.ordered)
            added = " ".join(f"{m} {moved[setup.movers.index(m)]:+.4f}" for m in setup.watched)
            lines.append(f"  {place}: {added} mm")
        lines += [
            "The same figures with the other sign: factors or heights of another source are loaded. Zeros: none are.",
            "Only Z differs: another map of heights is loaded, or it fades out. Then look at the checklist again.",
        ]
        return {"steps.txt": "\n".join(lines) + "\n"}

    def terms(self, setup: Setup) -> list[Term]:
        self.suits(setup)
        skews = [Term(a, (), (), factor=b) for a, b in SKEW_AXES if a in setup.linear and b in setup.moving]
        if "Z" not in setup.linear or not {"X", "Y"} <= {*setup.moving}:
            return skews
        fine = replace(
            setup, axes=tuple(replace(a, intervals=max(a.intervals, self.least_points - 1)) for a in setup.axes)
        )
        return [*skews, Term("Z", ("X", "Y"), fine.lattice(("X", "Y"), self.most_points, 500))]


def skews_of(tables: Tables) -> dict[str, float]:
    """XY, XZ, YZ: correction of the first axis per mm of the second."""
    found = {t.term.output + t.term.factor: float(t.values) / 1000 for t in tables if not t.term.inputs}
    return {a + b: found.get(a + b, 0.0) for a, b in SKEW_AXES}


def skew_tables(values: dict[str, float], setup: Setup) -> list[Table]:
    """Skew tables from such values, for axes that the machine has."""
    return [
        Table(Term(k[0], (), (), factor=k[1]), np.array(1000 * v))
        for k, v in values.items()
        if k[0] in setup.movers and k[1] in setup.names
    ]


def skewed(q: Array, moved: Array, setup: Setup) -> Array:
    """Positions (n, axes) after corrections (n, movers) by skew."""
    out = q.copy()
    out[:, [setup.place(m) for m in setup.movers]] += moved
    return out


def heights_of(tables: Tables) -> Table | None:
    """The height map, if there is one."""
    return next((t for t in tables if t.term.inputs), None)
