"""Time constants on either side of the likeliest, as far as the profile likelihood leaves them open.

The likelihood, maximised over all other parameters, is averaged over the logarithm of the time constant: what lies
below the likeliest, and what above, is represented by its root mean square (Y. Pawitan, In All Likelihood, 2001,
section 3.4, of the profile likelihood).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from errormodel.effects.base import Effect
from identification.diagnosis.results.effect_size import Amount
from identification.diagnosis.results.initial_states import CLEAR, initial_states
from identification.diagnosis.search.candidates import WIDEST
from identification.diagnosis.search.model import EffectModel
from identification.diagnosis.search.scoring import Step
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from identification.uncertainty.time_constants import OtherConstant

FARTHEST = np.log(30.0)  # logarithm of the largest ratio: beyond it a lag is a line in time, or none
STEPS = 32  # on either side
SURE = FARTHEST / STEPS  # a tenth of the time constant: what is better known changes no prediction by more than that


def other_constants(final: Fit, model: EffectModel, first: int) -> tuple[OtherConstant, ...]:
    """Of each time constant that is not well known a smaller and a larger one, with all parameters fitted to them.

    Parameters
    ----------
    first : number of the model's first effect among the machine's.
    """
    out = []
    for number, step in enumerate(model.steps):
        if step.parent is not None:  # a further lag corrects the form of a first one
            continue
        if not (names := _time_constants(step.effect, final)):
            continue
        rise, trials = _rise(final, model, step), []
        for name in names:
            for value, weight in _sides(float(getattr(step.effect, name)), partial(_with, rise, name)):
                trials.append(OtherConstant(first + number, name, value, weight, {}))
        for tau, initial, weight in initial_states(model, step.effect, rise):
            trials.append(OtherConstant(first + number, "tau", tau, weight, {}, initial))
        for trial in trials:
            other = fit_machine(trial.machine(final.chain.machine), final.survey, effect_sizes=WIDEST)
            out.append(replace(trial, parameters=other.solution.named()))
    return tuple(out)


def time_constants(final: Fit, model: EffectModel, step: Step) -> Iterator[Amount]:
    """The time constants of an effect, s, whose standard uncertainty is that of the profile likelihood."""
    if not (names := _time_constants(step.effect, final)):
        return
    rise = _rise(final, model, step)
    for name in names:
        value, of_value = float(getattr(step.effect, name)), partial(_with, rise, name)
        sides = [weight * np.log(other / value) ** 2 for other, weight in _sides(value, of_value)]
        spread = np.sqrt(sum(sides) if sides else (2 * SURE) ** 2 / np.mean([of_value(v) for v in _around(value)]))
        yield Amount(f"{step.effect.where}.{step.effect.effect} {name}", value, float(value * spread), "s")


def _around(best: float) -> list[float]:
    """Values a fifth below and above the likeliest."""
    return [best * float(np.exp(x)) for x in (-2 * SURE, 2 * SURE)]


def _sides(best: float, rise: Callable[[float], float]) -> Iterator[tuple[float, float]]:
    """Values and probabilities of what lies below and above the likeliest; none where it is well known.

    Parameters
    ----------
    rise : of chi-squared with the value.
    """
    if min(map(rise, _around(best))) > CLEAR:
        return
    logarithm = SURE * np.arange(-STEPS, STEPS + 1)
    values = (best * np.exp(logarithm)).tolist()
    likelihood = np.exp(-0.5 * np.array([max(rise(x), 0.0) for x in values]))
    for own in (logarithm < 0, logarithm > 0):
        mass = likelihood[own].sum()
        ratio = np.exp(np.sign(logarithm[own][0]) * np.sqrt(np.sum(likelihood[own] * logarithm[own] ** 2) / mass))
        yield best * float(ratio), float(mass / likelihood.sum())


def _with(rise: Callable[[Mapping[str, float]], float], name: str, value: float) -> float:
    """The rise where one field has another value."""
    return rise({name: value})


def _rise(final: Fit, model: EffectModel, step: Step) -> Callable[[Mapping[str, float]], float]:
    """Rise of chi-squared where fields of the step's effect have other values."""
    beside = model.without([step])
    rows = len(final.survey) / max(len(np.unique(model.start.index)), 1)  # that each row of the linear model stands for
    variance, least = model.linear.square / model.linear.freedom / rows, beside.square_with(step.effect)

    def rise(values: Mapping[str, float]) -> float:
        return (beside.square_with(step.effect.model_copy(update=dict(values))) - least) / variance

    return rise


def _time_constants(effect: Effect, final: Fit) -> list[str]:
    """Fields of an effect that are time constants and were searched."""
    if effect.random:
        return []
    machine = final.chain.machine
    own = [n for n, kind in effect.shapes().items() if kind.searched and not kind.place]
    return [n for n in own if getattr(effect, n) and effect.unit_of_shape(n, machine) == "s"]
