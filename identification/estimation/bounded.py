"""Least squares within bounds: what physics allows of an effect (a weight winds a gear one way), and the user.

The bounded estimate is the point within the bounds that is nearest to the free one, as the data measure distance: a
convex quadratic problem over the few groups that have bounds; the others follow as the data tie them to these. In that
distance it is never further from the truth than the free estimate, if the truth is within the bounds. Standard
uncertainties therefore stay those of the free estimate: at a bound they are cautious, and said to be.

Where the data contradict what physics allows of an effect, it is not that effect, or not with that sign: then its
bounds would only bend all the rest, and they are dropped, which is said. What the user gives is kept.
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
from identification.estimation.least_squares import Solution, scaled_inverse
from identification.observation.identifiability import Groups
from identification.observation.normal_equations import total
from identification.runtime.convex_solver import optimise

CLOSE = 1e-5  # standard uncertainties (of the farthest step): at the bound
CONTRADICTED = 3.0  # standard uncertainties beyond the bound: chance no longer explains it
NO_CHANCE = (
    "standard uncertainties beyond a bound are no chance: look for a wrong sign or unit, another cause "
    "(`errormodel diagnose`)"
)


@dataclass(frozen=True)
class AtBound:
    """A group that is held at a bound; `free` and `std` are its estimate and standard uncertainty without bounds."""

    id: str
    bound: float
    free: float
    std: float
    unit: str
    given: bool  # by the user; else by physics

    @property
    def statement(self) -> str:
        """One sentence: what the data alone say."""
        beyond = abs(self.free - self.bound) / self.std
        said = (
            f"{self.id} is held at {self.bound:.6g} {self.unit}, the bound that "
            f"{'--priors gives' if self.given else 'physics sets'}: the data alone say "
            f"{self.free:.3g} ± {self.std:.2g} (k = 1), which is also the uncertainty reported"
        )
        if beyond < CONTRADICTED:
            return said
        return f"{said}. {beyond:.0f} {NO_CHANCE}, or write other bounds in --priors"


def limits(
    chain: Chain, unknowns: tuple[str, ...], groups: Groups, given: Mapping[str, PriorForm], document: Document | None
) -> tuple[Array, Array]:
    """Least and greatest value (rank,) of each group, infinite where there is none.

    A group has what physics leaves of the sum of its members, and by its first parameter what the user says instead.

    Raises
    ------
    InputError
        A bound names what is no parameter, or no group's first.
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
    """The solution within its bounds, what is held at one, and what is to be said of bounds that were dropped."""
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
    close = CLOSE * (1 + np.abs(near).max())
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
    told = tuple(
        AtBound(name, float(b), float(free[k]), float(deviation[k]), _unit(chain, name), name in given)
        for k, b in zip(active.tolist(), bound, strict=True)
        for name in [solution.unknowns[base[k]]]
    )
    out = replace(solution, values=values, sums=sums, chi2=solution.chi2 + worse, dof=solution.dof + len(active))
    return out, told, dropped


def _believable(
    chain: Chain, solution: Solution, low: Array, given: Mapping[str, PriorForm]
) -> tuple[Array, tuple[str, ...]]:
    """Least values without those of effects that the data contradict, and what is said of these."""
    names = [solution.unknowns[j] for j in solution.groups.base]
    std = np.sqrt(np.diag(solution.covariance))
    beyond = (low - solution.values[solution.groups.base]) / std
    low, notes = low.copy(), []
    for ids in chain.effect_ids:
        own = [k for k, name in enumerate(names) if name in ids and name not in given]
        worst = max(own, key=lambda k: beyond[k], default=None)
        if worst is None or beyond[worst] < CONTRADICTED:
            continue
        low[own] = -np.inf
        unit = _unit(chain, names[worst])
        notes.append(
            f"{names[worst]} is {solution.values[solution.groups.base[worst]]:.3g} ± {std[worst]:.2g} {unit} (k = 1), "
            f"beyond what physics allows: {beyond[worst]:.0f} {NO_CHANCE}. The bounds of this effect were dropped"
        )
    return low, tuple(notes)


def _nearest(correlation: Array, low: Array, high: Array) -> Array:
    """The step (p,) within bounds that the inverse of a correlation matrix measures as the shortest."""
    import cvxpy as cp
    from cvxpy.atoms.sum_squares import sum_squares

    factor = np.linalg.cholesky(correlation + 1e-12 * np.eye(len(low)))
    z = cp.Variable(len(low))
    step = factor @ z
    rules = [step[k] >= low[k] for k in np.flatnonzero(np.isfinite(low))]
    rules += [step[k] <= high[k] for k in np.flatnonzero(np.isfinite(high))]
    optimise(cp.Problem(cp.Minimize(sum_squares(z)), rules))  # which bounds hold is all that is asked of it
    return np.asarray(factor @ np.asarray(z.value))


def _unit(chain: Chain, name: str) -> str:
    return chain.parameters[chain.index[name]].unit if name in chain.index else ""
