"""Evidence of several effects together: that of the linear-Gaussian model, also where two of them are nearly alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from errormodel.arrays import Array
from identification.diagnosis.decisions.constants import SIZES
from identification.diagnosis.search.marginal_likelihood import joint_evidence


@dataclass(frozen=True)
class Noise:
    """The residual sum of squares of a linear model, and its degrees of freedom."""

    square: float
    freedom: int


def directly(columns: Array, residual: Array) -> float:
    """The same by dense matrices: log of the mean likelihood ratio of normal priors of each size (n, k)."""
    n, k = columns.shape
    variance = residual @ residual / n
    ratios = []
    for size, weight in SIZES.items():
        whole = np.eye(k) + size**2 * columns.T @ columns / variance
        kept = size**2 * (columns.T @ residual) @ np.linalg.solve(whole, columns.T @ residual) / variance**2
        ratios.append(weight * np.exp(-n / 2 * np.log1p(-kept / n) - np.linalg.slogdet(whole)[1] / 2))
    return float(np.log(sum(ratios)))


@pytest.mark.parametrize("apart", [1.0, 0.03, 1e-3])
def test_it_is_that_of_the_linear_model(apart: float) -> None:
    rng = np.random.default_rng(3)
    one, other = rng.normal(size=(2, 300))
    columns = 0.3 * np.column_stack([one, one + apart * other])
    residual = columns @ [1.2, -0.7] + rng.normal(size=300)
    noise = Noise(float(residual @ residual), 300)
    found = joint_evidence(noise, columns.T @ columns, columns.T @ residual)
    assert found == pytest.approx(directly(columns, residual), rel=1e-6)


def test_what_distinguishes_two_lags_counts_though_it_is_little() -> None:
    """Of two lags of one sensor less than a thousandth is left of their difference, which the noise lets be seen."""
    rng = np.random.default_rng(5)
    one, other = rng.normal(size=(2, 2000))
    columns = 50.0 * np.column_stack([one, one + 0.03 * other])
    residual = columns @ [-1.6, 1.7] + rng.normal(size=2000)
    noise = Noise(float(residual @ residual), 2000)
    both = joint_evidence(noise, columns.T @ columns, columns.T @ residual)
    alone = joint_evidence(noise, columns[:, :1].T @ columns[:, :1], columns[:, :1].T @ residual)
    assert both > alone + 100
