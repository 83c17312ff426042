"""Robust least squares of survey rows: an MM-type estimator (V. J. Yohai, Ann. Statist. 15 (1987) 642).

Joint positions are known exactly, so only measured values can be outliers. The start is the fit with the smallest sum
of distances, a convex problem that resists a large minority of outliers of any size. From there rows are reweighted by
a bisquare (`identification.estimation.bisquare`) until convergence: 93 % efficiency on normal rows. Finally each row
is weighted by its probability of being an inlier (`identification.estimation.mixture`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from identification.estimation.least_squares import Solution, identifiable, solve
from identification.estimation.noise import RESIDUAL_ROUND_OFF_SHARE
from identification.estimation.normal_priors import known_beforehand
from identification.estimation.scaled_equations import scaled_inverse, scaled_solve
from identification.estimation.weights import Judgement, judge, no_majority
from identification.observation.models import Kind, View
from identification.observation.normal_equations import accumulate, design_rows, sampled, total, view_vector
from identification.observation.sums import Sums
from identification.runtime.blas import one_blas_thread
from identification.runtime.convex_solver import optimise, sum_of

# Distance from the nominal machine, in median distances, to which rows are shortened for the start: keeps the digits
# of the solver
FAR_TYPICAL_DISTANCES = 100.0
START_SAMPLE_ROWS = 600  # rows of a view used for the start: limits the time
MOST_REWEIGHTINGS = 50
MOST_GROUPINGS = 4  # repetitions in which new weights may change the identifiable groups
STEP_TOLERANCE_SIGMA = 3e-3  # step, in standard uncertainties, at which reweighting stops; by judgement
MOST_HALVINGS = 10  # of a step that leads uphill, to a thousandth
SLOW_STEP_SHARE = 0.9  # of the step before, above which M is taken anew; by judgement: weights alone shrink it faster
STEP_TOLERANCE_RELATIVE = 1e-6  # step relative to the value at which it stops: accuracy of one solution


def first_judgement(
    chain: Chain,
    views: Sequence[View],
    unknowns: Sequence[str],
    held: Array | None = None,
    declared: frozenset[Kind] = frozenset(),
) -> Judgement:
    """First weights of the rows, from the fit with the smallest sum of distances to a sample of them.

    Parameters
    ----------
    unknowns : names of the parameters to estimate.
    held : (chain parameters,) values of known parameters, mm and rad; None: zero.
    declared : kinds of observation whose uncertainty is declared.
    """
    whole = _Rows.of(chain, views, unknowns, held, declared)
    some = replace(whole, views=tuple(sampled(v, max(START_SAMPLE_ROWS, 4 * len(unknowns))) for v in views))
    base = identifiable(chain, some.views, unknowns).base
    with one_blas_thread():
        left = _least_distances(chain, some.views, unknowns, base, whole.held)
        judged = judge(some.views, left, some.share(len(base)), whole.floor)
        solution = some.solution(judged)
        values, _, _ = some.rounds(solution, judged, 3, moving=True)
        return judge(views, whole.gaps(values), whole.share(solution.groups.rank), whole.floor)


def settle(
    chain: Chain,
    views: Sequence[View],
    unknowns: Sequence[str],
    held: Array | None,
    declared: frozenset[Kind],
    judged: Judgement,
) -> tuple[Solution, Judgement]:
    """Robust estimates from the first weights `judged`, and the final weights.

    Covariance and degrees of freedom are those of the weighted rows. ``sigma`` of undeclared kinds is the robust noise
    level; ``chi2`` is computed from the robust levels.
    """
    rows = _Rows.of(chain, views, unknowns, held, declared)
    solution = rows.solution(judged)
    with one_blas_thread():
        _, judged, _ = rows.rounds(solution, judged, MOST_REWEIGHTINGS)
        solution = rows.solution(judged)
        for _ in range(MOST_GROUPINGS):
            base = solution.groups.base
            _, judged, settled = rows.rounds(solution, judged, MOST_REWEIGHTINGS, sharply=True)
            solution = rows.solution(judged)
            if solution.groups.base.tolist() == base.tolist():
                break
    count = sum(judged.count.values())
    dof = round(count) - sum(s.count for s in solution.sums.values()) + solution.dof
    misfit = sum(n * (judged.sigma[k] if k in declared else 1.0) ** 2 for k, n in judged.count.items())
    kept, converged = judged.kept.get("position", 1.0), solution.converged and settled
    return replace(solution, dof=dof, chi2=misfit * dof / max(count, 1.0), kept=kept, converged=converged), judged


@dataclass(frozen=True)
class _Rows:
    """Views and unknowns of the fit; `floor` are noise levels below which residuals are round-off."""

    chain: Chain
    views: tuple[View, ...]
    unknowns: tuple[str, ...]
    held: Array
    declared: frozenset[Kind]
    floor: dict[Kind, float]

    @classmethod
    def of(
        cls, chain: Chain, views: Sequence[View], unknowns: Sequence[str], held: Array | None, declared: frozenset[Kind]
    ) -> _Rows:
        floor: dict[Kind, float] = {}
        for view in views:
            weight = float(np.median(view.whitener[view.whitener > 0])) if (view.whitener > 0).any() else 1.0
            reach = 1.0 if view.turns else chain.size
            floor[view.kind] = max(floor.get(view.kind, 0.0), RESIDUAL_ROUND_OFF_SHARE * reach * weight)
        held = np.zeros(len(chain.ids)) if held is None else held
        return cls(chain, tuple(views), tuple(unknowns), held, declared, floor)

    @property
    def place(self) -> dict[str, int]:
        return {name: k for k, name in enumerate(self.unknowns)}

    def share(self, rank: int) -> dict[Kind, float]:
        """Degrees of freedom that a fit takes from each kind, in proportion to their observations."""
        counts: dict[Kind, float] = {}
        for view in self.views:
            counts[view.kind] = counts.get(view.kind, 0.0) + view.count
        whole = max(sum(counts.values()), 1.0)
        return {kind: rank * n / whole for kind, n in counts.items()}

    def gaps(self, values: Array) -> list[Array]:
        """Whitened residuals of the exact kinematics, (outputs, n) for each view."""
        return [_gap(view, self.place, values, self.held) for view in self.views]

    def levels(self, judged: Judgement) -> dict[Kind, float]:
        return {k: 1.0 if k in self.declared else s for k, s in judged.sigma.items()}

    def solution(self, judged: Judgement) -> Solution:
        """Least-squares solution of the weighted rows."""
        views = judged.weigh(self.views)
        return solve(self.chain, views, self.unknowns, self.held, self.declared, levels=self.levels(judged))

    def rounds(
        self, solution: Solution, judged: Judgement, most: int, *, moving: bool = False, sharply: bool = False
    ) -> tuple[Array, Judgement, bool]:
        """Iteratively reweighted least squares: values, weights of the rows, and whether it converged.

        `moving` takes noise levels from the quantile of the nearest rows, while the fit may be far off; `sharply` uses
        the outlier mixture instead of the bisquare.
        """
        base, values = solution.groups.base, solution.values
        pick, hold, sums, levels = np.ix_(base, base), np.diag(solution.precision), solution.sums, solution.sigma
        inverse = solution.covariance
        at, last = solution.at, np.inf
        for _ in range(most):
            used = {k: float(np.sum(inverse * own.gram[pick])) / levels[k] ** 2 for k, own in sums.items()}
            used = dict.fromkeys(self.floor, 0.0) | used
            level, common = None if moving else judged.sigma, judged.common if sharply else None
            judged = judge(self.views, self.gaps(values), used, self.floor, level, common)
            levels = self.levels(judged)
            weighed = judged.weigh(self.views)
            if not weighed:
                raise no_majority()
            sums = accumulate(weighed, self.place, values, self.held, at=at)
            gram, slope = total(sums, levels)
            gram, slope = gram + hold, slope - hold @ values
            step, inverse = scaled_solve(gram[pick], slope[base]), scaled_inverse(gram[pick])
            size = float(np.sqrt(max(float(step @ gram[pick] @ step), 0.0)))
            if at is not None:
                step = self.shortened(weighed, levels, values, base, step, _weighted_square(sums, levels))
            values = values.copy()
            values[base] += step
            limit = STEP_TOLERANCE_SIGMA * np.sqrt(np.diag(inverse)) + STEP_TOLERANCE_RELATIVE * np.abs(values[base])
            if (np.abs(step) <= limit).all():
                return values, judged, True
            if at is not None or size > SLOW_STEP_SHARE * last:  # weights settle faster: M has changed
                at = values
            last = size
        return values, judged, False

    def shortened(
        self,
        weighed: Sequence[View],
        levels: Mapping[Kind, float],
        values: Array,
        base: Index,
        step: Array,
        most: float,
    ) -> Array:
        """The step, halved until the sum of weighted squares is no larger than `most`; zero where it is."""
        for _ in range(MOST_HALVINGS):
            trial = values.copy()
            trial[base] += step
            sums = accumulate(weighed, self.place, trial, self.held, gram=False)
            if _weighted_square(sums, levels) <= (1 + STEP_TOLERANCE_RELATIVE) * most:
                return step
            step = 0.5 * step
        return np.zeros_like(step)


def _weighted_square(sums: Mapping[Kind, Sums], levels: Mapping[Kind, float]) -> float:
    return sum(s.square / levels[k] ** 2 for k, s in sums.items())


def _gap(view: View, place: Mapping[str, int], values: Array, held: Array) -> Array:
    """Whitened residual (outputs, n) of a view at the given values."""
    p = view_vector(view, place, values, held)
    gap = np.hstack([view.whiten(part, g) for part, g in view.gaps(p)])
    zeros = [c for c in view.columns[view.exact_columns :] if c in place]  # zeros of instruments are not in the chain
    if zeros:
        rows = design_rows(view, {c: k for k, c in enumerate(zeros)}, len(view))
        gap -= (rows @ values[[place[c] for c in zeros]]).reshape(gap.shape)
    return np.asarray(gap)


def _least_distances(
    chain: Chain, views: Sequence[View], unknowns: Sequence[str], base: Index, held: Array
) -> list[Array]:
    """Whitened residuals (outputs, n) of the linear fit with the smallest sum of scaled distances.

    Each kind of observation is scaled by its median distance. Rows far beyond it are shortened first: the gradient of
    a distance does not depend on its length, and the solver keeps its digits.
    """
    place = {name: k for k, name in enumerate(unknowns)}
    gaps = [_gap(v, {}, np.zeros(0), held) for v in views]
    designs = [design_rows(v, place, len(v))[:, base] for v in views]
    distances = [np.linalg.norm(g, axis=0) for g in gaps]
    scale = _typical(views, distances)
    near = [
        np.minimum(1, FAR_TYPICAL_DISTANCES * scale[v.kind] / np.maximum(d, 1e-300))
        for v, d in zip(views, distances, strict=True)
    ]
    aims = [g * s for g, s in zip(gaps, near, strict=True)]
    left = aims
    for _ in range(1 + (len(scale) > 1)):  # the scales of several kinds need a first fit
        weights = [np.full(d.size, 1 / scale[v.kind]) for v, d in zip(views, gaps, strict=True)]
        values = _smallest_sum(views, designs, aims, weights, known_beforehand(chain, unknowns, None)[base])
        left = [a - (m @ values).reshape(a.shape) for a, m in zip(aims, designs, strict=True)]
        scale = _typical(views, [np.linalg.norm(g, axis=0) for g in left])
    return [r + (g - a) for r, g, a in zip(left, gaps, aims, strict=True)]


def _smallest_sum(
    views: Sequence[View], designs: Sequence[Array], aims: Sequence[Array], weights: Sequence[Array], precision: Array
) -> Array:
    """Values (p,) that minimise the sum of the weighted distances: a second-order cone problem."""
    import cvxpy as cp
    from cvxpy.atoms.affine.reshape import reshape
    from cvxpy.atoms.norm import norm
    from cvxpy.atoms.sum_squares import sum_squares

    A = np.vstack([m * w[:, None] for m, w in zip(designs, weights, strict=True)])
    b = np.concatenate([a.ravel() * w for a, w in zip(aims, weights, strict=True)])
    norms = np.linalg.norm(A, axis=0)
    Q, R = np.linalg.qr(A / norms)
    unit = np.sqrt(len(Q))
    x = cp.Variable(Q.shape[1])
    ends = np.cumsum([a.size for a in aims])
    inverse = np.linalg.inv(R) * unit / norms[:, None]
    goal = 0.5 * sum_squares((np.sqrt(precision)[:, None] * inverse) @ x)
    for a, end in zip(aims, ends, strict=True):
        rest = b[end - a.size : end] - (unit * Q[end - a.size : end]) @ x
        goal += sum_of(norm(reshape(rest, a.shape, order="C"), 2, axis=0))
    optimise(cp.Problem(cp.Minimize(goal)))  # an inexact solution is accurate enough as a start
    start = unit * (Q.T @ b) / len(Q) if x.value is None else x.value
    return np.asarray(inverse @ start)


def _typical(views: Sequence[View], distances: Sequence[Array]) -> dict[Kind, float]:
    """Median distance of each kind."""
    out: dict[Kind, float] = {}
    for kind in dict.fromkeys(v.kind for v in views):
        own = np.concatenate([d for v, d in zip(views, distances, strict=True) if v.kind == kind])
        out[kind] = max(float(np.median(own)), 1e-300)
    return out
