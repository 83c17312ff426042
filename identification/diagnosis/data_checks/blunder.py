"""A mistake in a recording (blunder), and its measure: distance of the points from the nominal machine's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Index, Mask
from errormodel.chain import Chain
from errormodel.conventions import INSTRUMENT
from errormodel.effects.axis_blunder import AxisBlunder
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED, TOOL_COLUMNS
from identification.observation.assembly import frame_labels
from identification.observation.frames import MACHINE_ERROR_SHARE, align
from identification.observation.pose import IDENTITY, Pose

if TYPE_CHECKING:
    import pandas as pd

ROUNDS = 6  # of an alignment: enough to leave outliers out
LISTED = 12  # rows in a message
OF_MACHINE = "see at the machine which of these it is; then correct the machine file, or the table"
FEWEST = 8  # rows with all three components, to say anything


@dataclass(frozen=True)
class Blunder:
    """A mistake in a recording, and the survey without it.

    Attributes
    ----------
    text : what is wrong, as the beginning of a sentence.
    changes : what puts whole columns right, in tables to come as well; none where only rows of this one are concerned.
    others : changes of other columns, by which the recording is explained as well as by `changes`.
    before_um, after_um : misfit of the nominal machine with the mistake and without, where that is what gave it away.
    rows : the data rows concerned, from 1, where it is not all of them.
    of_machine : whether the machine file may be wrong rather than the recording, in which nothing is put right then.
    """

    text: str
    survey: Survey
    effect: str = AxisBlunder.effect
    where: str = INSTRUMENT
    driver: tuple[str, ...] = ()
    changes: tuple[AxisBlunder, ...] = ()
    others: tuple[tuple[AxisBlunder, ...], ...] = ()
    before_um: float | None = None
    after_um: float | None = None
    rows: tuple[int, ...] | None = None
    cure: str = AxisBlunder.separate
    mended: str = ""  # how rows were put right, where `text` does not say it
    of_machine: bool = False

    @property
    def open(self) -> bool:
        """Whether the recording does not tell what is wrong, so that nobody may put it right unasked."""
        return bool(self.others) or self.of_machine

    @property
    def in_diameters(self) -> str:
        """The only column that is wrong, where it has diameters for radii; else empty."""
        one = self.changes[0] if len(self.changes) == 1 and not self.open else None
        return one.column if one is not None and one.factor == 0.5 and not one.swap else ""

    @property
    def doubt(self) -> str:
        """That the recording does not tell which columns are wrong, as a sentence; empty where it does."""
        if not self.others:
            return ""
        return (
            ". Nothing in the recording tells which of these it is, and the signs of the squarenesses and all "
            "compensation tables depend on it"
        )

    @property
    def check(self) -> str:
        """How to find out which columns are wrong, or else how to put them right."""
        if not self.others:
            return OF_MACHINE if self.of_machine else self.cure
        names = dict.fromkeys(c.column for change in (self.changes, *self.others) for c in change)
        axes = [name for name in names if name not in (*MEASURED, *TOOL_COLUMNS)]
        if not axes:
            return self.cure
        one = f"each of {' '.join(axes)}" if len(axes) > 1 else axes[0]
        return (
            f"move {one} by hand in its positive direction and look at the sign: of what changes in its column, and of "
            "what is measured; then correct the table or the program that writes it, or the machine file"
        )


Sheet = dict[str, Array]
"""A table's columns by name: the chain's channels, and what was measured."""


def sheet(chain: Chain, table: pd.DataFrame) -> Sheet:
    """The columns of a survey's table."""
    channels = dict(zip(chain.channels, chain.columns(table), strict=True))
    return channels | {name: table[name].to_numpy(dtype=np.float64) for name in MEASURED}


