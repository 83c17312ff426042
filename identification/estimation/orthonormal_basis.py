"""Orthonormal basis of what some columns span, by QR decomposition that reveals the rank.

Many columns that are far from dependent are made orthonormal by the Cholesky factor of their products, twice, which
costs a third (Y. Yamamoto et al., Electron. Trans. Numer. Anal. 44 (2015) 306).
"""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array

LEFT = 1e-6  # of a column's length: as much must be left beside what has been fitted
MANY = 16  # columns from which their products are quicker
APART = 1e-5  # of a column's length, left by those before it: the products know that to a millionth
DEPENDENT = 1e-9  # of a column's length: what the columns before it leave of it, by rounding only


def orthonormal_basis(columns: Array) -> Array:
    """Orthonormal basis (n, r) of the span of columns (n, k) of about unit length; r is their rank.

    Without pivoting, a column that depends on those before it would add a direction of rounding errors.
    """
    if columns.shape[1] >= MANY and (found := _by_products(columns)) is not None:
        return found
    q, r = np.linalg.qr(columns)
    if (np.abs(np.diag(r)) < DEPENDENT).any():
        from scipy.linalg import qr

        q, r, _ = qr(columns, mode="economic", pivoting=True)
        q = q[:, np.abs(np.diag(r)) >= DEPENDENT]
    return np.asarray(q)


def _by_products(columns: Array) -> Array | None:
    """The same by the columns' products; None where a column nearly depends on others."""
    from scipy.linalg.blas import dtrsm
    from scipy.linalg.lapack import dpotrf

    q = columns
    for _ in range(2):
        triangle, failed = dpotrf(q.T @ q, lower=True)
        if failed or np.diag(triangle).min() < APART:
            return None
        q = dtrsm(1.0, triangle, q, side=1, lower=1, trans_a=1)
    return np.asarray(q)
