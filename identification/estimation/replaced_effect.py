"""The fit of a machine with one effect more, or another in the place of one, from the sums of the fit that is there.

``M'WM`` of two such models differs in the columns of that effect only: their products with all columns are one pass
over the rows. Everything else is taken over, as are noise levels, groups and values, from which few steps are left.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from identification.estimation.least_squares import Solver
from identification.estimation.normal_priors import known_beforehand
from identification.estimation.result import Fit
from identification.observation.assembly import Problem, group_order
from identification.observation.normal_equations import accumulate
from identification.runtime.blas import one_blas_thread

LEFT = 1e-9  # of a column's square beyond others: less is a dependence, as where a fit looks for what its sample missed


def refitted(chain: Chain, problem: Problem, fit: Fit, effect_sizes: float | None) -> dict[str, float] | None:
    """All parameters by name, of the chain fitted to the rows of a fit.

    None where another machine differs by more than an effect, or the fit's sums are weighted or of a tightened prior.

    Parameters
    ----------
    problem : of the chain, in the frames of the fit.
    effect_sizes : as of `identification.estimation.fit.fit_machine`.
    """
    solution, number = fit.solution, _other(fit.chain, chain)
    if number is None or fit.sorting is not None or fit.streamed is not None or np.isfinite(solution.within):
        return None
    names = dict(zip(solution.unknowns, solution.unknowns, strict=True))
    for k, (before, ids) in enumerate(zip(fit.chain.effect_ids, chain.effect_ids, strict=False)):
        names |= dict.fromkeys(before, "") if k == number else dict(zip(before, ids, strict=True))
    place = problem.place()
    shared = [(old, place[names[name]]) for old, name in enumerate(solution.unknowns) if names[name]]
    old, new = np.array(shared, dtype=np.intp).T
    own = np.setdiff1d(np.arange(len(place)), new)

    def of_all(values: Array) -> Array:
        out = np.zeros(len(place))
        out[new] = values[old]
        return out

    with one_blas_thread():
        beforehand = known_beforehand(chain, problem.unknowns, effect_sizes)
        solver = Solver(chain, problem.views, problem.unknowns, None, problem.declared, True, None, beforehand)
        solver.sigma, solver.taken = dict(solution.sigma), of_all(solution.values)
        solver.at = None if solution.at is None else of_all(solution.at)
        sums = accumulate(problem.views, place, solver.taken, solver.held, at=solver.at, products_of=own)
        for kind, fresh in sums.items():
            fresh.gram[:, own] = fresh.gram[own].T
            fresh.gram[np.ix_(new, new)] = solution.sums[kind].gram[np.ix_(old, old)]
        groups, gone = solution.groups, ~np.isin(solution.groups.base, old)
        base = new[np.isin(old, groups.base)]
        # a column that depended on those of the effect that is gone need not depend on others
        freed = new[(groups.coefficients[np.ix_(gone, old)] != 0).any(axis=0)]
        order = [j for j in group_order(chain, problem.unknowns) if j in {*own.tolist(), *freed.tolist()}]
        base = np.sort([*base, *_independent(solver.total(sums)[0], base, np.array(order, dtype=np.intp))])
        values, _, _, converged = solver.iterate(base, sums)
    return dict(zip(problem.unknowns, values.tolist(), strict=True)) if converged else None


def _other(before: Chain, after: Chain) -> int | None:
    """Number of the one effect in which a machine differs from one before, or that it has more, as its last one.

    None where they differ otherwise.
    """
    one, other = before.machine, after.machine
    more = len(other.effects) - len(one.effects)
    if more not in (0, 1) or replace(one, effects=other.effects) != other:
        return None
    numbers = [k for k, (a, b) in enumerate(zip(one.effects, other.effects, strict=False)) if a != b]
    numbers += [len(one.effects)] * more
    return numbers[0] if len(numbers) == 1 else None


def _independent(gram: Array, base: Index, others: Index) -> list[int]:
    """The first of other columns that are independent of a base, and of those before, by the products of all."""
    from scipy.linalg import cho_factor, cho_solve

    scale = 1 / np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    unit = gram * np.outer(scale, scale)
    across = unit[np.ix_(base, others)]
    left = unit[np.ix_(others, others)] - across.T @ cho_solve(cho_factor(unit[np.ix_(base, base)]), across)
    out = []
    for k, column in enumerate(others.tolist()):
        if left[k, k] > LEFT:
            out.append(column)
            left -= np.outer(left[:, k], left[k]) / left[k, k]
    return out
