"""Expectation-maximisation for a mixture of normal rows and one Gaussian cluster of outliers.

The bisquare weights a row by its distance alone. This mixture also estimates the outliers' share, mean and spread (EM:
A. P. Dempster et al., J. R. Stat. Soc. B 39 (1977) 1) and weights each row by its probability of being an inlier: rows
near the outliers' mean lose weight, others at the same distance keep it. Residuals are in standard deviations of the
noise, in the measuring frame of the rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from errormodel.arrays import Array, Index
from identification.estimation.bisquare import bisquare

# Starting values of the outliers: share of the rows, and spread in standard deviations of the noise; by judgement
START_OUTLIER_SHARE, START_OUTLIER_SPREAD_SIGMA = 0.01, 4.0
MOST_OUTLIER_SHARE = 0.5  # largest share of outliers: with more, nobody can say which rows are wrong
FAR_OUTLIER_SIGMA = 20.0  # residuals are shortened to this length, so that one far row does not set mean and spread
LEAST_INLIER_PROBABILITY = 0.01  # rows below it get weight zero, by judgement
MOST_EM_ROUNDS, EM_TOLERANCE = 100, 1e-4  # iterations; change of a probability at which they stop


@dataclass(frozen=True)
class Outliers:
    """Gaussian cluster of outliers.

    In the methods, u (components, n) are residuals in standard deviations of the noise, 0 where nothing was measured,
    and m (n,) is the number of measured components.

    Attributes
    ----------
    share : prior probability of a row to be an outlier.
    mean : (3,) in standard deviations of the noise; `spread`: standard deviation in the same unit.
    price, sharp : cost of one wrong component and its factor, as in `identification.estimation.bisquare.Scale`.
    """

    share: float
    mean: Array
    spread: float
    price: ClassVar[float] = 7.0  # -log density: one row in fifty has a wrong component, uniform within 12 sigma
    sharp: ClassVar[float] = 1.0

    @classmethod
    def unseen(cls) -> Outliers:
        """Starting values, before any row has been used."""
        return cls(START_OUTLIER_SHARE, np.zeros(3), START_OUTLIER_SPREAD_SIGMA)

    def among(self, u: Array, m: Index) -> Outliers:
        """Share, mean and spread by EM from residuals u (3, n), started at the present values."""
        u = u * np.minimum(1, FAR_OUTLIER_SIGMA / np.maximum(np.linalg.norm(u, axis=0), 1e-300))
        out, before = self, np.full(len(m), np.nan)
        for _ in range(MOST_EM_ROUNDS):
            p = 1 - out.normal(u, m)
            if np.abs(p - before).max(initial=0.0) < EM_TOLERANCE:
                break
            before, count = p, float(p.sum())
            mean = (u @ p) / (count + 1)  # prior: one more outlier at zero with the starting spread
            apart = float(p @ np.square(u - mean[:, None]).sum(axis=0)) + len(u) * START_OUTLIER_SPREAD_SIGMA**2
            spread = max(float(np.sqrt(apart / (float(p @ m) + len(u)))), 1.0)
            out = Outliers(min((count + 0.5) / (len(m) + 5), MOST_OUTLIER_SHARE), mean, spread)
        return out

    def normal(self, u: Array, m: Index) -> Array:
        """Probability of each row to be an inlier, (n,)."""
        far = self._cost(u, m) - np.log1p(-self.share) - np.square(u).sum(axis=0) / 2
        return np.asarray(1 / (1 + np.exp(-np.clip(far, -500, 500))))

    def whole(self, u: Array, m: Index) -> tuple[Array, Array, Array]:
        """Cost, weight and divergence of psi, (n,) each; the weight is the inlier probability."""
        p, square = self.normal(u, m), np.square(u).sum(axis=0)
        p[p < LEAST_INLIER_PROBABILITY] = 0.0
        steep = (
            square - (u * (u - self.mean[: len(u), None])).sum(axis=0) / self.spread**2
        )  # u times the gradient of the log odds
        return np.minimum(square / 2, self._cost(u, m)), p, p * m - p * (1 - p) * steep

    def rest(self, distance: Array, m: Index) -> tuple[Array, Array, Array]:
        """The same for the components that remain beside a wrong one: weight of the bisquare."""
        _, weight, slope = bisquare(distance, m)
        return np.square(distance) / 2, weight, slope

    def _cost(self, u: Array, m: Index) -> Array:
        """Negative logarithm of share times outlier density, (n,), up to the constant of a unit normal density."""
        apart = np.square((u - self.mean[: len(u), None]) / self.spread).sum(axis=0)
        return np.asarray(apart / 2 - np.log(self.share) + m * np.log(self.spread))
