"""Other orders in which readings fit their commands as well: of a symmetric plan, points cannot prove their order.

A rigid motion that maps a plan onto itself in another order (a serpentine, which is turned as it runs backwards; a
circle of equal steps) brings readings of that order into place. Errors of the machine then come out with other signs,
and the misfit stays the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from errormodel.arrays import Array, Index
from identification.diagnosis.data_checks.blunder import Points
from identification.importing.exchanged_rows import FEWEST_PROVED

CLEAR = 3.0  # times the misfit as they stand: an order that fits less well than that is another order; by judgement
MOST_SHIFTED = 1000  # rows, of which every cyclic shift is tried
SAME = 1e-3  # mm: commands at one place
FLAT = 1e-3  # of the widest extent: so thin do points lie in a plane


@dataclass(frozen=True)
class OtherOrder:
    """Another order that fits as well: in words, and the misfits (rms, um) as the readings stand and in it."""

    words: str
    before_um: float
    after_um: float
    others: int  # further orders that fit as well

    @property
    def text(self) -> str:
        """What it means for the results, as a sentence."""
        more = f", and so do {self.others} more" if self.others else ""
        return (
            f"the readings {self.words} fit as well ({self.after_um:.3g} um rms, as they stand {self.before_um:.3g} "
            f"um{more}): the plan is symmetric, so that the points do not prove their order, and signs of squareness "
            "and straightness depend on it"
        )


CURE = "Give the points names, measure a pose off the pattern, or confirm the order with --match order"


def other_order(files: list[Points]) -> OtherOrder | None:
    """The best of the orders that fit as well as the one at hand: reversed, cyclically shifted, or both.

    Parameters
    ----------
    files : points of the files that share a measuring frame, in the order of their rows. Several files are reversed
        one by one and all together; one alone is also shifted.
    """
    nominal, measured = np.vstack([f.nominal for f in files]), np.vstack([f.measured for f in files])
    n = len(nominal)
    if n < FEWEST_PROVED or len(np.unique(np.round(nominal / SAME), axis=0)) < FEWEST_PROVED:
        return None
    tries = [(w, o) for w, o in _orders([len(f) for f in files]) if np.abs(nominal[o] - nominal).max() > SAME]
    if not tries:
        return None
    misfit = _misfits(nominal, measured, np.array([np.arange(n), *(order for _, order in tries)]))
    before, after = misfit[0], misfit[1:]
    tied = np.flatnonzero(after < CLEAR * before)
    if not len(tied):
        return None
    best = tied[0] if tied[0] == 0 else tied[np.argmin(after[tied])]  # a reversal is the likeliest mistake
    return OtherOrder(tries[best][0], 1e3 * float(before), 1e3 * float(after[best]), len(tied) - 1)


def in_a_plane(nominal: Array) -> bool:
    """Whether points (n, 3) lie in a plane: their mirror image is then the same as they, turned over."""
    extent = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(nominal.T)), 0.0))
    return bool(extent[0] < FLAT * extent[2])


def _orders(sizes: list[int]) -> list[tuple[str, Index]]:
    """Rows of the readings that each command would have, in words and as indices."""
    start = np.concatenate([[0], np.cumsum(sizes)])
    rows = np.arange(start[-1])
    if len(sizes) == 1:
        n = sizes[0]
        out = [("in reverse order", rows[::-1])]
        for k in range(1, n if n <= MOST_SHIFTED else 1):
            out += [(f"taken {k} row{'s' * (k > 1)} later, round and round", np.roll(rows, -k))]
            out += [("in reverse order from another row on", np.roll(rows[::-1], -k))]
        return out
    turned = [rows[a:b][::-1] for a, b in pairwise(start)]
    out = [("of each file in reverse order", np.concatenate(turned))]
    for k, part in enumerate(turned):
        one = rows.copy()
        one[start[k] : start[k + 1]] = part
        out.append((f"of file {k + 1} in reverse order", one))
    return out


def _misfits(nominal: Array, measured: Array, orders: Index) -> Array:
    """Root mean square distance (mm) in the best frame of all rows alike (Kabsch), of each order (k, n)."""
    a, b = nominal - nominal.mean(axis=0), measured - measured.mean(axis=0)
    h = np.array([a.T @ b[order] for order in orders])
    s = np.linalg.svd(h, compute_uv=False)
    s[:, 2] *= np.where(np.linalg.det(h) < 0, -1.0, 1.0)
    left = np.sum(a**2) + np.sum(b**2) - 2 * s.sum(axis=1)
    return np.asarray(np.sqrt(np.maximum(left, 0.0) / len(a)))
