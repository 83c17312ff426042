"""Solution and inverse of normal equations, scaled to unit diagonal."""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array

BEYOND_ERRORS = 2.0  # times the largest error: an eigenvalue that is none
DETERMINED = 1e-13  # eigenvalues of scaled normal equations below this share of the largest are rounding errors


def scaled_solve(gram: Array, slope: Array) -> Array:
    """Solution of normal equations, scaled to unit diagonal."""
    from scipy.linalg import cho_factor, cho_solve

    if not len(slope):
        return np.zeros(0)
    d = 1 / np.sqrt(np.diag(gram))
    unit = gram * np.outer(d, d)
    try:
        return np.asarray(d * cho_solve(cho_factor(unit), d * slope))
    except np.linalg.LinAlgError:  # singular to round-off: minimum-norm step
        return np.asarray(d * (np.linalg.pinv(unit, rcond=1e-12, hermitian=True) @ (d * slope)))


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
