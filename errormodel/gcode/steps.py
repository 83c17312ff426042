"""Steps of a programme: effect of each block, as the interpreter finds it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from errormodel.arrays import Array
from errormodel.gcode.codes import EXACT_STOPS
from errormodel.gcode.extruder import Spread
from errormodel.gcode.paths import Line
from errormodel.gcode.words import Block

Kind = Literal["rapid", "feed", "as it is"]


@dataclass(frozen=True)
class Modes:
    """Modal state after a block; the motion of a programme is unknown until it is stated."""

    motion: str = ""
    plane: str = "G17"
    distance: str = "G90"
    arc: str = "G91.1"
    units: str = "G21"
    feed: str = "G94"
    origin: str = ""
    tool: str = ""
    path: str = ""
    back: str = ""  # where canned cycles return to

    @property
    def absolute(self) -> bool:
        return self.distance == "G90"

    @property
    def inch(self) -> bool:
        return self.units == "G20"


@dataclass(frozen=True)
class Step:
    """Effect of a block.

    Attributes
    ----------
    kind : `rapid`, `feed`, or `as it is`: no motion, or one that is not corrected.
    path : path of a motion whose start and end are known; mm and deg.
    named : columns of the axes that have words.
    movable : columns of axes commanded so far whose positions are known; only these may get words.
    placed : columns of axes positioned at `q` by a command with rules of its own.
    shift : (axes,) offset from programme positions to those of the axes, mm and deg.
    came : (axes,) directions of approach before the block, 0 where an axis has not moved yet.
    q : (axes,) positions after the block, NaN where unknown.
    extruded : positions of the extruder before and after the block, mm; NaN where unknown.
    """

    block: Block
    modes: Modes
    kind: Kind = "as it is"
    path: Line | None = None
    named: tuple[int, ...] = ()
    movable: tuple[int, ...] = ()
    placed: tuple[int, ...] = ()
    shift: Array = field(default_factory=lambda: np.zeros(0))
    came: Array = field(default_factory=lambda: np.zeros(0))
    q: Array = field(default_factory=lambda: np.zeros(0))
    extruded: tuple[float, float] = (np.nan, np.nan)
    spread: Spread = ""  # how E counts; empty: not certain


def stops_exactly(step: Step) -> bool:
    """Whether the control stops at the end of every block."""
    return bool(EXACT_STOPS & {*step.block.codes("G"), step.modes.path})
