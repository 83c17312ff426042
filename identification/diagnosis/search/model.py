"""The current model of the search: accepted effects, each a finding of its own or a refinement of one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search import correlated_noise as coloured
from identification.diagnosis.search.scoring import Step


@dataclass(frozen=True)
class EffectModel:
    """The accepted steps, the linear model before them (`start`), and that with all of them (`linear`)."""

    start: LinearModel
    linear: LinearModel
    steps: tuple[Step, ...] = field(default=())

    @property
    def findings(self) -> list[list[Step]]:
        """Each finding with its refinements."""
        main = [k for k, s in enumerate(self.steps) if s.parent is None]
        return [[self.steps[k], *(s for s in self.steps if s.parent == k)] for k in main]

    def without(self, group: Sequence[Step]) -> LinearModel:
        """The linear model with all steps but those of a group."""
        linear = self.start
        for step in self.steps:
            if step not in group:
                linear = linear.with_effect(step.effect)
        return linear


def replayed(start: LinearModel, steps: Sequence[Step]) -> EffectModel:
    """The model with these steps, in their order."""
    model = EffectModel(start, start)
    for step in steps:
        model = with_step(model, step)
    return model


def with_step(model: EffectModel, step: Step) -> EffectModel:
    """With one more step, and its second cause where it has one."""
    alone = replace(step, partner=())
    out = EffectModel(model.start, model.linear.with_effect(step.effect), (*model.steps, alone))
    number = len(model.steps) if step.parent is None else step.parent
    for effect in step.partner:
        out = with_step(out, Step(effect, 0.0, 0.0, step.absorbed, parent=number))
    return out


def of_groups(start: LinearModel, groups: Sequence[Sequence[Step]]) -> EffectModel:
    """The model with these findings, each with its refinements."""
    model = EffectModel(start, start)
    for main, *more in groups:
        number = len(model.steps)
        for step in (replace(main, parent=None), *(replace(s, parent=number) for s in more)):
            model = with_step(model, step)
    return model


def log_evidence(model: EffectModel) -> float:
    """Log evidence of all effects of a model together, under correlated noise, less the trials factor of each."""
    effects = [s.effect for s in model.steps]
    linear, total = model.start, 0.0
    for curve in (e for e in effects if e.random):
        total += linear.random(linear.columns(curve)[0]).best()[1]
        linear = linear.with_effect(curve)
    # named effects first: the first one's prior sizes are used
    if rest := sorted((e for e in effects if not e.random), key=lambda e: e.empirical):
        [(_, evidence)] = coloured.evidence(linear, [rest])
        total += evidence
    trials = max((s.trials for s in model.steps), default=1)
    return total - len(model.steps) * float(np.log(max(trials, 1)))
