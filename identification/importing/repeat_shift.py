"""A displacement that repeats of commands show: of two measurements of a pose, no error of geometry tells them apart.

Differences of a later and an earlier measurement of one command, from the same side, are noise; those that straddle
a displacement all have it as their mean. It is far smaller than a step that the proof sees beside the machine's errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index

FEWEST = 4  # repeated commands on either side of a displacement
CHANCE = 1e-4  # that noise explains as much at the best of all borders
ALIKE = 27.0  # mean squares of the noise: three components at three standard deviations
GAIN = 2.0  # times less must it leave of the differences that straddle it


@dataclass(frozen=True)
class RepeatShift:
    """Repeats of `count` commands lie `size_um` apart, on either side of rows `after` to `before` of `file`."""

    file: str
    after: int
    before: int
    size_um: float
    noise_um: float
    count: int

    @property
    def text(self) -> str:
        """A sentence for the proof."""
        where = (
            f"at row {self.before}" if self.before == self.after + 1 else f"between rows {self.after} and {self.before}"
        )
        return (
            f"repeats of {self.count} commands lie {self.size_um:.3g} um apart, all in one direction, and scatter by "
            f"{self.noise_um:.3g} um ({self.file}): {where} the station, the target or the machine was displaced, or "
            "drifted. Give the rows behind it a run of their own and say frame: per-run, or measure again"
        )


def repeat_shift(labels: Index, measured: Array, rows: Index, file: str) -> RepeatShift | None:
    """The displacement that repeats show; by the border that explains most of their differences.

    Parameters
    ----------
    labels : (n,) number of the command of each row, in the order of measuring.
    measured : (n, 3) mm.
    rows : (n,) of the file, for the sentence.
    """
    from scipy.stats import f

    order = np.argsort(labels, kind="stable")
    same = labels[order][1:] == labels[order][:-1]
    early, late = order[:-1][same], order[1:][same]
    if len(early) < FEWEST:
        return None
    apart = measured[late] - measured[early]
    borders = np.unique(np.concatenate([early + 1, late]))
    inside = (early < borders[:, None]) & (late >= borders[:, None])
    count = inside.sum(axis=1)
    gain = np.where(count >= FEWEST, np.sum((inside @ apart) ** 2, axis=1) / np.maximum(count, 1), 0.0)
    total, free = float(np.sum(apart**2)), 3 * len(apart) - 3
    alike = gain >= gain.max() - ALIKE * (total - gain.max()) / free  # of these the one that most differences straddle
    best = int(np.lexsort((gain, np.where(alike, count, -1)))[-1])
    most = float(gain[best])
    left = total - most
    straddle = inside[best]
    across = float(np.sum(apart[straddle] ** 2))
    if not most or (across - most) * GAIN > across:
        return None
    if len(borders) * float(f.sf(most / 3 / max(left / free, 1e-30), 3, free)) > CHANCE:
        return None
    after, before = int(early[straddle].max()), int(late[straddle].min())
    size = float(np.linalg.norm(apart[straddle].mean(axis=0)))
    noise = float(np.sqrt(left / free / 2))
    return RepeatShift(file, int(rows[after]), int(rows[before]), 1e3 * size, 1e3 * noise, int(straddle.sum()))
