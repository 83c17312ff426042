"""Groups of nearly dependent columns are what the weights of the rows make of them."""

from __future__ import annotations

import numpy as np
import pytest

from identification.estimation.fitted_groups import as_fitted
from identification.observation.identifiability import Groups


def near(seed: int) -> tuple[Groups, np.ndarray, np.ndarray, np.ndarray]:
    """Three columns of which the last is nearly the sum of the others, held at zero; and the rows' weights."""
    rng = np.random.default_rng(seed)
    own = rng.normal(size=(200, 2))
    own[:, 1] += own[:, 0]
    last = own.sum(axis=1) + np.where(np.arange(200) < 40, 0.3, 0.0) * own[:, 1]
    design = np.column_stack([own, last])
    weights = np.where(np.arange(200) < 40, 100.0, 1.0)
    groups = Groups(("a.dx", "b.dx", "c.dx"), np.array([0, 1]), np.array([[1.0, 0, 1], [0, 1, 1]]), (), np.ones(3))
    return groups, design, weights, rng.normal(0, 1e-3, 200) / np.sqrt(weights)


@pytest.mark.parametrize("seed", range(5))
def test_the_estimates_are_of_the_groups_that_are_stated(seed: int) -> None:
    """With noise a thousandth of the errors: as stated before they are off by hundreds of their uncertainties."""
    groups, design, weights, noise = near(seed)
    gram = design.T @ (weights[:, None] * design) / 1e-6
    base = groups.base
    covariance = np.linalg.inv(gram[np.ix_(base, base)])
    truth = np.array([0.02, -0.01, 0.03])
    measured = design @ truth + noise
    values = covariance @ (design[:, base].T @ (weights * measured)) / 1e-6
    std = np.sqrt(np.diag(covariance))
    stated = as_fitted(groups, gram, covariance, ["mm"] * 3)
    assert np.abs((values - groups.coefficients @ truth) / std).max() > 10
    assert np.abs((values - stated.coefficients @ truth) / std).max() < 4


def test_exact_dependences_stay_as_they_are() -> None:
    groups, design, weights, _ = near(1)
    design[:, 2] = design[:, :2].sum(axis=1)
    gram = design.T @ (weights[:, None] * design) / 1e-6
    covariance = np.linalg.inv(gram[:2, :2])
    assert as_fitted(groups, gram, covariance, ["mm"] * 3).coefficients.tolist() == groups.coefficients.tolist()
