"""Sufficient statistics of the positions in a range of rows, and how those of two ranges are combined.

All of it is sums, extremes and counts. The ranges, and the tree in which they are combined, depend on the number of
rows alone: the result is the same to the last bit however the rows are divided into files and whoever works on them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from errormodel.arrays import Array
from identification.observation.sums import Sums

EXTREMES = 8  # rows at each end of a channel that are kept: more than a joint has parameters of one kind
MOST_WILD = 12  # rows far beside all others that are named


@dataclass
class Sizes:
    """Lengths of residual vectors, mm."""

    count: int = 0
    total: float = 0.0
    square: float = 0.0
    largest: float = 0.0

    @classmethod
    def of(cls, lengths: Array) -> Sizes:
        """Of lengths (n,)."""
        return cls(len(lengths), float(lengths.sum()), float(lengths @ lengths), float(lengths.max(initial=0.0)))

    def add(self, other: Sizes) -> None:
        """Take in those of other rows."""
        self.count += other.count
        self.total += other.total
        self.square += other.square
        self.largest = max(self.largest, other.largest)


@dataclass
class Totals:
    """Statistics of a range of rows.

    Attributes
    ----------
    folds : normal equations at the starting values by the number of the block that is left out together.
    plain : the same with weight 1 for all rows, where rows have weights.
    nominal : normal equations of the frames' parameters at zero errors.
    before, after : sizes of residuals at zero errors, and at the starting values.
    ranges : lowest and highest value of each recorded channel, mm and rad.
    extremes : channels (rows, channels) of the rows with the lowest and highest values of each channel.
    wild : number of rows far beside all others, and file, row and distance (mm) of the first of them.
    rows : rows read, measured or not.
    notes : on rows of the range.
    seconds : of reading, and of all else.
    """

    folds: dict[int, Sums] = field(default_factory=dict)
    plain: dict[int, Sums] = field(default_factory=dict)
    nominal: Sums = field(default_factory=lambda: Sums.zero(0))
    before: Sizes = field(default_factory=Sizes)
    after: Sizes = field(default_factory=Sizes)
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    extremes: Array = field(default_factory=lambda: np.zeros((0, 0)))
    wild: int = 0
    wild_rows: list[tuple[str, int, float]] = field(default_factory=list)
    rows: int = 0
    notes: dict[str, None] = field(default_factory=dict)
    reading: float = 0.0
    computing: float = 0.0

    def add(self, other: Totals) -> Totals:
        """Take in the statistics of the rows that follow."""
        for mine, theirs in ((self.folds, other.folds), (self.plain, other.plain)):
            for fold, sums in theirs.items():
                mine[fold] = added(mine[fold], sums) if fold in mine else sums
        self.nominal = added(self.nominal, other.nominal) if len(self.nominal.slope) else other.nominal
        self.before.add(other.before)
        self.after.add(other.after)
        for name, (low, high) in other.ranges.items():
            mine_low, mine_high = self.ranges.get(name, (low, high))
            self.ranges[name] = min(low, mine_low), max(high, mine_high)
        self.extremes = outermost(np.vstack([e for e in (self.extremes, other.extremes) if len(e)] or [self.extremes]))
        self.wild += other.wild
        self.wild_rows = (self.wild_rows + other.wild_rows)[:MOST_WILD]
        self.rows += other.rows
        self.notes |= other.notes
        self.reading += other.reading
        self.computing += other.computing
        return self


def added(one: Sums, other: Sums) -> Sums:
    """Sums over the rows of both."""
    return Sums(
        one.gram + other.gram, one.slope + other.slope, one.square + other.square, one.count + other.count
    )  # fmt: skip


def whole_of(folds: dict[int, Sums], size: int) -> Sums:
    """Sums over all blocks, in their order, of so many unknowns."""
    out = Sums.zero(size)
    for number in sorted(folds):
        out = added(out, folds[number])
    return out


def outermost(rows: Array) -> Array:
    """Of rows (n, channels) those with the lowest or highest values of a channel that changes, some of each, once."""
    if len(rows) <= EXTREMES:
        return rows
    columns = np.ascontiguousarray(rows.T)
    ends = [np.argpartition(c, (EXTREMES - 1, -EXTREMES)) for c in columns if c.min() < c.max()]
    if not ends:
        return rows[:1]
    kept = np.concatenate([e[part] for e in ends for part in (slice(EXTREMES), slice(-EXTREMES, None))])
    return np.ascontiguousarray(rows[np.unique(kept)])


def combined(parts: Sequence[Totals]) -> Totals:
    """Statistics of all ranges: neighbours in pairs, then these in pairs, and so on."""
    level = list(parts)
    while len(level) > 1:
        pairs = [level[k].add(level[k + 1]) for k in range(0, len(level) - 1, 2)]
        level = pairs + level[len(level) // 2 * 2 :]
    return level[0] if level else Totals()
