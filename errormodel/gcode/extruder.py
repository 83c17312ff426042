"""Position of a printer's extruder, and absolute or relative meaning of its words.

Sources: Marlin documentation, M82, M83 and G92; RepRap wiki, "G-code". Whether G90 and G91 change the meaning of E as
well differs between firmwares (Marlin, Klipper and RepRapFirmware).
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from errormodel.gcode.grammar import Codes
from errormodel.gcode.words import Block

INCH_MM = 25.4  # mm per inch
Spread = Literal["absolute", "relative", ""]


class Extruder:
    """State of E; `position` (mm) is NaN while it is unknown."""

    def __init__(self) -> None:
        self.position = np.nan
        self.said: Spread = ""
        self.later: Spread = ""  # mode of the last G90 or G91 since

    def count(self, codes: Codes) -> None:
        """Update the mode of E from the codes of a block."""
        if "M82" in codes or "M83" in codes:
            self.said, self.later = "absolute" if "M82" in codes else "relative", ""
        elif "G90" in codes or "G91" in codes:
            self.later = "absolute" if "G90" in codes else "relative"

    @property
    def spread(self) -> Spread:
        """Mode of E; empty where it is not certain."""
        return "" if self.later not in ("", self.said) else self.said

    def set(self, block: Block) -> None:
        """Apply G92 E."""
        self.position = block.number_of("E") or 0.0

    def move(self, block: Block, inch: bool) -> None:
        """Apply a word E."""
        value = block.number_of("E")
        if value is None:
            return
        value *= INCH_MM if inch else 1.0
        known = {"absolute": value, "relative": self.position + value}
        self.position = known.get(self.spread, np.nan)
