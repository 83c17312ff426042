"""Resamples of a residual under the null that it is noise: what a statistic of the residual is compared with.

Circular shifts along the rows keep its autocorrelation, random signs of short blocks keep where its variance is large
(wild bootstrap). Each is projected as the fit would leave it.
"""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array, Mask
from identification.diagnosis.linear.linear_model import LinearModel
from identification.estimation.orthonormal_basis import orthonormal_basis

FEWEST_ROWS, MOST_ROWS = 40, 800  # rows below which nothing is tested, and above which they are thinned out
QUICK_RESAMPLES = 39  # of each kind, from which the tail beyond is extrapolated
ENDS = 0.04  # of the rows: circular shifts by less leave the residual where it was
SIGN_BLOCK_ROWS = 4  # rows that share a random sign
CLIP = 3.0  # robust standard deviations: no single row decides


def thinned(linear: LinearModel) -> tuple[Mask, Array, Array] | None:
    """Which observations are tested, those of at most `MOST_ROWS` rows; the residual and an orthonormal basis there.

    None where there are too few.
    """
    index = linear.index
    rows = np.unique(index)
    if len(rows) < FEWEST_ROWS or linear.exact:
        return None
    keep = np.isin(index, rows[np.linspace(0, len(rows) - 1, min(len(rows), MOST_ROWS)).astype(int)])
    residual, basis = (a[: len(index)][keep] for a in (linear.residual, linear.basis))
    norms = np.linalg.norm(basis, axis=0)
    basis = orthonormal_basis(basis[:, norms > 0] / norms[norms > 0])  # over the rows that are kept
    return None if len(residual) - basis.shape[1] < FEWEST_ROWS else (keep, residual, basis)


def clipped(residual: Array, q: Array) -> Array | None:
    """The residual (N,) in robust standard deviations, clipped, less what the fit spans (N, r); None: it is nothing."""
    scale = robust_scale(residual)
    if scale <= 0:
        return None
    out = np.clip(residual / scale, -CLIP, CLIP)
    return np.asarray(out - q @ (q.T @ out))


def robust_scale(residual: Array) -> float:
    """Standard deviation of normal deviates about zero with the same median size."""
    return float(np.median(np.abs(residual))) / 0.6745


def left(resamples: Array, q: Array, square: float) -> Array:
    """Resamples (N, r) as the fit would leave them, each with the given sum of squares."""
    left = resamples - q @ (q.T @ resamples)
    return np.asarray(left * np.sqrt(square) / np.linalg.norm(left, axis=0))


def shifted(residual: Array, series: list[slice], number: int) -> Array:
    """Circular shifts (N, r) of all series by the same share of their length."""
    longest = max(s.stop - s.start for s in series)
    steps = np.unique(np.linspace(ENDS * longest, (1 - ENDS) * longest, number).astype(int))
    out = np.empty((len(residual), len(steps)))
    for s in series:
        count = s.stop - s.start
        rows = (np.arange(count)[:, None] - np.round(steps * count / longest).astype(int)) % count
        out[s] = residual[s][rows]
    return out


def signed(residual: Array, series: list[slice], number: int) -> Array:
    """The residual (N, r) with random signs of blocks of rows, the same for all series."""
    blocks = max(max(s.stop - s.start for s in series) // SIGN_BLOCK_ROWS, 10)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(blocks, number))
    out = np.empty((len(residual), number))
    for s in series:
        count = s.stop - s.start
        out[s] = residual[s, None] * signs[np.arange(count) * blocks // count]
    return out


def gumbel(value: float, null: Array) -> float:
    """Probability of at least `value` by the Gumbel law that has mean and variance of the `null` values."""
    scale = float(null.std(ddof=1)) * np.sqrt(6) / np.pi
    return float(-np.expm1(-np.exp(-(value - float(null.mean())) / scale - np.euler_gamma)))
