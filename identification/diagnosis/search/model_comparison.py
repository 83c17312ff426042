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
from identification.diagnosis.linear.linear_model import Workbench
from identification.diagnosis.search import correlated_noise as coloured
from identification.diagnosis.search.candidates import Candidates
from identification.diagnosis.search.criteria import heldout_rms, one_sensor
from identification.diagnosis.search.forward_selection import RIVALS, grow
from identification.diagnosis.search.model import Growth, replayed
from identification.diagnosis.search.refinement import OWN, apart, distinct
from identification.diagnosis.search.scoring import CLEARLY, NEAR, Step, choose
from identification.diagnosis.search.shape_fit import polished
from identification.runtime.process_pool import side_by_side
from identification.runtime.progress import Tell, silent

SERIOUS = 7.0  # nats by which a rival may be behind
MOST_RIVALS = 2  # of a finding
OF_REFINED = 3  # of one that is not as its textbook says; then a rival may be behind by `NEAR` of the evidence too
OF_A_FORM = 0.3  # the same of a form, in place of `NEAR`: it may be two names at once
SLIGHT = 0.03  # of a finding's evidence: what is left of a very large one is large too, and no second cause
NO_WORSE = 1.02  # held-out error of a better story: blocks of rows tell such small differences by chance


def retold(growth: Growth, candidates: Candidates, tell: Tell = silent) -> Growth:
    """The best of a growth and those that begin with a rival of one of its findings instead, or with a second cause."""
    begin = [[*others, rival] for rival, others in _rivals(growth)]
    begin += _seconds(growth, candidates)
    if not begin:
        return growth
    best, worth = growth, story(growth)
    with tell("Telling it from its rivals' side"):
        told = side_by_side([partial(_told, growth.start, candidates, steps) for steps in begin])
    for steps in told:
        other = replayed(growth.start, steps)
        value = story(other)
        # of two that are nearly as good, the one of which half as much rests on forms
        least = worth + (CLEARLY if 2 * borrowed(other) + CLEARLY > borrowed(best) else -CLEARLY)
        if value > least and heldout_rms(other.bench) < NO_WORSE * heldout_rms(best.bench):
            best, worth = other, value
    return best


def _told(start: Workbench, candidates: Candidates, begin: list[Step]) -> tuple[Step, ...]:
    return grow(start, candidates.branch(), begin=begin).steps


def story(growth: Growth) -> float:
    """Nats of all effects of a growth together, whatever the noise, less the places that were looked at for each."""
    effects = [s.effect for s in growth.steps]
    bench, total = growth.start, 0.0
    for curve in (e for e in effects if e.tied):
        total += bench.tied(bench.columns(curve)[0]).best()[1]
        bench = bench.with_effect(curve)
    # names first: what comes first says whether the usual sizes of the parameters count
    if rest := sorted((e for e in effects if not e.tied), key=lambda e: e.generic):
        [(_, evidence)] = coloured.evidence(bench, [rest])
        total += evidence
    searched = max((s.searched for s in growth.steps), default=1)
    return total - len(growth.steps) * float(np.log(max(searched, 1)))


def borrowed(growth: Growth) -> float:
    """Nats of what has no name, and of what is taken for the form of a finding without having its name."""
    return sum(
        step.evidence
        for group in growth.findings
        for step in group
        if step.effect.generic or step.effect.effect != group[0].effect.effect
    )


def _rivals(growth: Growth) -> Iterator[tuple[Step, list[Step]]]:
    """Serious rivals, each as a step of its own, with the findings beside which it is to be tried."""
    groups = growth.findings
    if len(growth.steps) < 2:
        return
    for group in groups:
        main = group[0]
        seen = {main.effect.effect}
        others = [g[0] for g in groups if g[0] is not main]
        bench = growth.without(group)
        refined = len(group) > 1
        near = OF_A_FORM if main.effect.generic else NEAR
        least = main.alone - (max(SERIOUS, near * main.alone) if refined else SERIOUS)
        for rival in sorted(main.rivals, key=lambda r: -r.evidence):
            effect = rival.effect
            if effect.generic or effect.effect in seen or rival.evidence < least:
                continue
            seen.add(effect.effect)
            if len(seen) > (OF_REFINED if refined else MOST_RIVALS) + 1:
                break
            own = Candidates.of(bench, [effect]).scores(bench)
            drop, absorbed = float(own.drop[0]), float(own.absorbed[0])
            yield replace(rival, drop=drop, absorbed=absorbed), others


def _seconds(growth: Growth, candidates: Candidates) -> Iterator[list[Step]]:
    """Beginnings in which what is taken for a finding's own form is a second cause.

    By the likeliest other name at another place, or by something else that drives it; or as it is named already.
    """
    groups = growth.findings
    for main, *more in groups:
        if sum(s.evidence for s in more) < max(SERIOUS, SLIGHT * main.evidence):
            continue
        others = [g[0] for g in groups if g[0] is not main]
        likely = polished(growth.without(more), candidates, RIVALS)
        elsewhere = [s for s in likely if s.effect.where != main.effect.where or distinct(main.effect, s.effect)]
        # of what has been named already, what is too much for a departure from the finding's form
        much = [s for s in more if main.effect.generic or s.drop > OWN * main.drop]
        named = [s for s in much if s.effect.where != main.effect.where or apart(main.effect, s.effect)]
        begun: set[object] = {main.effect.key}
        for steps in (elsewhere, named):
            able = (s for s in steps if _another_cause(main.effect, s.effect))
            second = replace(max(able, key=lambda s: s.evidence, default=main), refines=None)
            if second.evidence < SERIOUS or second.effect.key in begun:
                continue
            begun.add(second.effect.key)
            first = _named(main, growth.start, [*others, second], candidates) if main.effect.generic else main
            yield [*others, first, second]


def _another_cause(one: Effect, other: Effect) -> bool:
    """Whether an effect is another cause by its name; a curve that bends to anything is none of its own."""
    named = not (other.generic or other.pliant) and other.effect != one.effect
    return named and not one_sensor(one, other)


def _named(main: Step, start: Workbench, others: Sequence[Step], candidates: Candidates) -> Step:
    """What a finding without a name is beside others."""
    bench = replayed(start, others).bench
    steps = polished(bench, candidates, RIVALS)
    return choose(bench, steps) if steps else main
