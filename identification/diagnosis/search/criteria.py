"""Similarity of effects (canonical correlation, common causes) and blocked cross-validation of a linear model."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.channels import root
from errormodel.effects.base import Effect
from identification.diagnosis.linear.linear_model import LinearModel
from identification.estimation.orthonormal_basis import orthonormal_basis


def moves(linear: LinearModel, effect: Effect) -> frozenset[tuple[str, str]]:
    """Elements and motions that an effect moves."""
    known = {} if linear.lineage is None else linear.lineage.known.moves
    if effect not in known:
        known[effect] = frozenset((t.element, m) for t in linear.terms([effect]) for m in t.motion)
    return known[effect]


def canonical_correlation(linear: LinearModel, one: Array, other: Array) -> float:
    """Largest canonical correlation of two effects' columns (k, N), the geometry taken out of both."""
    bases = []
    for columns in (one, other):
        left = linear.project(columns)
        norms = np.linalg.norm(left, axis=1)
        keep = norms > 1e-2 * np.linalg.norm(columns, axis=1)
        if not keep.any():
            return 0.0
        bases.append(orthonormal_basis((left[keep] / norms[keep, None]).T))
    return float(np.linalg.svd(bases[0].T @ bases[1], compute_uv=False)[0])


def base_channels(effect: Effect) -> frozenset[str]:
    """Recorded channels behind an effect's drivers: of ``lag(T_bed,600)``, ``T_bed``.

    All temperatures, and time, count as one cause: "temperature". The time of an event is none: it is not heat.
    """
    event = getattr(effect, "at", None) is not None
    return frozenset(
        "temperature" if n.startswith("T_") or (n == "time" and not event) else n for n in map(root, effect.drivers)
    )


def one_sensor(one: Effect, other: Effect) -> bool:
    """Whether one temperature drives both effects: one source of heat is one cause."""
    both = set(map(root, one.drivers)) & set(map(root, other.drivers))
    return any(n.startswith("T_") for n in both)


def log_likelihood_gain(linear: LinearModel, delta_chi2: float) -> float:
    """Gain in log likelihood of what decreases the residual sum of squares by so many noise variances."""
    return float(log_likelihood_gains(linear, np.array([delta_chi2]))[0])


def log_likelihood_gains(linear: LinearModel, delta_chi2: Array) -> Array:
    """The same of several."""
    share = np.clip(delta_chi2 / max(linear.freedom, 1), 0.0, 1 - 1e-12)
    return np.asarray(-linear.freedom / 2 * np.log1p(-share))


def heldout_rms(linear: LinearModel) -> float:
    """Root mean square of the cross-validation residuals, in units of the noise."""
    return linear.answer(lambda: float(np.sqrt(np.mean(cross_validation_residuals(linear) ** 2))), (), "held out")


def predictive_deviation(linear: LinearModel) -> float:
    """Standard deviation of noise, in units of the model's, that the predictive density of rows left out comes to.

    Blocks of consecutive rows are each predicted without them, with the covariance that the parameters then have:
    what only weak directions of the geometry predict badly weighs as little as it is known. See A. Vehtari, A. Gelman,
    J. Gabry, Practical Bayesian model evaluation using leave-one-out cross-validation, Statistics and Computing 2017.
    """
    return linear.answer(lambda: _predictive_deviation(linear), (), "predictive density")


def _predictive_deviation(linear: LinearModel, blocks: int = 12) -> float:
    """With an orthonormal basis Q a block's residual r, left out, has the covariance ``(I - Q_b Q_b')^-1``.

    So its quadratic form is ``r' (I - Q_b Q_b')^-1 r``; the noise that makes all blocks likeliest is stated, times
    the root of all determinants.
    """
    square, spread, seen = 0.0, 0.0, len(linear.index)
    for _, q, r in _in_blocks(linear, blocks):
        wide = len(q) < q.shape[1]
        kept, vectors = np.linalg.eigh(np.eye(len(q)) - q @ q.T if wide else np.eye(q.shape[1]) - q.T @ q)
        known = kept > 1e-9  # what only this block determines has no part in its residual
        part = vectors[:, known].T @ (r if wide else q.T @ r)
        square += float(np.sum(part**2 / kept[known])) + (0.0 if wide else float(r @ r))
        spread -= float(np.log(kept[known]).sum())
    return float(np.sqrt(square / seen * np.exp(spread / seen)))


def cross_validation_residuals(linear: LinearModel, blocks: int = 12) -> Array:
    """Residuals (N,) of blocks of consecutive rows, each predicted without it, in units of the noise.

    With an orthonormal basis Q, leaving block b out turns its residual r into ``r + Q_b (I - Q_b'Q_b)^-1 Q_b' r``,
    which is ``(I - Q_b Q_b')^-1 r``: the smaller system is solved.
    """
    out = np.empty(len(linear.index))
    for rows, q, r in _in_blocks(linear, blocks):
        # what only this block determines has no part in its residual: a trace of the identity keeps that solvable
        one = 1 + 1e-9
        if len(q) < q.shape[1]:
            out[rows] = np.linalg.solve(np.eye(len(q)) - q @ q.T / one, r)
        else:
            out[rows] = r + q @ np.linalg.solve(one * np.eye(q.shape[1]) - q.T @ q, q.T @ r)
    return out


def _in_blocks(linear: LinearModel, blocks: int) -> Iterator[tuple[Index, Array, Array]]:
    """Observations of each block of consecutive rows, their part of the basis, and their residuals."""
    number = linear.blocks(blocks)
    for b in np.unique(number):
        rows = np.flatnonzero(number == b)
        yield rows, linear.basis[rows], linear.residual[rows]
