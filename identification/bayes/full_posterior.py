"""Posterior density of parameters and hyperparameters together, for bounded parameters or rows with outliers.

In these cases the linear parameters are not Gaussian and must be sampled. They are scaled by the closed-form posterior:
relative to its mean, along the columns of its Cholesky factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from identification.bayes.hyperparameters import Coordinate
from identification.bayes.marginal_posterior import Collapsed
from identification.bayes.outliers import Mixture


@dataclass(frozen=True)
class Whole:
    """Target density of a sampler: points are (n, p + coordinates), scaled parameters before hyperparameters.

    Attributes
    ----------
    linear : the same model with its parameters integrated out.
    mixture : outlier model, or None without outliers.
    center, factor : mean (p,) and Cholesky factor (p, p) of the covariance of the closed-form posterior at the start.
    shear : (q, p) change of this mean per unit of each hyperparameter: decorrelates scaled parameters from these.
    """

    linear: Collapsed
    mixture: Mixture | None
    center: Array
    factor: Array
    shear: Array

    @classmethod
    def of(cls, linear: Collapsed, mixture: Mixture | None = None) -> Whole:
        """The target for a linear model; its start is the closed-form posterior."""
        (center,), (covariance,) = linear.closed(linear.start())
        d = np.sqrt(np.diag(covariance))
        factor = d[:, None] * np.linalg.cholesky(covariance / np.outer(d, d))
        steps = np.diag([c.scale for c in linear.coordinates])
        shear = np.zeros((len(steps), len(center)))
        for k, step in enumerate(steps):
            before, after = (linear.closed(linear.start() + sign * step)[0][0] for sign in (-0.5, 0.5))
            shear[k] = (after - before) / step[k]
        return cls(linear, mixture, center, factor, shear)

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """All hyperparameters: those of the linear model, then those of the outliers."""
        return (*self.linear.coordinates, *(self.mixture.coordinates if self.mixture else ()))

    def split(self, points: Array) -> tuple[Array, Array]:
        """Parameters (n, p) and hyperparameters (n, q) of the linear model, of points."""
        p = len(self.center)
        own = points[:, p : p + len(self.linear.coordinates)]
        follow = (own - self.linear.start()) @ self.shear
        return self.center + points[:, :p] @ self.factor.T + follow, own

    def log_prob(self, points: Array) -> Array:
        """Logarithm of the posterior density, up to a constant, (n,)."""
        linear, prior = self.linear, self.linear.prior
        values, own = self.split(points)
        others = points[:, points.shape[1] - (2 if self.mixture else 0) :]
        out = linear.log_prior(own)
        out[((values < prior.low) | (values > prior.high)).any(axis=1)] = -np.inf
        if self.mixture is not None:
            out = out + sum(c.log_prior(x) for c, x in zip(self.mixture.coordinates, others.T, strict=True))
        inside = np.isfinite(out)
        if inside.any():
            out[inside] += self._inside(values[inside], own[inside], others[inside])
        return np.asarray(out)

    def _inside(self, values: Array, own: Array, others: Array) -> Array:
        """Log-likelihood plus the log prior of the parameters, for points within all bounds."""
        linear, prior, statistics = self.linear, self.linear.prior, self.linear.statistics
        levels, shapes, away = linear.levels(own), linear.shapes(own), values - prior.mean
        out = -0.5 * np.sum(levels * statistics.squares(values, shapes), axis=1)
        out -= own[:, : len(linear.free)] @ statistics.count[list(linear.free)]
        out -= 0.5 * np.einsum("ni,ni->n", away @ prior.precision, away)
        scales = linear.scales(own)
        for k, (place, size) in enumerate(zip(prior.ties, prior.sizes, strict=True)):
            out -= 0.5 * np.square(values[:, place] / (size * scales[:, k, None])).sum(axis=1)
        if self.mixture is not None:
            level = levels[:, statistics.kinds.index(self.mixture.apart.kind)]
            extended = statistics.extended(values, shapes)
            out = out + self.mixture.log_likelihood(others, level, extended)
        return np.asarray(out)
