"""The current model of the search: accepted effects, each a finding of its own or a refinement of one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from errormodel.arrays import Array
from errormodel.effects.base import SENSORS, Effect
from identification.diagnosis.decisions.constants import ABSORBED, CLEARLY
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search import correlated_noise as coloured
from identification.diagnosis.search.blocks import NOTHING
from identification.diagnosis.search.scoring import DECIMALS, Step

ROUNDED = 1e-12  # of a column's length squared


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
        return self.start.with_effects([s.effect for s in self.steps if s not in group])

    @cached_property
    def log_posterior(self) -> float:
        """Log evidence of all effects together, under correlated noise, with the log prior of each.

        A third sensor or lag of a name, and any further one, is clearly less likely: together they follow any slow
        course, as a curve does. The air at once and a casting an hour later are two.
        """
        effects = [s.effect for s in self.steps]
        linear, total = self.start, 0.0
        for curve in (e for e in effects if e.random):
            [(_, evidence)] = coloured.evidence(linear, [[curve]])
            total, linear = total + evidence, linear.with_effect(curve)
        # named effects first: the first one's prior sizes are used
        if rest := sorted((e for e in effects if not e.random), key=lambda e: e.empirical):
            [(_, evidence)] = coloured.evidence(linear, [rest])
            total += evidence
        lags = [sum(_lagged(s.effect) for s in more) for _, *more in self.findings]
        further = sum(max(count - 1, 0) for count in lags)
        return round(total + sum(s.log_prior for s in self.steps) - CLEARLY * further, DECIMALS)


def _lagged(effect: Effect) -> bool:
    """Whether a named effect follows a temperature, or time with a time constant."""
    return not effect.empirical and any(getattr(effect, name, None) for name in (*SENSORS, "tau"))


def replayed(start: LinearModel, steps: Sequence[Step]) -> EffectModel:
    """The model with these steps, in their order."""
    return EffectModel(start, start.with_effects([s.effect for s in steps]), tuple(steps))


def with_step(model: EffectModel, step: Step) -> EffectModel:
    """With one more step."""
    return EffectModel(model.start, model.linear.with_effect(step.effect), (*model.steps, step))


def of_groups(start: LinearModel, groups: Sequence[Sequence[Step]]) -> EffectModel:
    """The model with these findings, each with its refinements."""
    return replayed(start, steps_of(groups))


def steps_of(groups: Iterable[Sequence[Step]]) -> list[Step]:
    """The steps of findings with their refinements, numbered anew."""
    own = list[Step]()
    for main, *more in groups:
        number = len(own)
        own += [replace(main, parent=None), *(replace(s, parent=number) for s in more)]
    return own


def fitted_of_groups(model: EffectModel) -> list[Array]:
    """What is fitted (N + ties,) of each finding with its refinements, beside the geometry and all others."""
    left = model.start.project(np.vstack([model.start.columns(s.effect)[0] for s in model.steps]))
    owner, values = _values(model, left)
    return [values[owner == main] @ left[owner == main] for main in dict.fromkeys(owner.tolist())]


def done_by_steps(model: EffectModel) -> list[Array]:
    """What each step does in the rows (N + ties,), in units of the noise: with what the geometry would take up, too.

    Parameters that are collinear with the geometry do nothing: nobody knows what.
    """
    columns = np.vstack([model.start.columns(s.effect)[0] for s in model.steps])
    left = model.start.project(columns)
    _, values = _values(model, left)
    values[np.sum(left**2, axis=1) <= (1 - ABSORBED) * np.sum(columns**2, axis=1)] = 0.0
    ends = np.cumsum([len(model.start.columns(s.effect)[0]) for s in model.steps])[:-1]
    return [v @ c for v, c in zip(np.split(values, ends), np.split(columns, ends), strict=True)]


def done_by_groups(model: EffectModel) -> list[Array]:
    """The same of each finding with its refinements."""
    mains = [k if s.parent is None else s.parent for k, s in enumerate(model.steps)]
    done = np.array(done_by_steps(model))
    return [done[np.equal(mains, main)].sum(axis=0) for main in dict.fromkeys(mains)]


def _values(model: EffectModel, left: Array) -> tuple[Array, Array]:
    """Of each column of a model's steps the main step it belongs to, and its estimate beside the geometry.

    Parameters
    ----------
    left : (k, N + ties) what the geometry leaves of the columns.
    """
    start = model.start
    sizes = [len(start.columns(s.effect)[0]) for s in model.steps]
    holds = zip(model.linear.holds[len(start.holds) :], sizes, strict=True)
    tied = np.concatenate([hold if len(hold) else np.zeros(size) for hold, size in holds])
    norms = np.sqrt(np.maximum(np.sum(left**2, axis=1) + tied**2, NOTHING))
    scaled = left / norms[:, None]
    gram = scaled @ scaled.T + np.diag(np.square(tied / norms) + ROUNDED)
    values = np.linalg.solve(gram, scaled @ start.residual) / norms
    mains = [k if s.parent is None else s.parent for k, s in enumerate(model.steps)]
    return np.repeat(mains, sizes), values


def with_estimated_sizes(model: EffectModel) -> list[Effect]:
    """Effects of a model, in its order; of many alike parameters the size is that of random effects beside all others.

    What the rows do not determine of them then stays as small as the rest is: the sine of a wave, at its zeros only,
    or the points of a table that no row is near, would be anything in between.
    """
    out = []
    for step in model.steps:
        effect = step.effect
        if effect.exchangeable:
            beside = model.without([step])
            if size := beside.random(beside.columns(effect)[0]).likeliest_size():
                effect = effect.model_copy(update={"size": float(f"{size:.4g}")})
        out.append(effect)
    return out
