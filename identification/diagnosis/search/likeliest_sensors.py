"""Of the sensors that a finding may follow the likeliest, by evidence averaged over time constants and first states.

The search takes the sensor whose best lag in equilibrium fits best. Another one, from another state in the first row,
may be likelier as a whole; and two sensors or lags together may do what one does that did not begin in equilibrium.
"""

from __future__ import annotations

import numpy as np

from errormodel.channels import root
from errormodel.effects.base import Effect
from errormodel.effects.shared import lags as lags_tried
from identification.diagnosis.decisions.constants import CLEARLY, NO_WORSE
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog, Outcome, ratio
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search.candidates import Candidates, score_of
from identification.diagnosis.search.conditional_evidence import conditional_scores
from identification.diagnosis.search.criteria import predictive_deviation
from identification.diagnosis.search.model import EffectModel, of_groups
from identification.diagnosis.search.other_lags import Lags, by_others, in_equilibrium, lags_behind, sensors_of
from identification.diagnosis.search.scoring import Step
from identification.diagnosis.search.shape_fit import optimised


def with_likeliest_sensors(model: EffectModel, candidates: Candidates, log: DecisionLog = UNRECORDED) -> EffectModel:
    """The model in which each finding by a temperature follows the likeliest one."""
    out = model
    for k in range(len(model.findings)):
        groups = out.findings
        main, *more = groups[k]
        further = [s for s in more if _of_one_form(main.effect, s.effect)]
        sensors = {*sensors_of(main.effect)}
        if main.effect.random or not sensors:
            continue
        # curves of one of its sensors, which refine its form, would leave that sensor nothing
        curves = [s for s in more if s.effect.empirical and sensors & {root(d) for d in s.effect.drivers}]
        effect = _likeliest(out, main, further, curves, log)
        if effect is None:
            continue
        rest = [s for s in more if not any(s is own for own in further)]
        other = of_groups(out.start, [*groups[:k], [main.of_another(effect), *rest], *groups[k + 1 :]])
        errors = predictive_deviation(other.linear), predictive_deviation(out.linear)
        better = errors[0] < NO_WORSE * errors[1]
        word: Outcome = "preferred" if better else "refused"
        log.add("likeliest-sensor", word, effect, ratio(*errors), NO_WORSE, beside=main.effect)
        out = other if better else out
    return out if out is model else conditional_scores(out, candidates, log)


def _of_one_form(one: Effect, other: Effect) -> bool:
    """Whether they differ by their temperatures and lags only."""
    own, more = (e.model_dump(exclude={*e.same_parameter()}) for e in (one, other))
    return one.effect == other.effect and own == more


def _likeliest(
    model: EffectModel, main: Step, further: list[Step], curves: list[Step], log: DecisionLog
) -> Effect | None:
    """The effect by the likeliest sensor; None where it is as it was."""
    beside = model.without([main, *further, *curves])
    every = [lags_behind(beside, e) for e in (main.effect, *by_others(beside, main.effect))]
    averaged = np.array([own.averaged for own in every])
    best = int(np.argmax(averaged))
    if further:
        both, linear = 0.0, beside
        for step in (main, *further):
            both += (score_of(linear, step.effect) or (0.0,))[0]
            linear = linear.with_effect(step.effect)
        # of as many sensors and lags the likeliest were taken, each time; and a form of two is as unlikely as any other
        least = both - (1 + len(further)) * np.log(len(every) * len(lags_tried(beside.scene))) - CLEARLY
        one = averaged[best] - np.log(len(every))
        log.add("one-lag-instead", "preferred" if one > least else "refused", every[best].effect, one, float(least))
        if one <= least:
            return None
    elif best == 0:
        return None
    return _at_its_best(beside, every[best])


def _at_its_best(beside: LinearModel, lags: Lags) -> Effect | None:
    """The effect with the likeliest time constant and first state of a sensor."""
    effect = in_equilibrium(lags.effect)
    if not hasattr(effect, "tau"):
        return effect
    family = [effect.model_copy(update={"tau": tau}) for tau in lags_tried(beside.scene)]
    scores = [(score_of(beside, e) or (-np.inf,))[0] for e in family]
    first = int(np.argmax(scores))
    step = optimised(beside, family[first], family, scores[first])
    return None if step is None else step.effect
