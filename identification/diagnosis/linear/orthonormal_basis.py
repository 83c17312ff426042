"""Orthonormal basis of what some columns span, by QR decomposition that reveals the rank."""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array

DEPENDENT = 1e-9  # of a column's length: what the columns before it leave of it, by rounding only


def orthonormal_basis(columns: Array) -> Array:
    """Orthonormal basis (n, r) of the span of columns (n, k) of about unit length; r is their rank.

    Without pivoting, a column that depends on those before it would add a direction of rounding errors.
    """
    q, r = np.linalg.qr(columns)
    if (np.abs(np.diag(r)) < DEPENDENT).any():
        from scipy.linalg import qr

        q, r, _ = qr(columns, mode="economic", pivoting=True)
        q = q[:, np.abs(np.diag(r)) >= DEPENDENT]
    return np.asarray(q)
