"""Where the rows of a survey begin a line after another one: lines of targets, diagonals, the rows of a grid.

A joint that overruns the end of a line comes to the first target of the next one along that line (ISO 230-2), which
the order of the rows does not show.
"""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.path_steps import RUNS_ON, PathSteps


def line_starts(position: Array, series: Index) -> Array:
    """Sign of every joint's first move along the line that a row begins (n, joints); 0 in all other rows.

    Of targets that end one line and begin another, and are read there twice as often as elsewhere, the later half of
    the readings begins the new line.

    Parameters
    ----------
    position : commanded positions (n, joints), mm and rad, in the order in which they were reached.
    series : number of the series of rows (n,) that each belongs to; from one to another there is no step.
    """
    path = PathSteps.of(position, series)
    place, counts = path.place, path.after - path.first
    straight = path.cosine > RUNS_ON  # through each place
    corner = ~straight & path.directions[:-1].any(axis=1) & path.directions[1:].any(axis=1)
    begins, ends = corner & np.append(straight[1:], False), corner & np.append(False, straight[:-1])
    usual = float(np.median(counts[straight])) if straight.any() else np.inf
    halved = begins & ends & (counts >= 2 * usual)
    later = np.arange(len(position)) - path.first[place] >= counts[place] // 2
    new = (begins & ~ends)[place] | (halved[place] & later)
    return np.asarray(np.where(new[:, None], np.sign(path.steps[1:])[place], 0.0))
