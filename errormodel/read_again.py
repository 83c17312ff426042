"""Readings that follow one another at one place of a survey, as where each target is approached from both sides."""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array, Index, Mask
from errormodel.line_starts import line_starts
from errormodel.path_steps import STANDS, PathSteps


def read_again(position: Array, tool: Array, joint: int, series: Index) -> list[tuple[Mask, Mask]]:
    """Rows that may be readings from the other side: in a pilgrim step (ISO 230-2) the order of rows does not show it.

    A target is approached from one side, overrun, and approached from the other side. Of its readings the later half
    is from the other side, or every second one, where the joint moves along the line of the targets.

    Parameters
    ----------
    position : commanded positions (n, joints), mm and rad, in the order in which they were reached.
    tool : offsets of the tool (n, k): another tool makes another target.
    joint : which of the joints.
    series : number of the series of rows (n,) that each belongs to.

    Returns
    -------
    Distinct masks (n,) of such rows, each with all the rows of these targets, which have an even number of readings.
    """
    other = np.append(False, (np.abs(np.diff(tool, axis=0)) > STANDS).any(axis=1))
    path = PathSteps.of(position, series + (series.max(initial=0) + 1) * np.cumsum(other))
    place, counts = path.place, (path.after - path.first)[path.place]
    nth = np.arange(len(position)) - path.first[place]
    begins, step = line_starts(position, series), np.abs(path.steps[:, joint]) > STANDS
    leads, leaves = step[:-1], step[1:]
    came = np.where(np.append(False, path.joined), leads, leaves)[place]
    even = (counts % 2 == 0) & np.where(begins.any(axis=1), begins[:, joint] != 0, came)
    rows = [again & even for again in (nth >= counts // 2, nth % 2 == 1)]
    return [(r, even) for r in rows[: 1 if (rows[0] == rows[1]).all() else 2] if r.any()]
