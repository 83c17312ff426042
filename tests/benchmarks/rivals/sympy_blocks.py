"""SymPy's printed NumPy code evaluated in blocks of poses that fit the cache: what a user who profiles would write.

All 52 columns, as (3, 52, n).
"""

from __future__ import annotations

import numpy as np

from tests.benchmarks.five_axis import Array
from tests.benchmarks.rivals.sympy_rival import FUNCTION, IDS, PLACES, as_design

__all__ = ["IDS", "as_design", "build"]

BLOCK = 4096


def build(q: Array) -> Array:
    M = np.zeros((3, len(IDS), len(q)))
    for start in range(0, len(q), BLOCK):
        part = slice(start, start + BLOCK)
        for (r, c), value in zip(PLACES, FUNCTION(*np.ascontiguousarray(q[part].T)), strict=True):
            M[r, c, part] = value
    return M
