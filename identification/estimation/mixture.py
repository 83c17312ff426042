"""Rows that are out, once a robust fit stands: a mixture of normal rows and of outliers that have something in common.

A bisquare goes by distance alone: a row at four standard deviations still pulls, wherever the others are. Here the
outliers' share, mean and spread are estimated with the fit (A. P. Dempster & al., J. R. Stat. Soc. B 39 (1977) 1): what
lies where they are counts for little, what lies elsewhere counts in full.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from errormodel.arrays import Array, Index
from identification.estimation.bisquare import bisquare

SHARE, SPREAD = 0.01, 4.0  # of outliers, before any has been seen: of the rows; standard deviations of the noise
MOST = 0.5  # of the rows may be outliers
FAR = 20.0  # standard deviations: where a row is farther out, its mean and spread are no others'
FAINT = 0.01  # a row less likely to be normal than this takes no part
ROUNDS, STILL = 100, 1e-4


@dataclass(frozen=True)
class Outliers:
    """What they have in common: `share` of the rows, `mean` (3,) and `spread` in units of the noise.

    Residuals u (components, n) below are in units of the noise, 0 where nothing was measured; m (n,) are measured.
    """

    share: float
    mean: Array
    spread: float
    price: ClassVar[float] = 7.0  # one component of a row in fifty wrong, by anything up to a dozen standard deviations
    sharp: ClassVar[float] = 1.0

    @classmethod
    def unseen(cls) -> Outliers:
        """Before any row has been looked at."""
        return cls(SHARE, np.zeros(3), SPREAD)

    def among(self, u: Array, m: Index) -> Outliers:
        """As rows with residuals u (3, n) show it, from what was thought before."""
        u = u * np.minimum(1, FAR / np.maximum(np.linalg.norm(u, axis=0), 1e-300))
        out, before = self, np.full(len(m), np.nan)
        for _ in range(ROUNDS):
            p = 1 - out.normal(u, m)
            if np.abs(p - before).max(initial=0.0) < STILL:
                break
            before, count = p, float(p.sum())
            mean = (u @ p) / (count + 1)  # as if one more lay in the middle, at the usual distance
            apart = float(p @ np.square(u - mean[:, None]).sum(axis=0)) + len(u) * SPREAD**2
            spread = max(float(np.sqrt(apart / (float(p @ m) + len(u)))), 1.0)
            out = Outliers(min((count + 0.5) / (len(m) + 5), MOST), mean, spread)
        return out

    def normal(self, u: Array, m: Index) -> Array:
        """How likely each row is no outlier, (n,)."""
        far = self._cost(u, m) - np.log1p(-self.share) - np.square(u).sum(axis=0) / 2
        return np.asarray(1 / (1 + np.exp(-np.clip(far, -500, 500))))

    def whole(self, u: Array, m: Index) -> tuple[Array, Array, Array]:
        """Cost, weight and divergence of the pull of rows that count as likely as they are no outliers."""
        p, square = self.normal(u, m), np.square(u).sum(axis=0)
        p[p < FAINT] = 0.0
        steep = (
            square - (u * (u - self.mean[: len(u), None])).sum(axis=0) / self.spread**2
        )  # u times the slope of the odds
        return np.minimum(square / 2, self._cost(u, m)), p, p * m - p * (1 - p) * steep

    def rest(self, distance: Array, m: Index) -> tuple[Array, Array, Array]:
        """The same of what one wrong component leaves."""
        _, weight, slope = bisquare(distance, m)
        return np.square(distance) / 2, weight, slope

    def _cost(self, u: Array, m: Index) -> Array:
        """Of being an outlier: half a squared distance beyond which that is the likelier."""
        apart = np.square((u - self.mean[: len(u), None]) / self.spread).sum(axis=0)
        return np.asarray(apart / 2 - np.log(self.share) + m * np.log(self.spread))
