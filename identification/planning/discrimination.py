"""Exchange of poses to distinguish effects by T-optimality (A. C. Atkinson & V. V. Fedorov, Biometrika 62 (1975) 57).

For a pair of effects, T is the residual of one effect after geometry, measuring frame and the other effect are fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index
from identification.planning.design import Design, Space

LEAST_D_EFFICIENCY = 0.9  # D-efficiency relative to the given design that exchanges must keep, by judgement
MOST_SWAPS = 20  # exchanges of one pose
SWAP_POSES_TRIED = 24  # poses tried in one exchange, those with the smallest loss of determinant: limits the time


@dataclass(frozen=True)
class Pair:
    """Whitened columns (n, c, k) of two effects at all candidates; `shown` is to be distinguished from `beside`."""

    shown: Array
    beside: Array


def told_apart(space: Space, chosen: Index, pairs: Sequence[Pair], correlation: float) -> Index:
    """Exchange poses until all pairs correlate less than `correlation`, or D-efficiency falls to `LEAST_D_EFFICIENCY`.

    The pair closest to the limit comes first; a pair that no exchange improves is given up.

    Parameters
    ----------
    chosen : indices of the candidates in the design.
    pairs : effects to distinguish.
    correlation : largest correlation of the effects' columns, geometry and frame eliminated.

    Returns
    -------
    Index
        The design after the exchanges.
    """
    design = Design(space, chosen)
    floor = design.value - np.log(LEAST_D_EFFICIENCY) * space.rank  # of log det C
    goal = float(np.log(1 - correlation**2))
    open_ = [
        (_extended(space.X, p.shown), _extended(space.X, p.beside), _extended(space.X, p.beside, p.shown))
        for p in pairs
    ]
    for _ in range(MOST_SWAPS):
        left = [_left(space, design.chosen, *own) for own in open_]
        near = [k for k in range(len(open_)) if left[k] < goal]
        if not near:
            break
        k = max(near, key=lambda k: left[k])
        beside, both = (Design(s, design.chosen) for s in open_[k][1:])
        chosen = _swapped(design, beside, both, floor)
        if _left(space, chosen, *open_[k]) > left[k] + 0.01:
            design = Design(space, chosen)
        else:
            del open_[k]
    return design.chosen


def _left(base: Space, chosen: Index, shown: Space, beside: Space, both: Space) -> float:
    """Logarithm of the share of an effect, geometry eliminated, that the other effect does not explain."""
    alone = shown.log_det(chosen) - base.log_det(chosen)
    return both.log_det(chosen) - beside.log_det(chosen) - alone


def _swapped(base: Design, beside: Design, both: Design, floor: float) -> Index:
    """The design after the exchange of one pose that raises T most."""
    best, chosen = 0.0, base.chosen
    for k in base.least()[:SWAP_POSES_TRIED].tolist():
        i = base.chosen[k]
        kept = base.gains(i)
        gain = both.gains(i) - beside.gains(i)
        gain = np.where(base.value - (kept - kept[i]) <= floor, gain - gain[i], -np.inf)
        j = int(np.argmax(gain))
        if gain[j] > best:
            best, chosen = float(gain[j]), base.chosen.copy()
            chosen[k] = j
    return chosen


def _extended(X: Array, *more: Array) -> Space:
    """The design problem with further columns, each of unit norm over all candidates."""
    columns = [c / np.maximum(np.sqrt(np.square(c).sum(axis=(0, 1))), 1e-300) for c in more]
    return Space(np.concatenate([X, *columns], axis=2), np.zeros((0, 3, X.shape[2] + sum(c.shape[2] for c in more))))
