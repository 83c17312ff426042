"""Marginal posterior of the hyperparameters, with all linear parameters integrated out in closed form.

Hyperparameters are noise levels, shape parameters of effects and scales of random effects.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from identification.bayes.hyperparameters import Coordinate
from identification.bayes.priors import Prior
from identification.bayes.statistics import Statistics


@dataclass(frozen=True)
class Collapsed:
    """Target density of a sampler: points are (n, coordinates), on the sampled scale.

    Attributes
    ----------
    statistics : sufficient statistics of the rows.
    prior : of the linear parameters.
    coordinates : noise levels of the `free` kinds, then shape parameters, then scales of random effects.
    free : indices of the kinds of observation whose noise level is unknown.
    """

    statistics: Statistics
    prior: Prior
    coordinates: tuple[Coordinate, ...]
    free: tuple[int, ...]

    @property
    def _shapes(self) -> slice:
        """Columns of the shape parameters among the coordinates."""
        return slice(len(self.free), len(self.free) + sum(len(b.names) for b in self.statistics.interpolations))

    def levels(self, points: Array) -> Array:
        """Inverse noise variances (n, kinds)."""
        out = np.ones((len(points), len(self.statistics.kinds)))
        out[:, list(self.free)] = np.exp(-2 * points[:, : len(self.free)])
        return out

    def shapes(self, points: Array) -> Array:
        """Shape parameters (n, all shapes), on the sampled scale."""
        return points[:, self._shapes]

    def scales(self, points: Array) -> Array:
        """Scales (n, random effects) of the random effects' standard deviations."""
        start = self._shapes.stop
        return np.exp(points[:, start : start + len(self.prior.ties)])

    def log_prior(self, points: Array) -> Array:
        """Log prior density of the hyperparameters, (n,), with the normalisation of the random effects' priors.

        Minus infinity outside the bounds or the interpolated range of a shape.
        """
        total = sum((c.log_prior(x) for c, x in zip(self.coordinates, points.T, strict=True)), np.zeros(len(points)))
        shapes, start = self.shapes(points), 0
        for shape in self.statistics.interpolations:
            own = shapes[:, start : start + len(shape.names)]
            total = np.where(((own >= shape.low) & (own <= shape.high)).all(axis=1), total, -np.inf)
            start += len(shape.names)
        return np.asarray(total + self.prior.log_ties(self.scales(points)))

    def normal(self, points: Array) -> tuple[Array, Array, Array]:
        """Precision (n, p, p) of the parameters given the hyperparameters, its product with the mean, and ``y'Wy``."""
        gram, slope, square = self.statistics.normal(self.levels(points), self.shapes(points))
        precision = self.prior.precisions(self.scales(points))
        pull = self.prior.precision @ self.prior.mean
        return gram + precision, slope + pull, square + self.prior.mean @ pull

    def log_prob(self, points: Array) -> Array:
        """Logarithm of the marginal posterior density, up to a constant, (n,)."""
        out = self.log_prior(points)
        inside = np.isfinite(out)
        if inside.any():
            points = points[inside]
            factor = _factors(*self.normal(points))
            diagonal = np.log(np.diagonal(factor, axis1=1, axis2=2))
            counts = -points[:, : len(self.free)] @ self.statistics.count[list(self.free)]
            out[inside] += counts - 0.5 * factor[:, -1, -1] ** 2 - diagonal[:, :-1].sum(axis=1)
        return out

    def parameters(self, points: Array, rng: np.random.Generator) -> Array:
        """One exact draw (n, p) of the parameters for each point."""
        out = np.empty((len(points), len(self.statistics.names)))
        for start in range(0, len(points), 500):
            part = slice(start, start + 500)
            gram, slope, _ = self.normal(points[part])
            d = 1 / np.sqrt(np.diagonal(gram, axis1=1, axis2=2))
            factor = np.linalg.cholesky(gram * d[:, :, None] * d[:, None, :])
            # with the precision L L': L'^-1 (L^-1 slope + noise)
            white = np.linalg.solve(factor, (d * slope)[:, :, None])
            white = white + rng.standard_normal(white.shape)
            out[part] = d * np.linalg.solve(factor.transpose(0, 2, 1), white)[:, :, 0]
        return out

    def closed(self, points: Array) -> tuple[Array, Array]:
        """Mean (n, p) and covariance (n, p, p) of the parameters at each point."""
        gram, slope, _ = self.normal(points)
        d = 1 / np.sqrt(np.diagonal(gram, axis1=1, axis2=2))
        scale = d[:, :, None] * d[:, None, :]
        covariance = np.linalg.inv(gram * scale) * scale
        covariance = (covariance + covariance.transpose(0, 2, 1)) / 2
        return np.einsum("nij,nj->ni", covariance, slope), covariance

    def start(self) -> Array:
        """Centre (1, coordinates) of the starting points."""
        return np.array([[c.start for c in self.coordinates]])


def _factors(gram: Array, slope: Array, square: Array) -> Array:
    """Cholesky factors (n, p + 1, p + 1); the last diagonal entry squared is the residual sum of squares."""
    n, p = slope.shape
    whole = np.empty((n, p + 1, p + 1))
    d = np.sqrt(np.diagonal(gram, axis1=1, axis2=2))
    whole[:, :p, :p] = gram / d[:, :, None] / d[:, None, :]
    whole[:, p, :p] = whole[:, :p, p] = slope / d
    whole[:, p, p] = square
    factor = np.linalg.cholesky(whole)
    factor[:, range(p), range(p)] *= d
    return np.asarray(factor)
