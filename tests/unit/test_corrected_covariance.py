"""The covariance behind correlated noise stays one, where what it is corrected by is of other rows or values."""

from __future__ import annotations

import numpy as np
import pytest

from identification.estimation.noise import _corrected


def parts(slight: float) -> tuple[np.ndarray, np.ndarray]:
    """A covariance of some columns, and the correction for noise without power along one; `slight` too large."""
    rng = np.random.default_rng(3)
    design = rng.normal(size=(40, 4))
    information = design.T @ design
    turn = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    root = np.linalg.cholesky(information)
    less = root @ turn @ np.diag([-1.0 - slight, 0.5, 2.0, 0.0]) @ turn.T @ root.T
    return np.linalg.inv(information), less


def test_as_it_is() -> None:
    covariance, extra = parts(-0.3)
    assert _corrected(covariance, extra, 0.1) == pytest.approx(covariance + covariance @ extra @ covariance, rel=1e-12)


def test_white_noise_is_left() -> None:
    """Along a direction without variance, or with less than none, that of the white share is left; others stay."""
    covariance, extra = parts(0.01)
    assert np.linalg.eigvalsh(covariance + covariance @ extra @ covariance)[0] < 0
    out = _corrected(covariance, extra, 0.6)
    ratios = np.sort(np.linalg.eigvals(np.linalg.solve(covariance, out)).real)
    assert ratios == pytest.approx([0.6, 1.0, 1.5, 3.0], rel=1e-9)
