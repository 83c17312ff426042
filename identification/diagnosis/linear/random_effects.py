"""Random effects: many parameters with mean zero and one common standard deviation, its estimate and its log evidence.

Restricted maximum likelihood with the noise and the geometry integrated out; in the eigenbasis of what the geometry
leaves of the columns, a scale costs a sum (D. A. Harville, J. Am. Stat. Assoc. 72, 1977).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array

DEPENDENT = 1e-9  # of the largest eigenvalue: less is rounding
ROUNDED = 1e-14  # of the columns' lengths squared, in double precision
EXACT = 1e-100  # residual sum of squares (noise variances) of readings that fit exactly: no less, to divide by
AT_ONCE = 16  # sets of random effects: all their scales stay within the processor's cache
SCALES = np.logspace(-3, 6, 91)  # of a parameter's effect over all rows, in noise variances


@dataclass(frozen=True)
class RandomEffects:
    """Columns of random effects, given a fitted basis.

    Attributes
    ----------
    values : (k,) eigenvalues of their projected Gram matrix; `slopes` (k,): the residual along those directions.
    whole : what the geometry left and took of them, summed; `square`, `freedom`: of the residual.
    """

    values: Array
    slopes: Array
    whole: float
    square: float
    freedom: int

    @classmethod
    def of(cls, columns: Array, inner: Array, residual: Array, freedom: int) -> RandomEffects:
        """From columns (k, N), and the residual (N + ties,) that an orthonormal basis leaves.

        Parameters
        ----------
        inner : products (k, r) of the columns and the basis.
        """
        gram, slopes = columns @ columns.T, columns @ residual[: columns.shape[1]]
        square = max(float(residual @ residual), EXACT)
        return cls.from_products(gram - inner @ inner.T, slopes, float(np.trace(gram)), square, freedom)

    @classmethod
    def from_products(cls, gram: Array, slopes: Array, whole: float, square: float, freedom: int) -> RandomEffects:
        """From products of what the geometry leaves of the columns: with each other (k, k), with the residual (k,)."""
        values, along = _spectra(gram[None], slopes[None], np.array([whole]))
        left = values[0] > 0
        return cls(values[0, left], along[0, left], whole, square, freedom)

    @property
    def absorbed(self) -> float:
        return float(np.clip(1 - self.values.sum() / self.whole, 0.0, 1.0)) if self.whole else 1.0

    def left(self, ratio: Array | float) -> Array:
        """Residual sum of squares (with the ties') for variances of `ratio` noise variances."""
        r = np.asarray(ratio)[..., None]
        out = self.square - np.sum(self.slopes**2 * r / (1 + r * self.values), axis=-1)
        return np.asarray(np.maximum(out, ROUNDED * self.square))

    def best(self) -> tuple[float, float, float]:
        """Likeliest ratio of a parameter's variance to the noise's, its log Bayes factor, and the noise variance."""
        if not len(self.values):
            return 0.0, -np.inf, self.square / self.freedom
        found = _likeliest(self.values[None], self.slopes[None], self.square, self.freedom)
        ratio, evidence, noise = (float(v[0]) for v in found)
        return ratio, evidence, noise

    def likeliest_size(self) -> float:
        """Likeliest standard deviation of a parameter; 0 where the geometry left nothing."""
        ratio, _, noise = self.best()
        return float(np.sqrt(ratio * noise))

    def evidence(self, size: float) -> float:
        """Log Bayes factor for parameters of a known standard deviation."""
        ratio = size**2 / self.noise(size)
        return float(-self.freedom / 2 * np.log(self.left(ratio) / self.square)) - 0.5 * float(
            np.log1p(ratio * self.values).sum()
        )

    def noise(self, size: float) -> float:
        """Noise variance where the parameters' standard deviation is known."""
        variance = self.square / self.freedom
        for _ in range(8):
            variance = float(self.left(size**2 / variance)) / self.freedom
        return variance


def principal(columns: Array) -> Array:
    """Columns (p, n) of random effects in their principal components, of k columns (k, n) with the same covariance.

    Components without variance but by rounding are left out: a smooth curve with many knots has half as many.
    """
    values, vectors = np.linalg.eigh(columns @ columns.T)
    return np.asarray(vectors[:, values > DEPENDENT * values[-1]].T @ columns)


def scores_of(gram: Array, slopes: Array, whole: Array, square: float, freedom: int) -> tuple[Array, Array, Array]:
    """Log Bayes factor, noise variance and absorbed share (m,) of several sets of random effects.

    Parameters
    ----------
    gram, slopes, whole : (m, k, k), (m, k) and (m,), as in `RandomEffects.from_products`.
    """
    values, along = _spectra(gram, slopes, whole)
    evidence, noise = np.full(len(gram), -np.inf), np.full(len(gram), square / freedom)
    some = np.flatnonzero(values.any(axis=1))
    for k in range(0, len(some), AT_ONCE):
        own = some[k : k + AT_ONCE]
        _, evidence[own], noise[own] = _likeliest(values[own], along[own], square, freedom)
    share = np.divide(values.sum(axis=1), whole, out=np.zeros(len(whole)), where=whole > 0)
    return evidence, noise, np.clip(1 - share, 0.0, 1.0)


def _spectra(gram: Array, slopes: Array, whole: Array) -> tuple[Array, Array]:
    """Eigenvalues (m, k) and slopes along their directions (m, k); zero where the geometry left nothing."""
    values, vectors = np.linalg.eigh(gram)
    left = values > np.maximum(DEPENDENT * values[:, -1], ROUNDED * whole)[:, None]
    along = (vectors.transpose(0, 2, 1) @ slopes[..., None])[..., 0]
    return np.where(left, values, 0.0), np.where(left, along, 0.0)


def _likeliest(values: Array, slopes: Array, square: float, freedom: int) -> tuple[Array, Array, Array]:
    """As `RandomEffects.best`, (m,) each, of several spectra of which each has a value above zero."""
    ratios = SCALES / (values.sum(axis=1) / (values > 0).sum(axis=1))[:, None]
    gains = ratios[..., None] * values[:, None, :]
    explained = np.sum(slopes[:, None, :] ** 2 * ratios[..., None] / (1 + gains), axis=-1)
    left = np.maximum(square - explained, ROUNDED * square)
    evidence = -freedom / 2 * np.log(left / square) - 0.5 * np.log1p(gains).sum(axis=-1)
    best = np.argmax(evidence, axis=1)
    ratio, most, least = (np.take_along_axis(a, best[:, None], axis=1)[:, 0] for a in (ratios, evidence, left))
    return ratio, most - 1.0, least / freedom  # less 1 for the choice of the ratio
