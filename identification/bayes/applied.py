"""A fit that holds a posterior: means for values, its covariance, shapes of effects where they are most likely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from errormodel.arrays import Array
from errormodel.machine import EffectSpec, Machine
from identification.bayes.marginal_posterior import Collapsed
from identification.bayes.posterior import Posterior
from identification.bayes.shape_parameters import ShapeInterpolation
from identification.bayes.statistics import posed
from identification.estimation.result import Fit, Spread, residuals_of
from identification.estimation.run import look_at
from identification.observation.normal_equations import accumulate

DRAWS_COMPARED = 8  # draws at which the linear model is compared with the exact kinematics: limits the time


def machine_at(machine: Machine, interpolations: Sequence[ShapeInterpolation], shapes: Array) -> Machine:
    """The machine with shapes (all shapes,) as moved."""
    specs, start = list(machine.effects), 0
    for shape in interpolations:
        effect = shape.effect_at(shapes[start : start + len(shape.names)])
        specs[shape.number] = EffectSpec(effect.effect, effect.model_dump(exclude_defaults=True))
        start += len(shape.names)
    return replace(machine, effects=tuple(specs))


def with_posterior(fit: Fit, posterior: Posterior) -> Fit:
    """The fit with the posterior's means and covariance in place of the closed form's; residuals and tests follow."""
    values = np.zeros(len(fit.solution.unknowns))
    values[fit.solution.groups.base] = posterior.mean
    solution = replace(fit.solution, values=values, covariance=posterior.covariance / fit.inflation**2)
    zero = np.zeros(len(fit.chain.ids))
    residuals = residuals_of(fit.problem.views, fit.problem.place(), values, zero, len(fit.survey))
    held = {b.statement for b in fit.at_bound}  # of the least squares that it began with: means lie within
    notes = tuple(n for n in fit.notes if n not in held)
    out = replace(
        fit, solution=solution, residuals=residuals, fitted=Spread.of(residuals), at_bound=(), notes=notes,
    )  # fmt: skip
    return replace(out, tests=tuple(look_at(out, t.survey) for t in fit.tests))


def departure(fit: Fit, linear: Collapsed, values: Array, moved: Array) -> float:
    """By how many nats the linear, interpolated model misses the exact kinematics' log-likelihood, at most.

    At some of the draws `values` (n, p), `moved` (n, coordinates); differences of draws are what counts.
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
        views = [v.part(~np.isin(v.index, statistics.apart.index)) for v in problem.views if v.kind == "position"]
        views += [v for v in problem.views if v.kind != "position"]
        sums = accumulate(views, place, values[k], np.zeros(len(problem.chain.ids)), gram=False)
        squares = np.array([sums[kind].square for kind in statistics.kinds])
        exact[k] = -0.5 * statistics.share * float(levels[k] @ squares)
    return float(np.ptp(approximate - exact))
