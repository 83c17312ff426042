"""Grids of positions, hat functions on them, and multilinear interpolation with constant values beyond the ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Index

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

NICE_STEPS = (1.0, 2.0, 2.5, 5.0)  # steps of a grid times a power of ten, so that positions have few digits
# numbers of intervals of a full turn in degrees whose step has at most four decimals
TURN_INTERVALS = tuple(n for n in range(2, 1441, 2) if (360 * 10**4) % n == 0)


def nice_step(least: float) -> float:
    """Smallest of 1, 2, 2.5, 5 times a power of ten that is not below `least`."""
    power = 10.0 ** np.floor(np.log10(least))
    steps = [m * p for p in (power, 10 * power) for m in NICE_STEPS]
    return float(round(next(s for s in steps if s >= least * (1 - 1e-9)), 9))


def anchored_grid(low: float, high: float, intervals: int) -> tuple[float, ...]:
    """Integer multiples of a round step that cover [low, high] in at most `intervals` intervals (2 at least)."""
    step = nice_step(max(high - low, 1e-3) / intervals)
    while True:
        first, last = np.floor(low / step + 1e-10), np.ceil(high / step - 1e-10)
        if last - first <= max(intervals, 2):
            return tuple(float(round(k * step, 9)) for k in range(int(first), int(max(last, first + 1)) + 1))
        step = nice_step(step * 1.01)


def even_grid(low: float, high: float, intervals: int) -> tuple[float, ...]:
    """Equidistant positions that just cover [low, high] in `intervals` intervals; start and step have few digits.

    Decimal digits are used, so that a file holds start, end and step without rounding.
    """
    span = max(high - low, 1e-3)
    figures = int(max(np.floor(np.log10(span / (100 * intervals))), -4))
    unit = 10.0**figures
    first = np.floor(low / unit + 1e-10)
    step = max(np.ceil((high / unit - first) / intervals - 1e-10), 1.0)
    return tuple(float(round((first + k * step) * unit, max(-figures, 0))) for k in range(intervals + 1))


def turn_grid(low: float, intervals: int, anchored: bool = False) -> tuple[float, ...]:
    """Positions (deg) from `low` round to the same place again, in steps of few digits.

    In the least even number of intervals that is not below `intervals`, so that a grid from -180 has one at 0;
    `anchored` ones are multiples of their step wherever they start, and none where no step is.
    """
    least = min(intervals, TURN_INTERVALS[-1])
    counts = (n for n in TURN_INTERVALS if n >= least)
    count = next((n for n in counts if not anchored or abs(low * n / 360 - round(low * n / 360)) < 1e-9), 0)
    return spaced(low, 360.0 / count, count + 1) if count else ()


def spaced(low: float, step: float, count: int) -> tuple[float, ...]:
    """Equidistant positions as stated in a file."""
    return tuple(float(round(low + k * step, 9)) for k in range(count))


def nodes(grids: Sequence[Sequence[float]]) -> Array:
    """All nodes of a lattice, (n, axes), the last axis fastest."""
    return np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, len(grids))


def locate(grid: Sequence[float], q: Array) -> tuple[Index, Array]:
    """Interval (n,) of each position and the weight of its upper end (n,), clipped to [0, 1]."""
    g = np.asarray(grid)
    if len(g) == 1:
        return np.zeros(len(q), dtype=np.intp), np.zeros(len(q))
    k = np.clip(np.searchsorted(g, q, side="right") - 1, 0, len(g) - 2)
    return k, np.clip((q - g[k]) / (g[k + 1] - g[k]), 0.0, 1.0)


def corners(grids: Sequence[Sequence[float]], q: Array) -> tuple[Index, Array]:
    """Nodes (n, 2^axes) about positions q (n, axes), and their weights in multilinear interpolation.

    Numbers of nodes count with the last grid fastest; on a grid of one position both ends are the same node.
    """
    column, weight = np.zeros((len(q), 1), dtype=np.intp), np.ones((len(q), 1))
    for axis, grid in enumerate(grids):
        k, share = locate(grid, q[:, axis])
        upper = np.minimum(k + 1, len(grid) - 1)
        column = np.concatenate([column * len(grid) + k[:, None], column * len(grid) + upper[:, None]], axis=1)
        weight = np.concatenate([weight * (1 - share)[:, None], weight * share[:, None]], axis=1)
    return column, weight


def sparse(column: Index, weight: Array, size: int) -> csr_matrix:
    """Matrix (n, size) of weights (n, k) in columns (n, k)."""
    from scipy.sparse import csr_matrix

    rows = np.repeat(np.arange(len(column)), column.shape[1])
    return csr_matrix((weight.ravel(), (rows, column.ravel())), shape=(len(column), size))


def hats(grids: Sequence[Sequence[float]], q: Array) -> csr_matrix:
    """Weights (n, nodes) of multilinear interpolation at q (n, len(grids)); the last grid varies fastest."""
    return sparse(*corners(grids, q), math.prod(len(g) for g in grids))
