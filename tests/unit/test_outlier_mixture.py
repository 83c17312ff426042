"""What outliers have in common: found again, and how rows then pull."""

from __future__ import annotations

import numpy as np
import pytest

from identification.estimation.bisquare import pull, usual
from identification.estimation.mixture import Outliers
from tests.helpers.chains import Array


def rows(share: float, mean: tuple[float, float, float], spread: float, n: int = 4000) -> tuple[Array, Array]:
    """Residuals (3, n) in units of the noise, and which are outliers."""
    rng = np.random.default_rng(1)
    out = rng.random(n) < share
    wrong = np.array(mean)[:, None] + spread * rng.normal(size=(3, n))
    return np.where(out, wrong, rng.normal(size=(3, n))), out


@pytest.mark.parametrize(
    ("share", "mean", "spread"), [(0.1, (4, 0, -3), 1.0), (0.05, (0, 0, 0), 6.0), (0.3, (0, 5, 0), 2.0)]
)
def test_share_mean_and_spread_are_found(share: float, mean: tuple[float, float, float], spread: float) -> None:
    u, out = rows(share, mean, spread)
    found = Outliers.unseen().among(u, np.full(u.shape[1], 3))
    assert found.share == pytest.approx(share, rel=0.12)
    np.testing.assert_allclose(found.mean, mean, atol=0.1 * spread + 5 * spread / np.sqrt(out.sum()))
    assert found.spread == pytest.approx(spread, rel=0.12)


def test_far_rows_do_not_hide_nearer_ones() -> None:
    """One at a metre leaves the others' mean and spread as they are."""
    u, _ = rows(0.1, (4, 0, -3), 1.0)
    u[:, 0] = 1e8
    found = Outliers.unseen().among(u, np.full(u.shape[1], 3))
    assert found.spread < 1.3
    assert found.normal(u, np.full(u.shape[1], 3))[0] < 1e-100


def test_normal_rows_keep_their_weight() -> None:
    u, _ = rows(0.0, (0, 0, 0), 1.0)
    m = np.full(u.shape[1], 3)
    found = Outliers.unseen().among(u, m)
    assert found.share < 2e-3
    assert np.mean(found.whole(u, m)[1]) > 0.998


def test_the_slope_is_that_of_the_pull() -> None:
    found = Outliers(0.1, np.array([2.0, 0.0, -3.0]), 1.5)
    u, m, h = np.random.default_rng(2).normal(0, 1.5, (3, 200)), np.full(200, 3), 1e-6
    slope = np.zeros(200)
    for k in range(3):
        step = h * np.eye(3)[:, [k]]
        ahead, behind = ((u + s * step)[k] * found.normal(u + s * step, m) for s in (1, -1))
        slope += (ahead - behind) / (2 * h)
    _, weight, said = found.whole(u, m)
    live = weight > 0
    np.testing.assert_allclose(said[live], slope[live], rtol=1e-6, atol=1e-6)


def test_the_mean_pull_of_normal_rows_is_that_of_many() -> None:
    found = Outliers(0.05, np.array([0.0, 3.0, 0.0]), 2.0)
    u, _ = rows(0.0, (0, 0, 0), 1.0, 200_000)
    axes = np.repeat(np.eye(3)[:, :, None], u.shape[1], axis=2)
    own = pull(u, np.full(u.shape[1], 3), axes, found)
    assert usual(3, found) == pytest.approx(own.along.sum() / own.live.sum(), rel=0.01)
