"""What a recording leaves open of effects, with all parameters fitted to it; time constants by profile likelihood.

The likelihood, maximised over all other parameters, is averaged over the logarithm of the time constant: what lies
below the likeliest, and what above, is represented by its root mean square (Y. Pawitan, In All Likelihood, 2001,
section 3.4, of the profile likelihood).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np

from errormodel.channels import channel
from errormodel.effects.base import Effect
from identification.diagnosis.results.effect_size import Amount
from identification.diagnosis.results.findings import explanations
from identification.diagnosis.results.other_sensors import sensors_probability
from identification.diagnosis.search.candidates import WIDEST
from identification.diagnosis.search.model import EffectModel
from identification.diagnosis.search.other_lags import SELDOM, lags_left_open, rows_of
from identification.diagnosis.search.scoring import Step
from identification.estimation.fit import parameters_of
from identification.estimation.result import Fit
from identification.runtime.memory import give_back
from identification.uncertainty.other_effects import OtherEffect

FARTHEST = np.log(30.0)  # logarithm of the largest ratio: beyond it a lag is a line in time, or none
STEPS = 32  # on either side
CLEAR = 4.0  # chi-squared: two standard uncertainties
NOT_SETTLING = (
    0.5  # of 15 effects of four simulators by others that were called warm-up nobody had recorded the cause of 7
)
MOST = 4  # other places and names of an effect: each is a fit
SURE = FARTHEST / STEPS  # a tenth of the time constant: what is better known changes no prediction by more than that


def other_effects(final: Fit, model: EffectModel, first: int) -> tuple[OtherEffect, ...]:
    """Other time constants, sensors, first states, places and names that the recording leaves open, all fitted to them.

    Of each time constant that is not well known there is a smaller and a larger one.

    Parameters
    ----------
    first : number of the model's first effect among the machine's.
    """
    out = []
    for number, step in enumerate(model.steps):
        effect = step.effect
        if step.parent is not None or effect.random:  # a further lag corrects the form of a first one
            continue
        elsewhere = [(e, p) for s, p in explanations(step)[1:] if p > SELDOM and not (e := s.effect).empirical][:MOST]
        trials = list[tuple[dict[str, float | str], float]]()
        if names := _time_constants(effect, final):
            rise = _rise(final, model, step)
            for name in names:
                of_value = partial(_with, rise, name)
                trials += [({name: value}, weight) for value, weight in _sides(float(getattr(effect, name)), of_value)]
        others = lags_left_open(final, model, step)
        by_others = min(sum(sensors_probability(others, effect).values()), 1.0)
        trials = [(options, (1 - by_others) * weight) for options, weight in trials] + others
        if "ends" in type(effect).model_fields:
            ends = {"ends": float(np.max(channel(final.survey.table, "time")))}
            out.append(OtherEffect(first + number, ends, NOT_SETTLING, final.solution.named()))  # the same in its rows
        same = [OtherEffect(first + number, options, weight, {}) for options, weight in trials]
        named = [OtherEffect(first + number, e.spec.options, weight, {}, e.effect) for e, weight in elsewhere]
        for trial in (*same, *named):
            give_back()  # what the fit before has left
            parameters = parameters_of(trial.machine(final.chain.machine), final, WIDEST)
            out.append(trial.fitted(parameters))
    return tuple(out)


def time_constants(final: Fit, model: EffectModel, step: Step) -> Iterator[Amount]:
    """The time constants of an effect, s, whose standard uncertainty is that of the profile likelihood."""
    if not (names := [n for n in _time_constants(step.effect, final) if n != "period"]):
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
    variance = model.linear.square / model.linear.freedom / rows_of(final, model)
    least = beside.square_with(step.effect)

    def rise(values: Mapping[str, float]) -> float:
        return (beside.square_with(step.effect.model_copy(update=dict(values))) - least) / variance

    return rise


def _time_constants(effect: Effect, final: Fit) -> list[str]:
    """Fields of an effect in seconds that were searched: time constants, and the period of a wave in time."""
    if effect.random:
        return []
    machine = final.chain.machine
    own = [n for n, kind in effect.shapes().items() if kind.searched and not kind.place]
    return [n for n in own if getattr(effect, n) and effect.unit_of_shape(n, machine) == "s"]
