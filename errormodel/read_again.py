"""Readings that follow one another at one place of a survey, as where each target is approached from both sides."""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array, Index, Mask
from errormodel.line_starts import line_starts
from errormodel.path_steps import STANDS, PathSteps


def read_again(position: Array, tool: Array, joint: int, series: Index) -> list[tuple[Mask, Mask]]:
    """Rows that may be readings from the other side: in a pilgrim step (ISO 230-2) the order of rows does not show it.

    A target is approached from one side, overrun, and approached from the other side. Its readings are from one side
    and then from the other, alternate, or are in the order ABBA, which takes a drift out; and the next target begins
    with the same side, or with that with which this one ended.

    Parameters
    ----------
    position : commanded positions (n, joints), mm and rad, in the order in which they were reached.
    tool : offsets of the tool (n, k): another tool makes another target.
    joint : which of the joints.
    series : number of the series of rows (n,) that each belongs to.

    Returns
    -------
    Distinct masks (n,) of such rows, each with all the rows of these targets, which are on lines along which the joint
    moves, and are read equally often.
    """
    other = np.append(False, (np.abs(np.diff(tool, axis=0)) > STANDS).any(axis=1))
    path = PathSteps.of(position, series + (series.max(initial=0) + 1) * np.cumsum(other))
    place, counts = path.place, (path.after - path.first)[path.place]
    nth = np.arange(len(position)) - path.first[place]
    begins, step = line_starts(position, series), np.abs(path.steps[:, joint]) > STANDS
    leads, leaves = step[:-1], step[1:]
    came = np.where(np.append(False, path.joined), leads, leaves)[place]
    on_line = np.where(begins.any(axis=1), begins[:, joint] != 0, came) & (counts > 1)
    first = on_line & (nth == 0)  # a line may begin with a later reading of its first target
    if not first.any():
        return []
    usual = int(np.bincount(counts[first]).argmax())
    seen = on_line & (counts == usual)
    odd = np.cumsum(seen & (nth == 0)) % 2 == 0
    orders = [nth >= k for k in range(1, usual)] + [nth % 2 == 1, np.isin(nth % 4, (1, 2))]
    masks = [seen & turned for own in orders for turned in (own, own ^ odd)]
    return [(m, seen) for k, m in enumerate(masks) if m.any() and not any((m == other).all() for other in masks[:k])]
