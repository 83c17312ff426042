"""Uncertainty of an effect's form (model discrepancy), added to the covariance of its parameters.

The fit gives the variance of an effect's size for a fixed form. Added to it are the variance of each optimised shape
parameter, and a relative discrepancy by family: no textbook form is exact.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.diagnosis.search.model import EffectModel
from identification.diagnosis.search.scoring import Step
from identification.estimation.result import Fit


def with_form(final: Fit, model: EffectModel, first: int) -> Fit:
    """The fit with the discrepancy of the effects' forms in its covariance; effects from `first` on are the model's.

    An effect may be of another size: the other parameters then follow as if they were fitted with that size, so that
    what is alike in all rows stays the geometry's. And it may depart from its form, in what changes, as they cannot.
    """
    solution = final.solution
    place = {solution.unknowns[j]: k for k, j in enumerate(solution.groups.base)}
    covariance = solution.covariance
    for group in model.findings:
        ids = [final.chain.effect_ids[first + model.steps.index(step)] for step in group]
        names = [name for own in ids for name in own]
        sizes = np.array([solution.values[solution.unknowns.index(name)] for name in names])
        relative_of = [_relative(step) / (1 if len(group) == 1 else 2) for step in group]
        relative = np.repeat(relative_of, [len(own) for own in ids])
        columns = np.vstack([model.start.swept([step.effect])[0][0] for step in group])[:, : len(model.start.index)]
        # two lags that nearly cancel are each much larger than their sum: the uncertainty is that of the sum
        alone = np.sum(sizes**2 * np.sum(columns**2, axis=1))
        part = np.sum((sizes @ columns) ** 2) / alone if alone else 0.0
        kept = [k for k, name in enumerate(names) if name in place]
        base = [place[names[k]] for k in kept]
        variance = (part * (relative * sizes) ** 2)[kept]
        following = np.linalg.solve(solution.covariance[np.ix_(base, base)], solution.covariance[base])
        covariance = covariance + following.T @ (variance[:, None] * following)
        changing = np.repeat([step.effect.changing(model.start.scene) for step in group], [len(own) for own in ids])
        covariance[base, base] += changing[kept] * variance
    return replace(final, solution=replace(solution, covariance=covariance))


def _relative(step: Step) -> float:
    """Standard uncertainty of the form, of the effect's size. A moment changes what lies between two rows only."""
    effect = step.effect
    if effect.random:  # bends to any form
        return 0.0
    shapes = sum(
        bool(getattr(effect, name)) for name, kind in effect.shapes().items() if kind.searched and not kind.sudden
    )
    return float(
        np.hypot(effect.traits().form_uncertainty, np.sqrt(shapes / max(step.delta_chi2, 10.0 * (shapes + 1))))
    )
