"""Orthogonal triangularisation of a design by blocks of rows, which normal equations would lose digits of.

N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2002, chapter 20.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.kernel import KERNEL_BLOCK_ROWS
from identification.observation.models import Kind, View
from identification.observation.normal_equations import RANK_SAMPLE_ROWS, design_rows, view_vector

HELD_ENTRIES = 4_000_000  # of M, dense: limits the memory


def triangular_factor(
    views: Sequence[View],
    place: Mapping[str, int],
    sigma: Mapping[Kind, float],
    base: Index,
    above: Array,
    held: Array,
    at: Array | None = None,
) -> Array:
    """Triangular factor of some columns over all rows, each over its noise, and of what stands above.

    Parameters
    ----------
    place : unknown -> its column; `base`: the columns.
    sigma : noise level of each kind of observation.
    above : rows (k, columns), or (k, columns + 1) with `at`.
    at : values of the unknowns, with whose readings as the last column; `held`: values of what is no unknown.
    """
    factor = above
    for view in views:
        if at is not None:
            gap = np.hstack([view.whiten(part, g) for part, g in view.gaps(view_vector(view, place, at, held))])
        size = max(RANK_SAMPLE_ROWS, min(KERNEL_BLOCK_ROWS, HELD_ENTRIES // (len(view.outputs) * len(base) + 1)))
        for part in (slice(start, start + size) for start in range(0, len(view), size)):
            rows = design_rows(view.part(part), place, size)[:, base]
            rows = np.column_stack([rows, gap[:, part].ravel()]) if at is not None else rows
            rows /= sigma[view.kind]
            factor = np.asarray(np.linalg.qr(np.vstack([factor, rows]), mode="r"))
    return factor
