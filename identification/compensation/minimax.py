"""The least worst error near a least-squares solution, within slopes: small second-order cone programmes (CVXPY).

With ``z = R (x - start)``, R the root of the gram matrix, the sum of squares is that of the least squares plus
``|z|^2``, so that what may be given up of it is a ball. In that ball the best ``z`` is a combination of the rows that
hold it back: poses that come to be the worst, and slopes at their bounds. Only those are asked for, round by round (an
exchange method), so that a programme has as many unknowns as rows that matter, however many poses and values there are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.arrays import Array, Index
from identification.convex import optimise

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

ROUNDS = 25
POSES = 40  # that a round adds
EXACT = 0.002  # of the worst error: what lies beyond by less is not worth another round,
KEPT = 0.0005  # nor this of a slope's bound


@dataclass(frozen=True)
class Slopes:
    """Differences of neighbouring values (rows, size) and the bounds of each (rows,)."""

    rows: csr_matrix
    bounds: Array


@dataclass(frozen=True)
class Ball:
    """The neighbourhood of a least-squares solution, in which ``x = start + R^-1 z``.

    Attributes
    ----------
    root : (size, size) lower triangular; its product with its transpose is the gram matrix.
    held : (size, k) orthonormal, directions of `z` that would move what must be zero.
    """

    start: Array
    root: Array
    held: Array

    @classmethod
    def of(cls, start: Array, gram: Array, equal: csr_matrix) -> Ball:
        from scipy.linalg import cholesky

        ball = cls(start, cholesky(gram, lower=True), np.zeros((len(start), 0)))
        return cls(start, ball.root, np.linalg.qr(ball.seen(equal).T)[0])

    def seen(self, rows: csr_matrix) -> Array:
        """What rows (k, size) of `x` are as rows (k, size) of `z`."""
        from scipy.linalg import solve_triangular

        out: Array = solve_triangular(self.root, rows.T.toarray(), lower=True).T
        return out - (out @ self.held) @ self.held.T

    def at(self, z: Array) -> Array:
        from scipy.linalg import solve_triangular

        return np.asarray(self.start + solve_triangular(self.root, z, lower=True, trans="T"), np.float64)


def least_worst(design: csr_matrix, errors: Array, ball: Ball, slopes: Slopes, room: Callable[[Array], float]) -> Array:
    """Values whose worst error is least.

    Parameters
    ----------
    design, errors : (3 n, size) and (3 n,), direction by direction; what is left is ``errors + design @ x``.
    room : how far beyond the least sum of squares within the slopes, that of its argument `x`, it may grow.
    """
    nearest = _within_slopes(ball, slopes)
    best = ball.at(nearest)
    radius = float(np.sqrt(nearest @ nearest + room(best))) * (1 + 1e-9)
    n = len(errors) // 3
    left = errors + design @ ball.start
    asked, steep = np.zeros(0, dtype=np.intp), _beyond(slopes, ball.start, np.zeros(0, dtype=np.intp))
    for _ in range(ROUNDS):
        length = np.linalg.norm((errors + design @ best).reshape(3, n), axis=0)
        bound = length[asked].max() if len(asked) else 0.0
        far = np.setdiff1d(np.flatnonzero(length > (1 + EXACT) * bound), asked)
        over = _beyond(slopes, best, steep)
        if not len(far) and not len(over):
            break
        asked = np.concatenate([asked, far[np.argsort(-length[far])[:POSES]]])
        steep = np.concatenate([steep, over])
        found = _programme(ball, design, left, asked, slopes, steep, radius)
        if found is None:
            break
        best = ball.at(found)
    return best


def _within_slopes(ball: Ball, slopes: Slopes) -> Array:
    """The smallest z (size,) that keeps the slopes."""
    import cvxpy

    cp: Any = cvxpy  # it names its functions without types
    z, steep = np.zeros(len(ball.start)), np.zeros(0, dtype=np.intp)
    for _ in range(ROUNDS):
        over = _beyond(slopes, ball.at(z), steep)
        if not len(over):
            break
        steep = np.concatenate([steep, over])
        rows = ball.seen(slopes.rows[steep])
        basis, factor = np.linalg.qr(rows.T)
        u, at = cp.Variable(basis.shape[1]), cp.Variable(len(steep))
        rules = [at == slopes.rows[steep] @ ball.start + factor.T @ u]
        rules += [at <= slopes.bounds[steep], at >= -slopes.bounds[steep]]
        found = _optimum(cp.Problem(cp.Minimize(cp.sum_squares(u)), rules), u)
        if found is None:
            break
        z = basis @ found
    return z


def _beyond(slopes: Slopes, x: Array, known: Index) -> Index:
    """Slopes that are too steep, those that are asked for already left out."""
    return np.setdiff1d(np.flatnonzero(np.abs(slopes.rows @ x) > (1 + KEPT) * slopes.bounds), known)


def _programme(
    ball: Ball, design: csr_matrix, left: Array, asked: Index, slopes: Slopes, steep: Index, radius: float
) -> Array | None:
    """The z within the radius whose worst error over the poses asked for is least; None if there is no answer."""
    import cvxpy
    from scipy.sparse import vstack

    cp: Any = cvxpy
    poses = np.concatenate([asked + k * (len(left) // 3) for k in range(3)])
    rows = ball.seen(vstack([design[poses], slopes.rows[steep]]).tocsr())
    basis, factor = np.linalg.qr(rows.T)
    # unknowns of their own for what is bounded keep the programme sparse
    u, at, worst = cp.Variable(basis.shape[1]), cp.Variable(len(rows)), cp.Variable()
    now = np.concatenate([left[poses], slopes.rows[steep] @ ball.start])
    residual = cp.reshape(at[: len(poses)], (3, len(asked)), order="C")
    rules: list[Any] = [at == now + factor.T @ u, cp.norm(residual, axis=0) <= worst, cp.norm(u) <= radius]
    if len(steep):
        rules += [at[len(poses) :] <= slopes.bounds[steep], at[len(poses) :] >= -slopes.bounds[steep]]
    found = _optimum(cp.Problem(cp.Minimize(worst), rules), u)
    return None if found is None else np.asarray(basis @ found, np.float64)


def _optimum(problem: Any, x: Any) -> Array | None:
    import cvxpy as cp

    try:
        optimise(problem)
    except cp.error.SolverError:
        return None
    return None if x.value is None or not np.isfinite(x.value).all() else np.asarray(x.value)
