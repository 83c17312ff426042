"""Noise that is correlated along the rows: its model, and what it does to standard uncertainties."""

from __future__ import annotations

import numpy as np
import pytest

from identification.estimation.noise import Noise, likeliest
from tests.helpers.correlated_noise import drawn

EDGES = np.array([0, 300, 600])


@pytest.mark.parametrize("noise", [Noise(6.0, 0.4), Noise(60.0, 1.5)])
def test_covariance_is_the_dense_one_and_whitening_its_inverse_root(noise: Noise) -> None:
    n = 300
    gap = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    dense = (np.eye(n) + noise.part * noise.kept**gap) / (1 + noise.part)
    edges = np.array([0, n])
    np.testing.assert_allclose(noise.spread(np.eye(n), edges), dense, atol=1e-12)
    white = noise.whitened(np.linalg.cholesky(dense).T, edges).T
    product = white @ white.T
    scale = np.trace(product) / n
    # the filter forgets its start after some rows: identity from there on
    np.testing.assert_allclose(product[200:, 200:] / scale, np.eye(100), atol=0.02)


def test_white_noise_is_taken_as_white_and_correlated_noise_is_recognised() -> None:
    rng = np.random.default_rng(5)
    some = rng.normal(size=(3, 600))
    assert sum(likeliest(rng.normal(size=600), some, EDGES)[0] is not None for _ in range(100)) <= 2
    for truth in (Noise(6.0, 1.5), Noise(20.0, 0.4)):
        found = [likeliest(drawn(truth, rng), some, EDGES)[0] for _ in range(20)]
        assert sum(f is not None for f in found) >= 19
        lengths = [f.length for f in found if f is not None]
        assert truth.length / 3.5 < np.median(lengths) < truth.length * 3.5


def test_columns_that_repeat_others_count_once() -> None:
    rng = np.random.default_rng(6)
    some, residual = rng.normal(size=(3, 600)), drawn(Noise(20.0, 0.4), rng)
    once, again = (likeliest(residual, own, EDGES) for own in (some, some[[0, 1, 2, 1, 1]]))
    assert again[0] == once[0]
    assert again[1] == pytest.approx(once[1], rel=1e-12)


@pytest.mark.parametrize("noise", [Noise(2.0, 0.1), Noise(60.0, 1.5)])
def test_weighing_is_whitening_both_sides(noise: Noise) -> None:
    """Each series by itself; values behind the last edge stay as they are."""
    one, other = np.random.default_rng(4).normal(size=(2, 3, 620))
    expected = noise.whitened(one, EDGES) @ noise.whitened(other, EDGES).T
    np.testing.assert_allclose(noise.weighed(one, EDGES) @ other.T, expected, rtol=1e-9)
