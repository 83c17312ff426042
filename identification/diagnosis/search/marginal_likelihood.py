"""Log Bayes factors of effects, with priors of physical size, from products of the columns that a linear model leaves.

The marginal likelihood of a linear-Gaussian model in closed form (C. M. Bishop, Pattern Recognition and Machine
Learning, 2006, section 3.5).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from errormodel.arrays import Array, Mask
from identification.diagnosis.decisions.constants import ABSORBED, FORM_ABSORBED, SIZES
from identification.diagnosis.linear.random_effects import scores_of

Scored = tuple[Array, Array, Array, Array]  # evidence, delta chi2, absorbed part and expected delta chi2 of proposals
ROUNDED = 1e-10  # of the largest of squares: as much is rounding
SWEEPS = 3  # over the sizes of effects
LEAST_LEFT = 1e-12  # of the residual sum of squares: what readings without noise leave, to divide by


class Left(Protocol):
    """What a linear model leaves: the residual sum of squares, and its degrees of freedom."""

    @property
    def square(self) -> float: ...

    @property
    def freedom(self) -> int: ...


def free_scores(noise: Left, gram: Array, slope: Array, square: Array, empirical: Mask) -> Scored:
    """Scores of proposals with fixed effects and the same number of parameters.

    The prior of a physical effect is a mixture over `SIZES` times its usual size, as machines are small and large. An
    empirical term has no usual size: its scale maximises the evidence, and 1 is subtracted for that choice.

    Parameters
    ----------
    gram, slope : products (m, k, k) of the projected columns with each other, and (m, k) with the residual.
    square : (m, k) the columns' own lengths squared; of a temperature's, as it changes (`Effect.changing`).
    """
    norm = np.sqrt(np.where(square > 0, square, 1.0))  # what moves nothing is not seen
    unit = gram / norm[:, :, None] / norm[:, None, :]
    values, vectors = np.linalg.eigh(unit) if unit.shape[1] > 1 else (unit[:, 0], np.ones_like(unit))
    seen = values > 1 - np.where(empirical, FORM_ABSORBED, ABSORBED)[:, None]
    t = np.einsum("aij,ai->aj", vectors, slope / norm)
    variance = noise.square / noise.freedom
    # directions of the scaled columns have prior sizes of their own: those of the columns, taken along them
    prior = np.einsum("aij,ai->aj", np.square(vectors), np.square(norm))
    expected_delta_chi2 = np.sum(np.maximum(values, 0.0) / variance * prior, axis=1)
    gain = np.where(seen, values / variance * prior, 0.0)
    count = np.maximum(seen.sum(axis=1), 1)
    safe = np.where(seen, values, 1.0)
    delta_chi2 = np.where(seen, t**2 / safe, 0.0) / variance
    fitting = np.maximum(delta_chi2.sum(axis=1) / count, 1.0) - 1.0
    gain = np.where(empirical[:, None], np.where(seen, fitting[:, None], 0.0), gain) / _left(noise, delta_chi2)[:, None]
    by_size = np.array(
        [_log_evidence(noise, delta_chi2, np.where(empirical[:, None], gain, gain * s**2)) for s in SIZES]
    )
    evidence = log_sum(by_size, np.array([*SIZES.values()])[:, None]) - empirical
    absorbed = 1 - np.where(seen.any(axis=1), values.mean(axis=1), values.max(axis=1))
    return (
        np.where(seen.any(axis=1), evidence, -np.inf),
        delta_chi2.sum(axis=1),
        np.clip(absorbed, 0.0, 1.0),
        expected_delta_chi2,
    )


def joint_evidence(noise: Left, gram: Array, slope: Array, counts: Sequence[int]) -> float:
    """Log Bayes factor of the parameters of several effects together, each of which may be large or small by itself.

    The sum over the `SIZES` of all is taken about the likeliest, one effect at a time. What is left of each is alike
    where they are two lags of one sensor, so that no direction is taken to be hidden.

    Parameters
    ----------
    gram, slope : products (k, k) of the projected columns, times their usual sizes, and (k,) with the residual.
    counts : parameters of each effect, in their order.
    """
    values, vectors = np.linalg.eigh(gram)
    seen = values > ROUNDED * values[-1]
    variance = noise.square / noise.freedom
    delta_chi2 = np.square(vectors[:, seen].T @ slope)[None] / values[seen] / variance
    ridge = variance * float(_left(noise, delta_chi2)[0])
    sizes, weights = np.array([*SIZES]), np.log([*SIZES.values()])
    owner, likeliest = np.repeat(np.arange(len(counts)), counts), np.ones(len(counts))
    # readings without noise leave columns that are alike to rounding
    definite = gram + np.diag(ROUNDED * np.diag(gram))

    def of_sizes(k: int) -> Array:
        """Evidence for each size of one effect, beside the likeliest of the others."""
        tried = np.tile(likeliest, (len(sizes), 1))
        tried[:, k] = sizes
        scale = tried[:, owner]
        scaled = definite * scale[:, :, None] * scale[:, None, :] + ridge * np.eye(len(gram))
        factors = np.linalg.cholesky(scaled)
        along = np.linalg.solve(factors, (scale * slope)[..., None])[..., 0]
        kept = np.square(along).sum(axis=1) / variance / noise.freedom
        determinants = 2 * np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1) - len(gram) * np.log(ridge)
        left = np.log1p(-np.minimum(kept, 1 - LEAST_LEFT))
        return np.asarray(-noise.freedom / 2 * left - 0.5 * determinants + weights)

    logs = list[Array]()
    for _ in range(SWEEPS):
        before, logs = likeliest.copy(), []
        for k in range(len(counts)):
            logs.append(of_sizes(k))
            likeliest[k] = sizes[np.argmax(logs[k])]
        if (likeliest == before).all():
            break
    best = float(logs[-1].max()) + sum(float(weights[sizes == size][0]) for size in likeliest[:-1])
    return best + float(sum(log_sum(own - own.max(), np.ones(len(sizes))) for own in logs))


def random_scores(noise: Left, gram: Array, slope: Array, square: Array) -> Scored:
    """Scores of proposals whose parameters are random effects; their usual size is not known."""
    evidence, variance, absorbed = scores_of(gram, slope, square.sum(axis=1), noise.square, noise.freedom)
    explained = noise.freedom * (1 - variance * noise.freedom / noise.square)
    return evidence, explained, absorbed, np.full(len(gram), np.inf)


def log_sum(logs: Array, weights: Array) -> Array:
    """Logarithms (...) of the weighted sums, along the first axis, of what has these logarithms (n, ...).

    They are those of ``scipy.special.logsumexp``, which takes six times as long for so few numbers.
    """
    largest = logs.max(axis=0)
    most = logs == largest
    with np.errstate(invalid="ignore"):  # where all logarithms are infinite
        rest = np.where(most, 0.0, weights * np.exp(logs - largest)).sum(axis=0)
    first = (weights * most).sum(axis=0)
    return np.asarray(np.log1p(rest / first) + np.log(first) + largest)


def _left(noise: Left, delta_chi2: Array) -> Array:
    """Share (m,) of the noise's variance that is left beside proposals (m, k), with which their prior sizes compare.

    What an effect explains is no noise: beside that of the model without it, a large effect of usual size would count
    as one of an unusual size.
    """
    return np.asarray(1 - np.minimum(delta_chi2.sum(axis=1) / noise.freedom, 1 - LEAST_LEFT))


def _log_evidence(noise: Left, delta_chi2: Array, gain: Array) -> Array:
    """Evidence (m,) of independent directions (m, k) with prior variances of `gain` times those of their estimates."""
    kept = (delta_chi2 * gain / (1 + gain)).sum(axis=1)
    left = np.log1p(-np.minimum(kept / noise.freedom, 1 - LEAST_LEFT))
    return np.asarray(-noise.freedom / 2 * left - 0.5 * np.log1p(gain).sum(axis=1))
