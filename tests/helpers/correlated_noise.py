"""Surveys whose noise is correlated along the rows."""

from __future__ import annotations

import numpy as np

from identification.estimation.noise import Noise
from tests.helpers.chains import Array


def drawn(noise: Noise, rng: np.random.Generator, n: int = 300, series: int = 2) -> Array:
    """Series of unit total variance, one after another."""
    correlated = np.empty((series, n))
    correlated[:, 0] = rng.normal(size=series)
    steps = rng.normal(size=(series, n)) * np.sqrt(1 - noise.kept**2)
    for k in range(1, n):
        correlated[:, k] = noise.kept * correlated[:, k - 1] + steps[:, k]
    whole = rng.normal(size=(series, n)) + np.sqrt(noise.part) * correlated
    return np.asarray(whole / np.sqrt(1 + noise.part)).ravel()
