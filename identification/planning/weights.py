"""Approximate optimal designs: weights of the candidate poses by sequential quadratic programming.

``-log det M(w)`` (D-optimality) and the largest predicted variance in the volume are convex in the weights w. The
quadratic problems on the simplex are solved through CVXPY: a few hundred weights whatever the rank, where the
semidefinite form takes minutes at rank 70. Candidates are added by the equivalence theorem (J. Kiefer & J. Wolfowitz,
Canad. J. Math. 12 (1960) 363).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from errormodel.arrays import Array, Index
from identification.planning.design import Space
from identification.runtime.convex_solver import optimise, sum_of

MOST_QP_STEPS = 12  # steps of the sequential quadratic programme
D_OPTIMALITY_GAP = 0.002  # gap of log det per rank to the bound of the equivalence theorem at which it stops
CANDIDATES_PER_RANK = 4  # candidates in a quadratic problem, per rank of the design
MOST_QP_CANDIDATES = 300  # candidates in a quadratic problem: limits the time
ACTIVE_VARIANCE_SHARE = 0.7  # poses of the volume with at least this share of the largest variance are constraints


def optimal_weights(space: Space, worst: bool) -> tuple[Array, float]:
    """Weights (n,) with sum 1 of an optimal design, and an upper bound of ``log det M`` over all weights.

    The weights are D-optimal or, starting there (`worst`), minimise the largest predicted variance in the volume.
    """
    weights = _multiplied(space, np.full(len(space.X), 1 / len(space.X)), 10)
    for _ in range(MOST_QP_STEPS):
        C = _covariance(space, weights)
        leverage = _leverage(space, C)
        if leverage.max() < space.rank * (1 + D_OPTIMALITY_GAP):
            break
        picked = _picked(space, weights, leverage)
        X = space.X[picked]
        P = (X @ C).reshape(-1, space.rank)
        cross = (P @ X.reshape(-1, space.rank).T).reshape(len(X), space.components, len(X), space.components)
        curve = np.square(cross).sum(axis=(1, 3))
        goal = _quadratic(weights[picked], curve, [np.zeros(1), -leverage[None, picked]])
        weights = _line_search(weights, picked, goal, lambda w: -_log_det(space, w))
    excess = float(_leverage(space, _covariance(space, weights)).max()) - space.rank
    ceiling = _log_det(space, weights) + excess  # log det is concave; excess is its slope towards the best candidate
    return (_fairest(space, weights) if worst else weights), ceiling


def _fairest(space: Space, weights: Array) -> Array:
    """Weights that minimise the largest predicted variance in the volume, starting from D-optimal ones."""
    for _ in range(MOST_QP_STEPS):
        C = _covariance(space, weights)
        variances = space.variances(C)
        near = np.argsort(-variances, kind="stable")[: 2 * space.rank]
        near = near[variances[near] > ACTIVE_VARIANCE_SHARE * variances.max()]
        leverage = _leverage(space, C)
        picked = _picked(space, weights, leverage)
        X = space.X[picked]
        P = (X @ C).reshape(-1, space.rank)
        slope = np.array([-np.square(P @ v.T).reshape(len(X), -1).sum(axis=1) for v in space.V[near]])
        cross = (P @ X.reshape(-1, space.rank).T).reshape(len(X), space.components, len(X), space.components)
        curve = np.square(cross).sum(axis=(1, 3)) / space.rank  # per unit of log variance
        goal = _quadratic(weights[picked], curve, [np.log(variances[near]), slope / variances[near, None]])
        before = weights
        weights = _line_search(
            weights, picked, goal, lambda w: float(np.log(space.variances(_covariance(space, w)).max()))
        )
        if np.abs(weights - before).max() < 1e-4:
            break
    return weights


def _quadratic(weights: Array, curve: Array, planes: list[Array]) -> Array:
    """Weights of the same sum that minimise max(``value + slope (w - weights)``) plus the quadratic term."""
    import cvxpy as cp
    from cvxpy.atoms.sum_squares import sum_squares

    values, slopes = planes
    unit = weights.sum() / len(weights)  # the solver sees weights around 1
    factor = np.linalg.cholesky(curve + 1e-9 * np.trace(curve) / len(curve) * np.eye(len(curve))).T
    new, top = cp.Variable(len(weights), nonneg=True), cp.Variable()
    step = new - weights / unit
    scale = unit * float(np.abs(slopes).max())
    limits = [top >= (values - values.max()) / scale + (unit / scale * slopes) @ step, sum_of(new) == len(weights)]
    bend = sum_squares((unit / np.sqrt(scale) * factor) @ step)
    optimise(cp.Problem(cp.Minimize(top + 0.5 * bend), limits))  # may be inexact: a line search follows
    if new.value is None:
        return weights
    found = np.maximum(np.asarray(new.value, dtype=np.float64), 0.0)
    return np.asarray(found * weights.sum() / found.sum())


def _line_search(weights: Array, picked: Index, goal: Array, criterion: Callable[[Array], float]) -> Array:
    """The largest step towards the goal that lowers the criterion."""
    start = criterion(weights)
    for share in (1.0, 0.5, 0.25, 0.1, 0.03):
        new = weights.copy()
        new[picked] += share * (goal - weights[picked])
        if criterion(new) < start - 1e-9:
            return new
    return weights


def _multiplied(space: Space, weights: Array, rounds: int) -> Array:
    """Rounds of ``w <- w leverage / rank``, which never lower the determinant (S. D. Silvey et al. 1978)."""
    for _ in range(rounds):
        weights = weights * _leverage(space, _covariance(space, weights)) / space.rank
        weights = weights / weights.sum()
    return weights


def _picked(space: Space, weights: Array, leverage: Array) -> Index:
    """The candidates of largest weight and of largest leverage."""
    count = min(len(weights), CANDIDATES_PER_RANK * space.rank, MOST_QP_CANDIDATES)
    heavy = np.argsort(-weights, kind="stable")[: count // 2]
    return np.union1d(heavy, np.argsort(-leverage, kind="stable")[: count - count // 2])


def _covariance(space: Space, weights: Array) -> Array:
    """Covariance (r, r) of weights (n,)."""
    live = weights > 0
    rows = (space.X[live] * np.sqrt(weights[live])[:, None, None]).reshape(-1, space.rank)
    return np.asarray(np.linalg.inv(rows.T @ rows + 1e-12 * np.eye(space.rank)))


def _log_det(space: Space, weights: Array) -> float:
    """Logarithm of the determinant of the information of weights (n,)."""
    return -float(np.linalg.slogdet(_covariance(space, weights))[1])


def _leverage(space: Space, C: Array) -> Array:
    """Leverage (n,) ``tr X_i C X_i'``: its mean over the weights is the rank; at the optimum its maximum as well."""
    return np.asarray(np.einsum("nia,ab,nib->n", space.X, C, space.X, optimize=True))
