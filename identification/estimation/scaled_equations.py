"""Solution and inverse of normal equations, scaled to unit diagonal; kept for noise levels that hardly differ."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from errormodel.arrays import Array, Index
from identification.observation.models import Kind
from identification.observation.sums import Sums

BEYOND_ERRORS = 2.0  # times the largest error: an eigenvalue that is none
SAME = 1e-6  # of noise levels: up to as much they are those of before, as where their iteration ends
DETERMINED = 1e-13  # eigenvalues of scaled normal equations below this share of the largest are rounding errors


def scaled_solve(gram: Array, slope: Array) -> Array:
    """Solution of normal equations, scaled to unit diagonal."""
    return scaled_solver(gram)(slope)


def scaled_solver(gram: Array) -> Callable[[Array], Array]:
    """What solves normal equations for any slope, scaled to unit diagonal."""
    from scipy.linalg import cho_factor, cho_solve

    if not len(gram):
        return lambda _: np.zeros(0)
    d = 1 / np.sqrt(np.diag(gram))
    unit = gram * np.outer(d, d)
    try:
        factor = cho_factor(unit)
        return lambda slope: np.asarray(d * cho_solve(factor, d * slope))
    except np.linalg.LinAlgError:  # singular to round-off: minimum-norm step
        inverse = np.linalg.pinv(unit, rcond=1e-12, hermitian=True)
        return lambda slope: np.asarray(d * (inverse @ (d * slope)))


def determined_step(gram: Array, slope: Array, scale: Array) -> Array:
    """Step that normal equations determine, minimal along directions that they do not; columns times `scale` are alike.

    A Cholesky factor where its condition number shows that all are determined, else the eigenvectors.
    """
    from scipy.linalg import cho_solve
    from scipy.linalg.lapack import dpocon, dpotrf

    if not len(slope):
        return np.zeros(0)
    unit = gram * np.outer(scale, scale)
    factor, failed = dpotrf(unit)
    if not failed and dpocon(factor, np.abs(unit).sum(axis=0).max(initial=0.0))[0] > DETERMINED:
        return np.asarray(scale * cho_solve((factor, False), scale * slope))
    sizes, directions = np.linalg.eigh(unit)
    # an eigenvalue below zero shows how large errors are
    known = sizes > max(DETERMINED * sizes[-1], -BEYOND_ERRORS * sizes[0])
    own = directions[:, known]
    return np.asarray(scale * (own @ ((own.T @ (scale * slope)) / sizes[known])))


def scaled_inverse(gram: Array) -> Array:
    """Inverse of normal equations, scaled to unit diagonal."""
    from scipy.linalg.lapack import dpotrf, dpotri

    if not len(gram):
        return np.zeros((0, 0))
    d = 1 / np.sqrt(np.diag(gram))
    scale = np.outer(d, d)
    unit = gram * scale
    factor, failed = dpotrf(unit.T, lower=False)
    if not failed:
        upper, failed = dpotri(factor, lower=False, overwrite_c=True)
    if failed:  # singular to round-off
        return np.asarray(scale * np.linalg.pinv(unit, rcond=1e-12, hermitian=True))
    whole = upper + np.triu(upper, 1).T  # zero below the diagonal
    whole *= scale
    return np.asarray(whole)


@dataclass(frozen=True)
class WeighedEquations:
    """Normal equations (p, p) of some columns at the noise levels of kinds of observation, with a prior's precision.

    A factor serves all noise levels that hardly differ: what is left of a step is in the next one.
    """

    sums: Mapping[Kind, Sums]
    sigma: Mapping[Kind, float]
    precision: Array
    base: Index

    def serves(self, sums: Mapping[Kind, Sums], sigma: Mapping[Kind, float], precision: Array, base: Index) -> bool:
        """Whether these are the normal equations of the same products, prior and columns at noise levels as these."""
        alike = precision is self.precision and base is self.base and sums.keys() == self.sums.keys()
        return alike and all(
            own.gram is self.sums[kind].gram and abs(sigma[kind] / self.sigma[kind] - 1) < SAME
            for kind, own in sums.items()
        )

    @cached_property
    def gram(self) -> Array:
        """The products, each kind's over its variance, and the prior's."""
        pick = np.ix_(self.base, self.base)
        out = np.diag(self.precision[self.base])
        for kind, own in self.sums.items():
            out += own.gram[pick] / self.sigma[kind] ** 2
        return out

    @cached_property
    def solve(self) -> Callable[[Array], Array]:
        """The step for a slope."""
        return scaled_solver(self.gram)

    @cached_property
    def used(self) -> dict[Kind, float]:
        """Degrees of freedom that the columns take of the observations of each kind."""
        inverse, pick = scaled_inverse(self.gram), np.ix_(self.base, self.base)
        return {
            kind: float(np.vdot(inverse, own.gram[pick])) / self.sigma[kind] ** 2 for kind, own in self.sums.items()
        }
