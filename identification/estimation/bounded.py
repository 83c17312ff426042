"""Least squares with bounds on parameter groups: signs that physics prescribes for effects, and the user's bounds.

The bounded estimate is the point within the bounds with the smallest Mahalanobis distance (covariance of the fit) from
the unbounded estimate: a convex quadratic programme over the groups that have bounds. The other groups follow by their
covariance with these. If the true values lie within the bounds, the bounded estimate is never farther from them in this
distance than the unbounded one. Standard uncertainties therefore stay those of the unbounded estimate, which is
cautious at a bound, and the report says so.

If the data contradict the bounds of an effect, the effect or its sign is wrong, and keeping the bounds would bias all
other parameters. These bounds are dropped with a note. Bounds of the user are kept. Units: mm, rad and derived ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.exceptions import nearest
from errormodel.yamlfile import Document
from identification.bayes.settings import PriorForm, prior_error
from identification.estimation.least_squares import Solution
from identification.estimation.scaled_equations import scaled_inverse
from identification.observation.identifiability import Groups
from identification.observation.normal_equations import total

# Distance from a bound, in standard uncertainties relative to the largest step, that counts as at the bound: accuracy
# of the quadratic solver
AT_BOUND_TOLERANCE = 1e-5
CONTRADICTED_SIGMA = 3.0  # standard uncertainties beyond a bound that contradict it: convention, 3 sigma
BEYOND_BOUND_TEXT = (  # part of two messages to the user
    "standard uncertainties beyond a bound are no chance: look for a wrong sign or unit, another cause "
    "(`errormodel diagnose`)"
)


@dataclass(frozen=True)
class AtBound:
    """A group whose estimate lies at a bound.

    Attributes
    ----------
    id : base parameter of the group; `unit`: unit of all values.
    bound : the estimate.
    free, std : estimate and standard uncertainty (k = 1) without bounds.
    given : True for a bound of the user, False for one of physics.
    """

    id: str
    bound: float
    free: float
    std: float
    unit: str
    given: bool

    @property
    def statement(self) -> str:
        """One sentence for the report: the bound, and the estimate without it."""
        beyond = abs(self.free - self.bound) / self.std
        said = (
            f"{self.id} is held at {self.bound:.6g} {self.unit}, the bound that "
            f"{'--priors gives' if self.given else 'physics sets'}: the data alone say "
            f"{self.free:.3g} ± {self.std:.2g} (k = 1), which is also the uncertainty reported"
        )
        if beyond < CONTRADICTED_SIGMA:
            return said
        return f"{said}. {beyond:.0f} {BEYOND_BOUND_TEXT}, or write other bounds in --priors"


def limits(
    chain: Chain, unknowns: tuple[str, ...], groups: Groups, given: Mapping[str, PriorForm], document: Document | None
) -> tuple[Array, Array]:
    """Lower and upper bound (rank,) of each group, infinite where there is none.

    A group is bounded by the sum of its members' physical bounds; a user's bound on its base parameter replaces them.

    Raises
    ------
    InputError
        A bound names an unknown parameter, or one that is not the base of a group.
    """
    place = {unknowns[j]: k for k, j in enumerate(groups.base)}
    least = [chain.parameters[chain.index[name]].low if name in chain.index else -np.inf for name in unknowns]
    low, high = np.full(groups.rank, -np.inf), np.full(groups.rank, np.inf)
    for k, mix in enumerate(groups.coefficients):
        ends = [(c * least[j], c * np.inf) for j, c in enumerate(mix.tolist()) if c]
        low[k], high[k] = sum(map(min, ends)), sum(map(max, ends))
    for name, form in given.items():
        if name not in unknowns:
            raise prior_error(document, name, "the fit has no such parameter", nearest(name, unknowns))
        if form.low is None and form.high is None:
            continue
        if name not in place:
            cure = "Bound a group's first parameter, as parameters.csv lists them, or give {mean, std} with --bayes"
            raise prior_error(document, name, "bounds on a parameter that this survey does not tell from others", cure)
        low[place[name]] = -np.inf if form.low is None else form.low
        high[place[name]] = np.inf if form.high is None else form.high
    return low, high


def bounded(
    chain: Chain, solution: Solution, given: Mapping[str, PriorForm], document: Document | None
) -> tuple[Solution, tuple[AtBound, ...], tuple[str, ...]]:
    """The bounded solution.

    Parameters
    ----------
    solution : unbounded least-squares solution.
    given : the user's bounds by parameter name, mm, rad and derived units; `document`: their file, for messages.

    Returns
    -------
    tuple
        The solution within the bounds, the groups at a bound, and notes on bounds that were dropped.

    Raises
    ------
    InputError
        A bound names an unknown parameter, or one that is not the base of a group.
    """
    base = solution.groups.base
    low, high = limits(chain, solution.unknowns, solution.groups, given, document)
    free = solution.values[base]
    low, dropped = _believable(chain, solution, low, given)
    if ((low <= free) & (free <= high)).all():
        return solution, (), dropped
    gram = total(solution.sums, solution.sigma)[0] + np.diag(solution.precision)
    inverse = scaled_inverse(gram[np.ix_(base, base)])
    some = np.flatnonzero(np.isfinite(low) | np.isfinite(high))
    std = np.sqrt(np.diag(inverse))
    below, above = ((side[some] - free[some]) / std[some] for side in (low, high))
    near = _nearest(inverse[np.ix_(some, some)] / np.outer(std[some], std[some]), below, above)
    close = AT_BOUND_TOLERANCE * (1 + np.abs(near).max())
    held = (near - below <= close) | (above - near <= close)
    active, bound = some[held], np.where(near - below <= close, low[some], high[some])[held]
    away = bound - free[active]
    step = inverse[:, active] @ np.linalg.solve(inverse[np.ix_(active, active)], away)
    step[active] = away
    values = solution.values.copy()
    values[base] += step
    sums = {kind: own.moved(base, step) for kind, own in solution.sums.items()}
    worse = float(step @ (gram[np.ix_(base, base)] @ step))
    deviation = np.sqrt(np.diag(solution.covariance))
    at_bound = tuple(
        AtBound(name, float(b), float(free[k]), float(deviation[k]), _unit(chain, name), name in given)
        for k, b in zip(active.tolist(), bound, strict=True)
        for name in [solution.unknowns[base[k]]]
    )
    out = replace(solution, values=values, sums=sums, chi2=solution.chi2 + worse, dof=solution.dof + len(active))
    return out, at_bound, dropped


def _believable(
    chain: Chain, solution: Solution, low: Array, given: Mapping[str, PriorForm]
) -> tuple[Array, tuple[str, ...]]:
    """Lower bounds without those of effects that the data contradict, and a note for each of these."""
    names = [solution.unknowns[j] for j in solution.groups.base]
    std = np.sqrt(np.diag(solution.covariance))
    beyond = (low - solution.values[solution.groups.base]) / std
    low, notes = low.copy(), []
    for ids in chain.effect_ids:
        own = [k for k, name in enumerate(names) if name in ids and name not in given]
        worst = max(own, key=lambda k: beyond[k], default=None)
        if worst is None or beyond[worst] < CONTRADICTED_SIGMA:
            continue
        low[own] = -np.inf  # all bounds of the effect
        unit = _unit(chain, names[worst])
        notes.append(
            f"{names[worst]} is {solution.values[solution.groups.base[worst]]:.3g} ± {std[worst]:.2g} {unit} (k = 1), "
            f"beyond what physics allows: {beyond[worst]:.0f} {BEYOND_BOUND_TEXT}. The bounds of this effect were "
            "dropped"
        )
    return low, tuple(notes)


def _nearest(correlation: Array, low: Array, high: Array) -> Array:
    """The step (p,) within bounds with the smallest Mahalanobis length."""
    from scipy.optimize import lsq_linear

    factor = np.linalg.cholesky(correlation + 1e-12 * np.eye(len(low)))
    whitened = np.linalg.solve(factor, np.eye(len(low)))
    # bounds become active and free again one at a time; only the set of the active ones is used
    found = lsq_linear(whitened, np.zeros(len(low)), (low, high), method="bvls", max_iter=10 * len(low))
    return np.asarray(found.x)


def _unit(chain: Chain, name: str) -> str:
    """Unit of a parameter of the chain; empty for zeros of instruments and labelled frames."""
    return chain.parameters[chain.index[name]].unit if name in chain.index else ""
