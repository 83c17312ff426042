"""Where a printer's extruder stands, and how its words count.

Sources: Marlin documentation, M82, M83 and G92; RepRap wiki, "G-code". Whether G90 and G91 change how E counts, too,
differs between firmwares (Marlin, Klipper and RepRapFirmware each in its way).
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from errormodel.gcode.grammar import Codes
from errormodel.gcode.words import Block

INCH_MM = 25.4
Spread = Literal["absolute", "relative", ""]


class Extruder:
    """Follows E. `position` (mm) is not a number while it is not known."""

    def __init__(self) -> None:
        self.position = np.nan
        self.said: Spread = ""
        self.later: Spread = ""  # what G90 or G91 said since

    def count(self, codes: Codes) -> None:
        """Take note of codes that say how E counts."""
        if "M82" in codes or "M83" in codes:
            self.said, self.later = "absolute" if "M82" in codes else "relative", ""
        elif "G90" in codes or "G91" in codes:
            self.later = "absolute" if "G90" in codes else "relative"

    @property
    def spread(self) -> Spread:
        """How E counts; empty where that is not certain."""
        return "" if self.later not in ("", self.said) else self.said

    def set(self, block: Block) -> None:
        """G92 E."""
        self.position = block.number_of("E") or 0.0

    def move(self, block: Block, inch: bool) -> None:
        """Follow a word E."""
        value = block.number_of("E")
        if value is None:
            return
        value *= INCH_MM if inch else 1.0
        known = {"absolute": value, "relative": self.position + value}
        self.position = known.get(self.spread, np.nan)
