"""Whole explanations beside each other: the name that came first may not be part of the best story.

What two effects do together can look most like a third one, whose refinements then take up the rest. Where a name has
a serious rival and did not explain all by itself, the search goes on from the rival as well, and where much is taken
for its own form, from a second cause; the stories are compared as wholes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from errormodel.effects.base import Effect
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search import correlated_noise as coloured
from identification.diagnosis.search.candidates import Candidates
from identification.diagnosis.search.criteria import heldout_rms, one_sensor
from identification.diagnosis.search.forward_selection import MOST_ALTERNATIVES_TRIED, forward_select
from identification.diagnosis.search.model import EffectModel, replayed
from identification.diagnosis.search.refinement import OWN, apart, distinct
from identification.diagnosis.search.scoring import CLEARLY, NEAR, Step, choose
from identification.diagnosis.search.shape_fit import optimise_shapes
from identification.runtime.parallel import parallel_map
from identification.runtime.progress import Progress, silent

SERIOUS = 7.0  # nats by which a rival may be behind
MOST_RIVALS = 2  # of a finding
OF_REFINED = 3  # of one that is not as its textbook says; then a rival may be behind by `NEAR` of the evidence too
OF_A_FORM = 0.3  # the same of a form, in place of `NEAR`: it may be two names at once
SLIGHT = 0.03  # of a finding's evidence: what is left of a very large one is large too, and no second cause
NO_WORSE = 1.02  # held-out error of a better story: blocks of rows tell such small differences by chance


def compare_alternatives(model: EffectModel, candidates: Candidates, progress: Progress = silent) -> EffectModel:
    """The best of a growth and those that begin with a rival of one of its findings instead, or with a second cause."""
    begin = [[*others, alternative] for alternative, others in _alternatives(model)]
    begin += _second_causes(model, candidates)
    if not begin:
        return model
    best, worth = model, log_evidence(model)
    with progress("Telling it from its rivals' side"):
        told = parallel_map([partial(_searched_from, model.start, candidates, steps) for steps in begin])
    for steps in told:
        other = replayed(model.start, steps)
        value = log_evidence(other)
        # of two that are nearly as good, the one of which half as much rests on forms
        least = worth + (CLEARLY if 2 * empirical_evidence(other) + CLEARLY > empirical_evidence(best) else -CLEARLY)
        if value > least and heldout_rms(other.linear) < NO_WORSE * heldout_rms(best.linear):
            best, worth = other, value
    return best


def _searched_from(start: LinearModel, candidates: Candidates, begin: list[Step]) -> tuple[Step, ...]:
    return forward_select(start, candidates.branch(), begin=begin).steps


def log_evidence(model: EffectModel) -> float:
    """Nats of all effects of a growth together, whatever the noise, less the places that were looked at for each."""
    effects = [s.effect for s in model.steps]
    linear, total = model.start, 0.0
    for curve in (e for e in effects if e.random):
        total += linear.random(linear.columns(curve)[0]).best()[1]
        linear = linear.with_effect(curve)
    # names first: what comes first says whether the usual sizes of the parameters count
    if rest := sorted((e for e in effects if not e.random), key=lambda e: e.empirical):
        [(_, evidence)] = coloured.evidence(linear, [rest])
        total += evidence
    trials = max((s.trials for s in model.steps), default=1)
    return total - len(model.steps) * float(np.log(max(trials, 1)))


def empirical_evidence(model: EffectModel) -> float:
    """Nats of what has no name, and of what is taken for the form of a finding without having its name."""
    return sum(
        step.evidence
        for group in model.findings
        for step in group
        if step.effect.empirical or step.effect.effect != group[0].effect.effect
    )


def _alternatives(model: EffectModel) -> Iterator[tuple[Step, list[Step]]]:
    """Serious rivals, each as a step of its own, with the findings beside which it is to be tried."""
    groups = model.findings
    if len(model.steps) < 2:
        return
    for group in groups:
        main = group[0]
        seen = {main.effect.effect}
        others = [g[0] for g in groups if g[0] is not main]
        linear = model.without(group)
        refined = len(group) > 1
        near = OF_A_FORM if main.effect.empirical else NEAR
        least = main.marginal - (max(SERIOUS, near * main.marginal) if refined else SERIOUS)
        for alternative in sorted(main.alternatives, key=lambda r: -r.evidence):
            effect = alternative.effect
            if effect.empirical or effect.effect in seen or alternative.evidence < least:
                continue
            seen.add(effect.effect)
            if len(seen) > (OF_REFINED if refined else MOST_RIVALS) + 1:
                break
            own = Candidates.of(linear, [effect]).scores(linear)
            drop, absorbed = float(own.delta_chi2[0]), float(own.absorbed[0])
            yield replace(alternative, delta_chi2=drop, absorbed=absorbed), others


def _second_causes(model: EffectModel, candidates: Candidates) -> Iterator[list[Step]]:
    """Beginnings in which what is taken for a finding's own form is a second cause.

    By the likeliest other name at another place, or by something else that drives it; or as it is named already.
    """
    groups = model.findings
    for main, *more in groups:
        if sum(s.evidence for s in more) < max(SERIOUS, SLIGHT * main.evidence):
            continue
        others = [g[0] for g in groups if g[0] is not main]
        likely = optimise_shapes(model.without(more), candidates, MOST_ALTERNATIVES_TRIED)
        elsewhere = [s for s in likely if s.effect.where != main.effect.where or distinct(main.effect, s.effect)]
        # of what has been named already, what is too much for a departure from the finding's form
        much = [s for s in more if main.effect.empirical or s.delta_chi2 > OWN * main.delta_chi2]
        named = [s for s in much if s.effect.where != main.effect.where or apart(main.effect, s.effect)]
        begun: set[object] = {main.effect.key}
        for steps in (elsewhere, named):
            able = (s for s in steps if _another_cause(main.effect, s.effect))
            second = replace(max(able, key=lambda s: s.evidence, default=main), parent=None)
            if second.evidence < SERIOUS or second.effect.key in begun:
                continue
            begun.add(second.effect.key)
            first = _named(main, model.start, [*others, second], candidates) if main.effect.empirical else main
            yield [*others, first, second]


def _another_cause(one: Effect, other: Effect) -> bool:
    """Whether an effect is another cause by its name; a curve that bends to anything is none of its own."""
    named = not (other.empirical or other.flexible) and other.effect != one.effect
    return named and not one_sensor(one, other)


def _named(main: Step, start: LinearModel, others: Sequence[Step], candidates: Candidates) -> Step:
    """What a finding without a name is beside others."""
    linear = replayed(start, others).linear
    steps = optimise_shapes(linear, candidates, MOST_ALTERNATIVES_TRIED)
    return choose(linear, steps) if steps else main