@dataclass(frozen=True)
class Points:
    """Nominal and measured points of some rows, each (n, 3); in a `fixed` frame they are to be the same."""

    nominal: Array
    measured: Array
    fixed: bool = False
    largest: float = np.inf  # misfit (mm) that errors of the machine can make

    @classmethod
    def of(cls, chain: Chain, sheet: Sheet, fixed: bool) -> Points:
        nominal = chain.kernel("nominal", outputs=(0, 1, 2))([sheet[name] for name in chain.channels]).T
        return cls(
            nominal, np.column_stack([sheet[name] for name in MEASURED]), fixed, MACHINE_ERROR_SHARE * chain.size
        )

    def __len__(self) -> int:
        return len(self.nominal)

    def part(self, rows: Index | Mask) -> Points:
        return replace(self, nominal=self.nominal[rows], measured=self.measured[rows])

    @property
    def measured_whole(self) -> Points:
        """Those with all three components."""
        return self.part(np.flatnonzero(np.isfinite(self.measured).all(axis=1)))

    def reordered(self, order: Index) -> Points:
        """What was measured in another order, beside the same commands."""
        return replace(self, measured=self.measured[order])

    def shifted(self, rows: int) -> Points:
        """What was measured so many rows later, beside the commands; only where something was."""
        last = len(self) - max(rows, 0)
        first = max(-rows, 0)
        pairs = replace(self, nominal=self.nominal[first:last], measured=self.measured[first + rows : last + rows])
        return pairs.measured_whole

    def pose(self, rounds: int = ROUNDS) -> Pose:
        """The best frame; in no `rounds`, that of all points alike."""
        return IDENTITY if self.fixed else align(self.nominal, self.measured, rounds=rounds, largest=self.largest)

    def distances(self, pose: Pose | None = None) -> Array:
        """From each measured point to its nominal one, (n,) in mm; in the best frame if none is given."""
        return np.asarray(np.linalg.norm(self.measured - (pose or self.pose()).apply(self.nominal), axis=1))

    def misfit(self, pose: Pose | None = None) -> float:
        """Distance (mm) that four of five rows keep within: a few outliers do not count, half the rows do."""
        return float(np.nanquantile(self.distances(pose), 0.8))

    @property
    def reach(self) -> float:
        """Root mean square distance of the measured points from their middle, mm."""
        return float(np.sqrt(np.sum(np.var(self.measured, axis=0))))

    @property
    def spread(self) -> float:
        """Root mean square distance of the nominal points from their middle, mm."""
        return float(np.sqrt(np.sum(np.var(self.nominal, axis=0))))


def groups(survey: Survey, *, gaps: bool = False) -> list[Index]:
    """Rows to fit with all three components, in their order: those of one file that share a measuring frame.

    With `gaps` also rows between them of which something is missing.
    """
    import pandas as pd

    table = survey.table
    whole = (np.isfinite(survey.measured).all(axis=1) | gaps) & (table["role"] == "fit").to_numpy()
    file, frame = (pd.factorize(labels, use_na_sentinel=False)[0] for labels in (table["file"], frame_labels(survey)))
    both = file * (frame.max(initial=0) + 1) + frame
    return [np.flatnonzero(whole & (both == code)) for code in pd.unique(both[whole])]


def misses(blunder: Blunder) -> str:
    """By how much the nominal machine misses with the mistake and without, as the end of a sentence."""
    if blunder.before_um is None or blunder.after_um is None or not np.isfinite(blunder.before_um + blunder.after_um):
        return ""
    before, after = length(blunder.before_um), length(blunder.after_um)
    return f": the nominal machine misses by {before}, with it put right by {after} (four of five rows stay within)"


def length(um: float) -> str:
    """A length in um, a large one in mm."""
    return f"{um / 1e3:.1f} mm" if um >= 1e4 else f"{um:.0f} um" if um >= 999.5 else f"{um:.{1 + (um < 0.95)}f} um"


def listed(rows: Sequence[int]) -> str:
    """Numbers of rows for a message, the first of many."""
    return ", ".join(map(str, rows[:LISTED])) + (" ..." if len(rows) > LISTED else "")
