"""Solution and inverse of normal equations, scaled to unit diagonal."""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array


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


def scaled_inverse(gram: Array) -> Array:
    """Inverse of normal equations, scaled to unit diagonal."""
    from scipy.linalg import cho_factor, cho_solve

    if not len(gram):
        return np.zeros((0, 0))
    d = 1 / np.sqrt(np.diag(gram))
    unit = gram * np.outer(d, d)
    try:
        return np.asarray(np.outer(d, d) * cho_solve(cho_factor(unit), np.eye(len(gram))))
    except np.linalg.LinAlgError:
        return np.asarray(np.outer(d, d) * np.linalg.pinv(unit, rcond=1e-12, hermitian=True))
