"""Evidence of several effects together: that of the linear-Gaussian model, also where two of them are nearly alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest
from scipy.special import logsumexp

from errormodel.arrays import Array
from identification.diagnosis.decisions.constants import SIZES
from identification.diagnosis.search.marginal_likelihood import free_scores, joint_evidence, log_sum


@dataclass(frozen=True)
class Noise:
    """The residual sum of squares of a linear model, and its degrees of freedom."""

    square: float
    freedom: int


def directly(columns: Array, residual: Array, counts: Sequence[int]) -> float:
    """The same by dense matrices: log of the mean likelihood ratio of normal priors of all sizes of each effect."""
    n, k = columns.shape
    beside = residual - columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]
    variance = beside @ beside / n  # the noise: what an effect explains is none
    noise = residual @ residual / n
    ratios = []
    for each in product(SIZES.items(), repeat=len(counts)):
        sizes, weights = zip(*each, strict=True)
        scaled = columns * np.repeat(sizes, counts)
        whole = np.eye(k) + scaled.T @ scaled / variance
        kept = (scaled.T @ residual) @ np.linalg.solve(whole, scaled.T @ residual) / variance / noise
        ratios.append(np.prod(weights) * np.exp(-n / 2 * np.log1p(-kept / n) - np.linalg.slogdet(whole)[1] / 2))
    return float(np.log(sum(ratios)))


@pytest.mark.parametrize("apart", [1.0, 0.03, 1e-3])
def test_it_is_that_of_the_linear_model(apart: float) -> None:
    rng = np.random.default_rng(3)
    one, other = rng.normal(size=(2, 300))
    columns = 0.3 * np.column_stack([one, one + apart * other])
    residual = columns @ [1.2, -0.7] + rng.normal(size=300)
    noise = Noise(float(residual @ residual), 300)
    found = joint_evidence(noise, columns.T @ columns, columns.T @ residual, [2])
    assert found == pytest.approx(directly(columns, residual, [2]), rel=1e-6)


@pytest.mark.parametrize("values", [(0.5, -0.4, 8.0), (0.1, 0.1, 0.2), (3.0, 2.0, 0.02)])
def test_each_effect_may_be_large_or_small_by_itself(values: tuple[float, float, float]) -> None:
    """Two effects, of two parameters and of one: the sum over all pairs of sizes, nearly."""
    rng = np.random.default_rng(4)
    columns = rng.normal(size=(200, 3)) * [0.3, 0.3, 0.4]
    residual = columns @ values + rng.normal(size=200)
    noise = Noise(float(residual @ residual), 200)
    found = joint_evidence(noise, columns.T @ columns, columns.T @ residual, [2, 1])
    assert found == pytest.approx(directly(columns, residual, [2, 1]), abs=0.1)


def integrated(columns: Array, residual: Array) -> float:
    """With prior sizes in mm, and the noise integrated over its logarithm: log of the mean ratio of densities."""
    n = len(residual)
    log_noise = np.linspace(-8, 12, 20001)
    noise, square = np.exp(2 * log_noise), residual @ residual
    values, vectors = np.linalg.eigh(columns.T @ columns)
    along = np.square(vectors.T @ columns.T @ residual)

    def log_density(size: float) -> float:
        gain = size**2 * values[:, None] / noise
        kept = np.sum(size**2 * along[:, None] / noise / (1 + gain), axis=0)
        return float(logsumexp(-n * log_noise - 0.5 * np.log1p(gain).sum(axis=0) - 0.5 * (square - kept) / noise))

    ratios = [log_density(size) - log_density(0.0) for size in SIZES]
    return float(logsumexp(ratios, b=[*SIZES.values()]))


@pytest.mark.parametrize("size", [0.0, 0.3, 1.0, 3.0, 10.0, 30.0])
@pytest.mark.parametrize("count", [1, 4])
def test_a_size_is_one_of_the_effect_and_none_of_the_noise(size: float, count: int) -> None:
    """Also of thirty times what is usual, beside which the noise is nothing: within a nat of hundreds."""
    rng = np.random.default_rng(1)
    columns = 0.3 * rng.normal(size=(300, count))
    residual = columns @ (size * rng.choice([-1.0, 1.0], count)) + rng.normal(size=300)
    noise = Noise(float(residual @ residual), 300)
    found = joint_evidence(noise, columns.T @ columns, columns.T @ residual, [count])
    assert found == pytest.approx(integrated(columns, residual), abs=1.0)


def test_what_distinguishes_two_lags_counts_though_it_is_little() -> None:
    """Of two lags of one sensor less than a thousandth is left of their difference, which the noise lets be seen."""
    rng = np.random.default_rng(5)
    one, other = rng.normal(size=(2, 2000))
    columns = 50.0 * np.column_stack([one, one + 0.03 * other])
    residual = columns @ [-1.6, 1.7] + rng.normal(size=2000)
    noise = Noise(float(residual @ residual), 2000)
    both = joint_evidence(noise, columns.T @ columns, columns.T @ residual, [1, 1])
    alone = joint_evidence(noise, columns[:, :1].T @ columns[:, :1], columns[:, :1].T @ residual, [1])
    assert both > alone + 100


def test_sums_of_logarithms_are_those_of_scipy() -> None:
    """To the last byte: also of logarithms that are equal, or all minus infinity."""
    rng = np.random.default_rng(2)
    logs, weights = rng.normal(0, 30, (5, 40)), rng.dirichlet(np.ones(5))[:, None]
    logs[0, :8], logs[:, 8], logs[:2, 9] = -np.inf, -np.inf, logs[:, 9].max() + 1
    np.testing.assert_array_equal(log_sum(logs, weights), logsumexp(logs, axis=0, b=weights))
    assert log_sum(logs[:, 20], weights[:, 0]) == logsumexp(logs[:, 20], b=weights[:, 0])


def test_what_moves_nothing_has_no_evidence() -> None:
    """The difference of two columns of temperatures that are copies, beside an effect that is seen."""
    gram, slope = np.array([[[0.0, 0.0], [0.0, 0.0]], [[40.0, 0.0], [0.0, 30.0]]]), np.array([[0.0, 0.0], [30.0, 9.0]])
    square, empirical = np.diagonal(gram, axis1=1, axis2=2), np.array([False, False])
    evidence, gained, absorbed, _ = free_scores(Noise(100.0, 100), gram, slope, square, empirical)
    assert evidence[0] == -np.inf
    assert np.isfinite(evidence[1])
    assert (gained[0], absorbed[0]) == (0.0, 1.0)
