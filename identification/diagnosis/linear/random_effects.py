"""Random effects: many parameters with mean zero and one common standard deviation, its estimate and its log evidence.

Restricted maximum likelihood with the noise and the geometry integrated out; in the eigenbasis of what the geometry
leaves of the columns, a scale costs a sum (D. A. Harville, J. Am. Stat. Assoc. 72, 1977).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array

ROUNDED = 1e-14  # of the columns' lengths squared, in double precision
EXACT = 1e-100  # residual sum of squares (noise variances) of readings that fit exactly: no less, to divide by
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
    def of(cls, columns: Array, basis: Array, residual: Array, freedom: int) -> RandomEffects:
        """From columns (k, N), an orthonormal basis (N + ties, r) and the residual (N + ties,) that it leaves."""
        seen = columns.shape[1]
        inner, gram = columns @ basis[:seen], columns @ columns.T
        left, slopes = gram - inner @ inner.T, columns @ residual[:seen]
        return cls.from_products(left, slopes, float(np.trace(gram)), max(float(residual @ residual), EXACT), freedom)

    @classmethod
    def from_products(cls, gram: Array, slopes: Array, whole: float, square: float, freedom: int) -> RandomEffects:
        """From products of what the geometry leaves of the columns: with each other (k, k), with the residual (k,)."""
        values, vectors = np.linalg.eigh(gram)
        left = values > max(1e-9 * values[-1], ROUNDED * whole)
        return cls(values[left], vectors[:, left].T @ slopes, whole, square, freedom)

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
        ratios = SCALES / self.values.mean()
        left = self.left(ratios)
        evidence = -self.freedom / 2 * np.log(left / self.square)
        evidence = evidence - 0.5 * np.log1p(ratios[:, None] * self.values).sum(axis=1)
        k = int(np.argmax(evidence))
        bayes_factor = float(evidence[k]) - 1.0  # less 1 for the choice of the ratio
        return float(ratios[k]), bayes_factor, float(left[k]) / self.freedom

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
