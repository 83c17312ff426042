"""Marlin: skew by M852 I, J, K.

``x' = x - y I - z (J - I K)``, ``y' = y - z K``: I, J, K are the firmware's factors of XY, XZ and YZ. It leaves a
position as it is where X or Y is less than 1 mm from its lower limit, beyond its upper one, or would come beyond them.
Heights (M421) belong to a grid that is compiled in or that the last probing set, so that no table of them is written.

Source: MarlinFirmware/Marlin Marlin/src/module/planner.h (skew), Marlin/src/gcode/calibrate/M852.cpp,
Marlin/src/module/settings.cpp (M500).
"""

from __future__ import annotations

import re
from typing import ClassVar

import numpy as np

from errormodel.arrays import Array, Mask
from errormodel.controllers.base import header
from errormodel.controllers.printers import COUNTED, SKEW_AXES, Printer, skew_tables, skews_of
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Tables, Term
from errormodel.controllers.text import Comment, Files, one_file
from errormodel.exceptions import InputError

M852 = re.compile(r"^M852 I(-?\d[.\d]*) J(-?\d[.\d]*) K(-?\d[.\d]*)\s*$", re.MULTILINE)
WORDS = dict(zip("IJK", ("XY", "XZ", "YZ"), strict=True))
DECIMALS = 8  # of a factor: a float of the firmware has seven digits
LARGEST = 1.0  # factor that M852 takes (SKEW_FACTOR_MAX)
LOWER_MARGIN = 1.0  # mm above the lower limits of X and Y, where nothing is corrected (planner.h)


class Marlin(Printer):
    """One file of commands to send once, and M500."""

    name: ClassVar[str] = "marlin"
    title: ClassVar[str] = "Marlin (M852)"
    source: ClassVar[str] = "MarlinFirmware/Marlin planner.h, gcode/calibrate/M852.cpp"
    scale_setting: ClassVar[str] = "M92 {axis}, steps a mm: multiply by {steps:.6f}, then M500"
    needs: ClassVar[str] = (
        "Marlin compiled with SKEW_CORRECTION, SKEW_CORRECTION_GCODE and SKEW_CORRECTION_FOR_Z, and EEPROM_SETTINGS"
    )
    back: ClassVar[str] = "M852 I0 J0 K0 and M500; take M852 out of the start programmes"
    shown: ClassVar[tuple[str, ...]] = COUNTED
    comment: ClassVar[Comment | None] = Comment("; ")

    def terms(self, setup: Setup) -> list[Term]:
        self.suits(setup)
        return [Term(a, (), (), factor=b) for a, b in SKEW_AXES if a in setup.linear and b in setup.moving]

    def acts(self, tables: Tables, setup: Setup, q: Array) -> Mask:
        moved, good = self._moved(tables, setup, q), np.ones(len(q), dtype=bool)
        for name in "XY":
            (low, high), at = setup.axis(name).travel, q[:, setup.place(name)]
            good &= (at >= low + LOWER_MARGIN) & (at <= high)
            good &= (at + moved[name] >= low) & (at + moved[name] <= high)
        return good

    def emulate(
        self, tables: Tables, setup: Setup, q: Array, direction: Array | None = None, longer: Array | None = None
    ) -> Array:
        moved, good = self._moved(tables, setup, q), self.acts(tables, setup, q)
        return np.column_stack([np.where(good, moved.get(m, 0.0), 0.0) for m in setup.movers])

    @staticmethod
    def _moved(tables: Tables, setup: Setup, q: Array) -> dict[str, Array]:
        """Corrections of X and Y where the firmware corrects."""
        skew = skews_of(tables)
        xy, xz, yz = (-skew[k] for k in WORDS.values())
        _, y, z = (q[:, setup.place(n)] if n in setup.names else np.zeros(len(q)) for n in "XYZ")
        return {"X": -y * xy - z * (xz - xy * yz), "Y": -z * yz}

    def quantum(self, setup: Setup) -> float:
        return float(10.0**-DECIMALS * (1 + sum(max(map(abs, a.travel)) for a in setup.axes)))

    def write(self, tables: Tables, setup: Setup) -> dict[str, str]:
        skew = skews_of(tables)
        for pair, value in skew.items():
            if abs(value) > LARGEST:
                raise InputError(f"skew {pair}", f"{value:g}, and {LARGEST:g} is the most", "Adjust the machine")
        words = " ".join(f"{w}{-skew[pair] + 0.0:.{DECIMALS}f}" for w, pair in WORDS.items())
        lines = [
            *header(self, setup),
            "; M852 counts in the units of G20 and G21",
            "G21",
            f"M852 {words}",
            "; keep it over a restart:",
            "M500",
        ]
        return {"skew.gcode": "\n".join(lines) + "\n"}

    def read(self, files: Files, setup: Setup) -> Tables:
        name, text = one_file(files, ".gcode")
        match = M852.search(text)
        if match is None:
            raise InputError(name, "no M852 I.. J.. K..", "Write it again")
        return tuple(skew_tables({p: -float(v) for p, v in zip(WORDS.values(), match.groups(), strict=True)}, setup))

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "the firmware needs SKEW_CORRECTION, SKEW_CORRECTION_GCODE and, for J and K, SKEW_CORRECTION_FOR_Z "
            "(Configuration.h): without them M852 is an unknown command, or J and K are ignored",
            "home all axes, send skew.gcode once; M852 alone prints the factors; M500 keeps them (EEPROM_SETTINGS), "
            "without it they are gone at the next start",
            "less than 1 mm above the lower limits of X and Y, or where the corrected position would leave "
            "X_MIN_POS..X_MAX_POS or Y_MIN_POS..Y_MAX_POS, the firmware corrects nothing: keep parts away from there",
            "a bed levelling (G29, M420 S1) was on or off as during the survey: it changes Z only, and M852 leaves it",
            "off: M852 I0 J0 K0",
        ]
