"""Minimax table values near a least-squares solution, with bounded slopes, by second-order cone programming (CVXPY).

With ``z = R (x - start)``, R the transposed Cholesky factor of the Gram matrix, the sum of squares exceeds its
minimum by ``|z|^2``, so the permitted loss in mean square is a ball in z. The optimal z is a combination of the active
rows: poses with the largest error and slopes at their bounds. An exchange method adds violated rows round by round, so
the size of a programme depends on the number of active rows, not on the number of poses and values.

A programme over some poses gives a lower bound of the minimax error over all poses; the rounds stop once the best
solution found is close to it. A small penalty on ``|z|^2`` selects, among nearly equal solutions, the one nearest to
least squares; without it every round would go to the boundary of the ball.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.arrays import Array, Index
from identification.runtime.convex_solver import optimise

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

MOST_EXCHANGES = 25  # rounds of the exchange method; by judgement
POSES_PER_EXCHANGE = 40  # poses that a round adds; by judgement
BOUND_GAP_SHARE = 0.03  # of the lower bound: a solution this close to it is accepted; the last per cent take most time
SOLVER_ACCURACY = 1e-4  # relative, of a programme's objective: far below BOUND_GAP_SHARE
SLOPE_EXCESS_SHARE = 0.0005  # of a slope's bound: smaller violations are accepted; by judgement
DISTANCE_PRICE = 0.02  # penalty at the boundary of the ball, as a share of the largest error; by judgement


@dataclass(frozen=True)
class Slopes:
    """Slopes between neighbouring values, as linear functions (rows, size) of them, and their bounds (rows,)."""

    rows: csr_matrix
    bounds: Array


@dataclass(frozen=True)
class Ball:
    """Neighbourhood of a least-squares solution, in which ``x = start + R^-1 z``.

    Attributes
    ----------
    root : (size, size) lower triangular Cholesky factor of the Gram matrix.
    held : (size, k) orthonormal directions of `z` that equality constraints exclude.
    span : (size, m) orthonormal directions that `z` may take beyond those that the slopes need; None: all.
    through : (size, m) changes of `x` by the directions of `span`.
    """

    start: Array
    root: Array
    held: Array
    span: Array | None = None
    through: Array | None = None

    @classmethod
    def of(cls, start: Array, root: Array, equal: csr_matrix, moves: csr_matrix | None = None) -> Ball:
        """Build the ball; `moves` (size, m) spans the permitted changes of `x`; None: any change."""
        from scipy.linalg import solve_triangular

        free = cls(start, root, np.zeros((len(start), 0)))
        held = np.linalg.qr(free.seen(equal).T)[0]
        if moves is None:
            return cls(start, free.root, held)
        z = free.root.T @ moves.toarray()
        both = np.linalg.qr(np.hstack([held, z / np.maximum(np.linalg.norm(z, axis=0), 1e-300)]))[0]
        span = both[:, held.shape[1] :]
        return cls(start, free.root, held, span, solve_triangular(root, span, lower=True, trans="T"))

    def seen_along(self, rows: csr_matrix) -> Array:
        """Linear functions (k, size) of `x`, expressed as functions (k, m) of the directions of `span`, or of all."""
        return self.seen(rows) if self.through is None else np.asarray(rows @ self.through, np.float64)

    def seen(self, rows: csr_matrix) -> Array:
        """Linear functions (k, size) of `x`, expressed as functions (k, size) of `z`."""
        from scipy.linalg import solve_triangular

        out: Array = solve_triangular(self.root, rows.T.toarray(), lower=True).T
        return out - (out @ self.held) @ self.held.T

    def at(self, z: Array) -> Array:
        from scipy.linalg import solve_triangular

        return np.asarray(self.start + solve_triangular(self.root, z, lower=True, trans="T"), np.float64)


def least_worst(
    design: csr_matrix,
    errors: Array,
    ball: Ball,
    slopes: Slopes,
    room: Callable[[Array], float],
    work: float = np.inf,
) -> Array:
    """Values whose largest error over the poses is smallest.

    Parameters
    ----------
    design, errors : (3 n, size) and (3 n,), all x rows, then y, then z; the residual is ``errors + design @ x``.
    ball : neighbourhood of the least-squares solution.
    slopes : linear functions of the values, and their bounds.
    room : permitted increase of the sum of squares over that of its argument, the least-squares `x` within the slopes.
    work : permitted sum over the rounds of rows times unknowns, to which their time is nearly proportional; at least
        two rounds are carried out.

    Returns
    -------
    (size,) values, the best that was found within the work; the least-squares solution within the slopes if the solver
    finds nothing better.
    """
    nearest = _within_slopes(ball, slopes)
    start, n = ball.at(nearest), len(errors) // 3
    square = float(nearest @ nearest + room(start)) * (1 + 1e-9)
    length = _lengths(design, errors, start)
    task = _Near(ball, nearest, np.sqrt(square), DISTANCE_PRICE * float(length.max()) / max(square, 1e-300))
    best, least, bound = start, task.objective(length, nearest), 0.0
    asked, steep = np.argsort(-length)[:POSES_PER_EXCHANGE], _beyond(slopes, start, np.zeros(0, dtype=np.intp))
    columns = len(ball.start) if ball.span is None else ball.span.shape[1]
    for done in range(MOST_EXCHANGES):
        rows = 3 * len(asked) + len(steep)
        work -= rows * min(rows, columns)
        if not columns or (work < 0 and done > 1):
            break
        poses = np.concatenate([asked + k * n for k in range(3)])
        now = errors[poses] + design[poses] @ start, slopes.rows[steep] @ start
        found = task.programme(design[poses], slopes.rows[steep], now, slopes.bounds[steep])
        if found is None:
            break
        z, low = found
        x, bound = ball.at(z), max(bound, low)
        length, over = _lengths(design, errors, x), _beyond(slopes, x, steep)
        value = task.objective(length, z)
        if not len(over) and value < least:
            best, least = x, value
        if not len(over) and least <= (1 + BOUND_GAP_SHARE) * bound:
            break
        far = np.setdiff1d(np.flatnonzero(length > length[asked].max()), asked)
        asked = np.concatenate([asked, far[np.argsort(-length[far])[:POSES_PER_EXCHANGE]]])
        steep = np.concatenate([steep, over])
    return best


def _lengths(design: csr_matrix, errors: Array, x: Array) -> Array:
    """Lengths (n,) of the residual errors at the poses."""
    return np.asarray(np.linalg.norm((errors + design @ x).reshape(3, -1), axis=0), np.float64)


def _within_slopes(ball: Ball, slopes: Slopes) -> Array:
    """Smallest z (size,) that satisfies the bounds of the slopes."""
    import cvxpy

    cp: Any = cvxpy  # CVXPY has no type annotations
    z, steep = np.zeros(len(ball.start)), np.zeros(0, dtype=np.intp)
    for _ in range(MOST_EXCHANGES):
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
    """Indices of slopes beyond their bounds that are not yet constraints."""
    return np.setdiff1d(np.flatnonzero(np.abs(slopes.rows @ x) > (1 + SLOPE_EXCESS_SHARE) * slopes.bounds), known)


@dataclass(frozen=True)
class _Near:
    """Data shared by all rounds, about `nearest`, the z (size,) of least squares within the slopes.

    Attributes
    ----------
    radius : of the ball.
    price : penalty per unit of |z|^2, in the units of the errors.
    """

    ball: Ball
    nearest: Array
    radius: float
    price: float

    def objective(self, length: Array, z: Array) -> float:
        """Objective: the largest error plus the penalty."""
        return float(length.max() + self.price * z @ z)

    def programme(
        self, design: csr_matrix, steep: csr_matrix, now: tuple[Array, Array], bounds: Array
    ) -> tuple[Array, float] | None:
        """Optimal z and objective for some poses and slopes; `now` holds their values at `nearest`; None: unsolved."""
        import cvxpy
        from scipy.sparse import vstack

        cp: Any = cvxpy
        span, count = self.ball.span, len(now[0])
        seen = self.ball.seen_along(vstack([design, steep]).tocsr())
        # directions that no row depends on stay unchanged, except that z may approach the least-squares solution
        home = self.nearest if span is None else span.T @ self.nearest
        basis, factor = np.linalg.qr(np.column_stack([seen.T, home]) if home.any() else seen.T)
        factor, here = factor[:, : len(seen)], basis.T @ home
        rest = max(float(self.nearest @ self.nearest - here @ here), 0.0)
        u, worst = cp.Variable(basis.shape[1]), cp.Variable()
        moved, rules = factor.T @ u, []
        if basis.shape[1] == len(seen):  # separate unknowns for the bounded quantities keep the programme sparse
            moved = cp.Variable(len(seen))
            rules = [moved == factor.T @ u]
        residual = cp.reshape(now[0] + moved[:count], (3, count // 3), order="C")
        away = u + here
        rules += [cp.norm(residual, axis=0) <= worst, cp.norm(away) <= np.sqrt(max(self.radius**2 - rest, 0.0))]
        if len(bounds):
            rules += [now[1] + moved[count:] <= bounds, now[1] + moved[count:] >= -bounds]
        goal = cp.Problem(cp.Minimize(worst + self.price * (cp.sum_squares(away) + rest)), rules)
        found = _optimum(goal, u)
        if found is None:
            return None
        step = basis @ found
        return self.nearest + (step if span is None else span @ step), float(goal.value)


def _optimum(problem: Any, x: Any) -> Array | None:
    import cvxpy as cp

    try:
        optimise(problem, SOLVER_ACCURACY)
    except cp.error.SolverError:
        return None
    return None if x.value is None or not np.isfinite(x.value).all() else np.asarray(x.value)
