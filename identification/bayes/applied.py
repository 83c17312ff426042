"""Transfer of a posterior to a fit (means, covariance, shapes), and check of the linear model behind it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from errormodel.arrays import Array
from errormodel.machine import Machine
from identification.bayes.marginal_posterior import Collapsed
from identification.bayes.posterior import Posterior
from identification.bayes.shape_parameters import ShapeInterpolation
from identification.bayes.statistics import posed
from identification.estimation.fit import look_at
from identification.estimation.result import Fit, Spread, residuals_of
from identification.observation.normal_equations import accumulate

DRAWS_COMPARED = 8  # draws at which the linear model is compared with the exact kinematics: limits the time


def machine_at(machine: Machine, interpolations: Sequence[ShapeInterpolation], shapes: Array) -> Machine:
    """The machine with the given shape parameters (all shapes,), on the sampled scale."""
    specs, start = list(machine.effects), 0
    for shape in interpolations:
        effect = shape.effect_at(shapes[start : start + len(shape.names)])
        specs[shape.number] = effect.spec
        start += len(shape.names)
    return replace(machine, effects=tuple(specs))


def with_posterior(fit: Fit, posterior: Posterior) -> Fit:
    """The fit with the posterior's means and covariance, and residuals and test files recomputed from them."""
    values = np.zeros(len(fit.solution.unknowns))
    values[fit.solution.groups.base] = posterior.mean
    solution = replace(fit.solution, values=values, covariance=posterior.covariance / fit.inflation**2)
    zero = np.zeros(len(fit.chain.ids))
    residuals = residuals_of(fit.problem.views, fit.problem.place(), values, zero, len(fit.survey))
    held = {b.statement for b in fit.at_bound}  # notes of the bounded least squares: posterior means are not at bounds
    notes = tuple(n for n in fit.notes if n not in held)
    out = replace(
        fit, solution=solution, residuals=residuals, fitted=Spread.of(residuals), at_bound=(), notes=notes,
    )  # fmt: skip
    return replace(out, tests=tuple(look_at(out, t.survey) for t in fit.tests))


def departure(fit: Fit, linear: Collapsed, values: Array, moved: Array) -> float:
    """Largest error of the log-likelihood of the linear, interpolated model against the exact kinematics.

    It is the range of the difference over a few of the draws, because a constant has no effect.

    Parameters
    ----------
    linear : the linear model.
    values : (n, p) draws of the parameters, mm, rad and derived units.
    moved : (n, coordinates) draws of the hyperparameters, on the sampled scale.
    """
    statistics = linear.statistics
    some = np.linspace(0, len(values) - 1, DRAWS_COMPARED).astype(int)
    values, moved = values[some], moved[some]
    levels, shapes = linear.levels(moved), linear.shapes(moved)
    approximate = -0.5 * np.sum(levels * statistics.squares(values, shapes), axis=1)
    exact = np.empty(DRAWS_COMPARED)
    problem = posed(fit, fit.chain.machine)
    for k in range(DRAWS_COMPARED):
        if statistics.interpolations:
            problem = posed(fit, machine_at(fit.chain.machine, statistics.interpolations, shapes[k]))
        # an effect's parameters keep their names whatever its shape
        place = {name: j for j, name in enumerate(statistics.names)}
        apart = statistics.apart
        views = [v.part(~np.isin(v.index, apart.index)) for v in problem.views if v.kind == apart.kind]
        views += [v for v in problem.views if v.kind != apart.kind]
        sums = accumulate(views, place, values[k], np.zeros(len(problem.chain.ids)), gram=False)
        squares = np.array([sums[kind].square for kind in statistics.kinds])
        exact[k] = -0.5 * statistics.share * float(levels[k] @ squares)
    return float(np.ptp(approximate - exact))
