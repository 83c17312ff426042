"""The least worst error near a least-squares solution, within slopes: small second-order cone programmes (CVXPY).

With ``z = R (x - start)``, R the root of the gram matrix, the sum of squares is that of the least squares plus
``|z|^2``, so that what may be given up of it is a ball. In that ball the best ``z`` is a combination of the rows that
hold it back: poses that come to be the worst, and slopes at their bounds. Only those are asked for, round by round (an
exchange method), so that a programme has as many unknowns as rows that matter, however many poses and values there are.

The programme of a round knows a few poses only, and the least worst error over them is a lower bound of that over all:
the rounds end when the best solution seen is next to it. A slight price on ``|z|^2`` chooses among solutions that are
next to equal the one nearest to least squares; without it each round would go to the edge of the ball, for nothing.
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

ROUNDS = 25
POSES = 40  # that a round adds
EXACT = 0.01  # of the worst error: what is nearer to the lower bound is not worth another round,
KEPT = 0.0005  # nor this of a slope's bound
PRICE = 0.02  # of the worst error, for all that may be given up of the mean square


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
    span : (size, m) orthonormal, directions that `z` may take beyond the slopes' demands; None: all.
    """

    start: Array
    root: Array
    held: Array
    span: Array | None = None

    @classmethod
    def of(cls, start: Array, gram: Array, equal: csr_matrix, moves: csr_matrix | None = None) -> Ball:
        """`moves` (size, m): changes of `x` that are allowed; None: any."""
        from scipy.linalg import cholesky

        free = cls(start, cholesky(gram, lower=True), np.zeros((len(start), 0)))
        held = np.linalg.qr(free.seen(equal).T)[0]
        if moves is None:
            return cls(start, free.root, held)
        z = free.root.T @ moves.toarray()
        both = np.linalg.qr(np.hstack([held, z / np.maximum(np.linalg.norm(z, axis=0), 1e-300)]))[0]
        return cls(start, free.root, held, both[:, held.shape[1] :])

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
    start, n = ball.at(nearest), len(errors) // 3
    square = float(nearest @ nearest + room(start)) * (1 + 1e-9)
    length = _lengths(design, errors, start)
    task = _Near(ball, nearest, np.sqrt(square), PRICE * float(length.max()) / max(square, 1e-300))
    best, least, bound = start, task.worth(length, nearest), 0.0
    asked, steep = np.argsort(-length)[:POSES], _beyond(slopes, start, np.zeros(0, dtype=np.intp))
    for _ in range(ROUNDS):
        poses = np.concatenate([asked + k * n for k in range(3)])
        now = errors[poses] + design[poses] @ start, slopes.rows[steep] @ start
        found = task.programme(design[poses], slopes.rows[steep], now, slopes.bounds[steep])
        if found is None:
            break
        z, low = found
        x, bound = ball.at(z), max(bound, low)
        length, over = _lengths(design, errors, x), _beyond(slopes, x, steep)
        worth = task.worth(length, z)
        if not len(over) and worth < least:
            best, least = x, worth
        if not len(over) and least <= (1 + EXACT) * bound:
            break
        far = np.setdiff1d(np.flatnonzero(length > length[asked].max()), asked)
        asked = np.concatenate([asked, far[np.argsort(-length[far])[:POSES]]])
        steep = np.concatenate([steep, over])
    return best


def _lengths(design: csr_matrix, errors: Array, x: Array) -> Array:
    """Errors (n,) that values leave at the poses."""
    return np.asarray(np.linalg.norm((errors + design @ x).reshape(3, -1), axis=0), np.float64)


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


@dataclass(frozen=True)
class _Near:
    """What all rounds share: they look about `nearest`, the z (size,) of the least squares within the slopes.

    Attributes
    ----------
    radius : of the ball.
    price : of |z|^2, in units of the worst error.
    """

    ball: Ball
    nearest: Array
    radius: float
    price: float

    def worth(self, length: Array, z: Array) -> float:
        """What is made least: the worst error and the price."""
        return float(length.max() + self.price * z @ z)

    def programme(
        self, design: csr_matrix, steep: csr_matrix, now: tuple[Array, Array], bounds: Array
    ) -> tuple[Array, float] | None:
        """The best z and its worth over some poses within some slopes, `now` being what they are at `nearest`."""
        import cvxpy
        from scipy.sparse import vstack

        cp: Any = cvxpy
        span, count = self.ball.span, len(now[0])
        rows = self.ball.seen(vstack([design, steep]).tocsr())
        seen = rows if span is None else rows @ span
        # what no row sees is left as it is, but for what brings it nearer to the least squares
        home = self.nearest if span is None else span.T @ self.nearest
        basis, factor = np.linalg.qr(np.column_stack([seen.T, home]) if home.any() else seen.T)
        factor, here = factor[:, : len(rows)], basis.T @ home
        rest = max(float(self.nearest @ self.nearest - here @ here), 0.0)
        u, worst = cp.Variable(basis.shape[1]), cp.Variable()
        moved, rules = factor.T @ u, []
        if basis.shape[1] == len(rows):  # unknowns of their own for what is bounded keep the programme sparse
            moved = cp.Variable(len(rows))
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
        optimise(problem)
    except cp.error.SolverError:
        return None
    return None if x.value is None or not np.isfinite(x.value).all() else np.asarray(x.value)
