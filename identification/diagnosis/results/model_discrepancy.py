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
    """The fit with the discrepancy of the effects' forms in its covariance; effects from `first` on are the model's."""
    solution = final.solution
    place = {solution.unknowns[j]: k for k, j in enumerate(solution.groups.base)}
    more = np.zeros(len(place))
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
        for name, variance in zip(names, part * (relative * sizes) ** 2, strict=True):
            if name in place:
                more[place[name]] = variance
    return replace(final, solution=replace(solution, covariance=solution.covariance + np.diag(more)))


def _relative(step: Step) -> float:
    """Standard uncertainty of the form, of the effect's size."""
    effect = step.effect
    if effect.random:  # bends to any form
        return 0.0
    shapes = sum(bool(getattr(effect, name)) for name, kind in effect.shapes().items() if kind.searched)
    return float(
        np.hypot(effect.traits().form_uncertainty, np.sqrt(shapes / max(step.delta_chi2, 10.0 * (shapes + 1))))
    )
