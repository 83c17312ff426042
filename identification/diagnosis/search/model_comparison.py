"""Comparison of whole models by their log evidence: searches that start from the alternatives of a finding.

Forward selection is greedy: two effects together can look most like a third one, whose refinements then take up the
rest. The search is therefore repeated from each strong alternative of a finding that needed refinements, or that would
itself need some, and from a second cause where much of a finding was taken for its discrepancy. The model with the most
evidence is kept, and what the others have tells how likely another name is. Two names together are tried where a curve
may be what both do.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from errormodel.arrays import Array
from errormodel.channels import root
from errormodel.effects.base import Effect
from identification.diagnosis.decisions.constants import CLEARLY, LEAST_EVIDENCE, LITTLE, MUCH, NEAR, NO_WORSE
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog, Outcome, named, ratio
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search.candidates import Candidates, score_of
from identification.diagnosis.search.conditional_evidence import MOST_EXAMINED
from identification.diagnosis.search.criteria import base_channels, one_sensor, predictive_deviation
from identification.diagnosis.search.forward_selection import MOST_STEPS, forward_select
from identification.diagnosis.search.model import EffectModel, replayed, steps_of
from identification.diagnosis.search.name_pairs import likeliest_two
from identification.diagnosis.search.refinement import apart, distinct
from identification.diagnosis.search.scoring import DETECT, Step, choose
from identification.diagnosis.search.shape_fit import optimise_shapes
from identification.diagnosis.search.whole_models import Whole
from identification.runtime.memory import give_back
from identification.runtime.parallel import parallel_map
from identification.runtime.progress import Progress, silent

# bytes of a model's basis from which one search is begun and no more: each takes half a gigabyte
LARGE = 4_000_000
MOST_ALTERNATIVES = 3  # of a finding, from which the search is repeated


def compare_alternatives(
    model: EffectModel,
    candidates: Candidates,
    progress: Progress = silent,
    log: DecisionLog = UNRECORDED,
    looked: Mapping[object, Array] | None = None,
    others: Iterable[list[Step]] = (),
) -> tuple[EffectModel, list[Whole]]:
    """The model with the most evidence among the given one and searches from its alternatives and second causes.

    Also of all models that were found what they are called, and their log posterior.

    Parameters
    ----------
    others : steps from which to search as well.
    looked : of findings that the first search compared with others, what was fitted of them then (`reselect`).
    """
    begin = [*_alternatives(model, log), *_second_causes(model, candidates, log), *_two_names(model, candidates, log)]
    begin += _two_members(model, candidates, log)
    begin += others
    best, found = _best_of_searches(model, begin, 1, candidates, progress, log, looked)
    if best is not model:  # it has alternatives of its own
        begun = {_keys(main for main, *_ in model.findings), *map(_keys, begin)}
        again = [steps for steps in _alternatives(best, log) if _keys(steps) not in begun]
        best, more = _best_of_searches(best, again, 1 + len(found), candidates, progress, log, looked)
        found += more
    return best, [Whole.of(model), *found]


def _keys(steps: Iterable[Step]) -> frozenset[object]:
    return frozenset(s.effect.key for s in steps)


def _best_of_searches(
    model: EffectModel,
    begin: Sequence[list[Step]],
    number: int,
    candidates: Candidates,
    progress: Progress,
    log: DecisionLog,
    looked: Mapping[object, Array] | None,
) -> tuple[EffectModel, list[Whole]]:
    """The best among a model and searches that begin with some steps, and what these found.

    Parameters
    ----------
    number : of the first search.
    """
    if not begin:
        return model, []
    # of a model with many steps few searches are begun, the first of all: each takes as long as the search before
    large = model.linear.basis.nbytes > LARGE
    ends, most_steps = np.cumsum([len(steps) for steps in begin]).tolist(), 0 if large else MOST_STEPS
    for first, end in zip(begin[1:], ends[1:], strict=True):
        if end > most_steps:
            log.add("most-searches", "refused", first[-1].effect, end, most_steps)
    begin = [first for k, (first, end) in enumerate(zip(begin, ends, strict=True)) if not k or end <= most_steps]
    logs = [log.branch(number + k) for k in range(len(begin))]
    best, models = model, list[Whole]()
    most = model.log_posterior
    lowest = most - CLEARLY
    with progress("Comparing alternative models"):
        branches = [(model.start.branch(), candidates.branch()) for _ in begin]
        searches = [
            partial(_searched_from, start, tried, dict(looked or {}), lowest, steps, own)
            for (start, tried), steps, own in zip(branches, begin, logs, strict=True)
        ]
        found = parallel_map(searches)
        if large:
            give_back()
    for start, tried in branches:
        model.start.learn(start)
        candidates.learn(tried)
    for own in logs:
        log.join(own)
    chosen = log.search
    for own, steps in zip(logs, found, strict=True):
        other = replayed(model.start, steps)
        models.append(Whole.of(other))
        value = other.log_posterior
        # near-ties go to the model that rests half as much on empirical terms, or else to the likelier of named ones
        forms, before = empirical_evidence(other), empirical_evidence(best)
        if _adds_a_name(other, best):
            # it is detected as in a search; in the place of an unnamed one it is as likely beforehand as names are
            named_instead = _unnamed(other) < _unnamed(best)
            least = most + DETECT + float(np.log(len(candidates.of_key))) - CLEARLY * named_instead
        elif 2 * forms + CLEARLY <= before:
            least = most - CLEARLY
        else:
            least = most + (CLEARLY if forms > 0 else 0.0)
        least = max(least, lowest)
        # two findings of one motion by one cause may hide each other: together they are no explanation
        shown = all(np.isfinite(main.evidence) for main, *_ in other.findings)
        better, what = shown and value > least, f"search {own.search}: {_effects(other)}"
        word: Outcome = "accepted" if better else "refused"
        log.add("model-evidence", word, what, value - most, least - most, beside=_effects(best))
        if better:
            errors = predictive_deviation(other.linear), predictive_deviation(best.linear)
            better = errors[0] < NO_WORSE * errors[1]
            word = "accepted" if better else "refused"
            log.add("model-cross-validation", word, what, ratio(*errors), NO_WORSE, beside=_effects(best))
        if better:
            best, most, chosen = other, value, own.search
    log.add("model-evidence", "kept", f"search {chosen}: {_effects(best)}")
    return best, models


def _effects(model: EffectModel) -> str:
    """The findings of a model, for the log."""
    return " ".join(named(main.effect) for main, *_ in model.findings)


def _searched_from(
    start: LinearModel,
    candidates: Candidates,
    looked: dict[object, Array],
    lowest: float,
    begin: list[Step],
    log: DecisionLog,
) -> tuple[Step, ...]:
    """The steps of a search that begins with some; scored beside each other where its log evidence is not too low.

    Of its own `start` and `candidates` answers and scores are kept: several searches wait until the last has ended.
    """
    steps = forward_select(start, candidates, silent, begin, log, looked, lowest).steps
    start.ended()
    candidates.ended()
    return steps


def _adds_a_name(other: EffectModel, model: EffectModel) -> bool:
    """Whether a model has one finding more, and not by a name that refined one."""
    names, before = (len(_keys(s for s in m.steps if not s.effect.empirical)) for m in (other, model))
    return len(other.findings) > len(model.findings) and names > before


def _unnamed(model: EffectModel) -> int:
    """How many terms have no name."""
    return sum(step.effect.empirical for step in model.steps)


def empirical_evidence(model: EffectModel) -> float:
    """Log Bayes factor carried by empirical terms, and by refinements of another effect type than their finding."""
    return sum(
        step.evidence
        for group in model.findings
        for step in group
        if step.effect.empirical or step.effect.effect != group[0].effect.effect
    )


def _alternatives(model: EffectModel, log: DecisionLog) -> Iterator[list[Step]]:
    """Steps to search from: a strong alternative of each finding, after the steps of the others."""
    groups = model.findings
    for main, *refinements in groups:
        others = steps_of(g for g in groups if g[0] is not main)
        linear = model.without([main, *refinements])
        least = main.marginal - max(LEAST_EVIDENCE, NEAR * main.marginal if refinements else 0.0)
        able = [s for s in main.alternatives if _by_another_name(main.effect, s.effect) and s.evidence >= least]
        if not refinements:  # one that fits as it stands in the textbook is what a search would find of it
            able = [s for s in able if s.evidence_of_form > CLEARLY]
        for alternative in _best_of_names(able)[:MOST_ALTERNATIVES]:
            own = score_of(linear, alternative.effect)
            assert own is not None  # it was scored before
            _, gained, absorbed = own
            log.add(
                "strong-alternative", "examined", alternative.effect, alternative.evidence, least, beside=main.effect
            )
            yield [*others, replace(alternative, delta_chi2=gained, absorbed=absorbed)]


def _second_causes(model: EffectModel, candidates: Candidates, log: DecisionLog) -> Iterator[list[Step]]:
    """Starting points in which the refinements of a finding are a second cause.

    The second cause is the best named effect at another place or by another driver, or a refinement made a finding.
    """
    groups = model.findings
    for main, *more in groups:
        if not _much_refined(main, more):
            continue
        others = steps_of(g for g in groups if g[0] is not main)
        likely = optimise_shapes(model.without(more), candidates, MOST_EXAMINED)
        elsewhere = [s for s in likely if s.effect.where != main.effect.where or distinct(main.effect, s.effect)]
        # refinements that are too large for a discrepancy
        much = [s for s in more if main.effect.empirical or s.delta_chi2 > MUCH * main.delta_chi2]
        named = [s for s in much if s.effect.where != main.effect.where or apart(main.effect, s.effect)]
        begun: set[object] = {main.effect.key}
        for steps in (elsewhere, named):
            able = (s for s in steps if _another_cause(main.effect, s.effect))
            second = replace(max(able, key=lambda s: s.evidence, default=main), parent=None)
            if second.evidence < LEAST_EVIDENCE or second.effect.key in begun:
                continue
            begun.add(second.effect.key)
            log.add("second-cause", "examined", second.effect, second.evidence, LEAST_EVIDENCE, beside=main.effect)
            first = _named(main, model.start, [*others, second], candidates) if main.effect.empirical else main
            yield [*others, first, second]
        for s in much:  # of which the finding may be what is left
            if _by_another_name(main.effect, s.effect) and s.effect.key not in begun:
                begun.add(s.effect.key)
                log.add("second-cause", "examined", s.effect, s.evidence, LEAST_EVIDENCE, beside=main.effect)
                yield [*others, replace(s, parent=None)]


def _much_refined(main: Step, more: Sequence[Step]) -> bool:
    """Whether refinements of a finding have as much evidence as another cause would."""
    return sum(s.evidence for s in more) >= max(LEAST_EVIDENCE, LITTLE * main.evidence)


def _two_names(model: EffectModel, candidates: Candidates, log: DecisionLog) -> Iterator[list[Step]]:
    """Starting points with two names for what a flexible curve, or a finding with much refinement, explains."""
    groups, tried = model.findings, set[frozenset[str]]()
    for main, *more in groups:
        flexible = main.effect.empirical or main.effect.flexible or _much_refined(main, more)
        drivers = frozenset({*main.effect.drivers, main.effect.where})
        # one source of heat is one cause of what its member does
        if not flexible or drivers in tried or one_sensor(main.effect, main.effect):
            continue
        tried.add(drivers)
        others = steps_of(g for g in groups if not {*g[0].effect.drivers} <= drivers)
        both = likeliest_two(model.start, drivers, others, candidates)
        if both and min(s.evidence for s in both[-2:]) > LEAST_EVIDENCE:
            log.add("second-cause", "examined", both[-1].effect, both[-1].evidence, beside=both[-2].effect)
            yield both


def _two_members(model: EffectModel, candidates: Candidates, log: DecisionLog) -> Iterator[list[Step]]:
    """The starting point with two effects of the temperatures that drive several findings, or a finding and a drift.

    What two members do by one heat looks like one effect that does half of both, which had been chosen first.
    """
    groups = model.findings
    own = [g for g in groups if "temperature" in base_channels(g[0].effect)]
    drivers = frozenset(d for g in own for d in g[0].effect.drivers)
    if len(own) < 2 or not any(root(d).startswith("T_") for d in drivers):
        return
    others = steps_of(g for g in groups if not any(g is o for o in own))
    both = likeliest_two(model.start, drivers, others, candidates, at_places=True)
    if both and min(s.evidence for s in both[-2:]) > LEAST_EVIDENCE:
        log.add("second-cause", "examined", both[-1].effect, both[-1].evidence, beside=both[-2].effect)
        yield both


def _best_of_names(steps: Iterable[Step]) -> list[Step]:
    """The step with most evidence of each name, best first."""
    best: dict[str, Step] = {}
    for step in sorted(steps, key=lambda s: -s.evidence):
        best.setdefault(step.effect.effect, step)
    return list(best.values())


def _another_cause(one: Effect, other: Effect) -> bool:
    """Whether an effect is named physics of another cause; a flexible curve is not."""
    return _by_another_name(one, other) and not other.flexible and not one_sensor(one, other)


def _by_another_name(one: Effect, other: Effect) -> bool:
    """Whether an effect is named physics by another name than a finding's."""
    return not other.empirical and other.effect != one.effect


def _named(main: Step, start: LinearModel, others: Sequence[Step], candidates: Candidates) -> Step:
    """The preferred step for an unnamed finding, given other findings."""
    linear = replayed(start, others).linear
    steps = optimise_shapes(linear, candidates, MOST_EXAMINED)
    return choose(steps) if steps else main
