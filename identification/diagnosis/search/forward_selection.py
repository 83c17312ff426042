"""Growing the model: the best explanation first, named physics before mere forms, then a second look at each.

What an accepted effect leaves over because nature does not follow textbooks (another exponent, a sensor that lags) is
modelled at the same place and driver as a refinement of the same finding; it is not a second finding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from errormodel.effects.base import Effect
from identification.diagnosis.linear.linear_model import Workbench
from identification.diagnosis.search import correlated_noise as coloured
from identification.diagnosis.search.candidates import Candidates
from identification.diagnosis.search.criteria import heldout_rms, roots
from identification.diagnosis.search.model import Growth, of_groups, replayed, with_step
from identification.diagnosis.search.refinement import (
    forms,
    is_departure,
    left_over,
    refined,
    truly_named,
    with_sections,
)
from identification.diagnosis.search.scoring import DETECT, FORM, Step, choose, convincing, in_any_noise
from identification.diagnosis.search.sensor_pairs import best_pair
from identification.diagnosis.search.shape_fit import polished, weighed
from identification.diagnosis.search.step_functions import switched
from identification.runtime.progress import Tell, silent

LEAK = 0.06  # of what is already explained: less than this elsewhere may be the shape of what was found
WORTH = 7.0  # nats below which nothing is looked at further
HARDLY = 1.05  # times the held-out error: what no evidence asks for gains as much by chance
MOST_FINDINGS = 12
MOST_STEPS = 24
MOST_TOGETHER = 3
SHAPES_TRIED = 3.0  # nats for the shapes of one effect
SWEEPS = 4  # over all time constants
LIKELY, RIVALS = 12, 8  # proposals that are looked at closely: to be accepted next, and beside a finding

Likely = tuple[list[Step], Step] | None


def grow(bench: Workbench, candidates: Candidates, tell: Tell = silent, begin: Sequence[Step] = ()) -> Growth:
    """Accept explanations one by one, after those it begins with, while evidence and held-out error ask for them."""
    growth = replayed(bench, begin)
    for step in begin:
        candidates = candidates.joined(Candidates.of(bench, list(forms(bench, step.effect))))
    seen = {_causes(growth)}
    while len(growth.steps) < MOST_STEPS:
        last = growth.steps[-1].effect if growth.steps else None
        with tell(f"Looking further than {last.effect} of {last.where}" if last else "Looking for what was left out"):
            likely = _likely(growth.bench, candidates)
            further = (
                grown(growth, likely)
                or together(growth, likely, candidates)
                or grown(growth, able := _able(growth.bench, likely))
                or grown(growth, _predicting(growth, able))
            )
        if further is None:
            break
        added = further.steps[len(growth.steps) :]
        growth = switched(paired(further, candidates))
        for step in added:
            if step.refines is None:
                candidates = candidates.joined(Candidates.of(bench, list(forms(bench, step.effect))))
        beside = len(growth.findings) > 1 and any(s.refines is None for s in added)
        if beside or any(_otherwise_named(growth, s) for s in added if s.refines is not None):
            looked = second_look(growth, candidates)
            if _causes(looked) == _causes(growth) or _causes(looked) not in seen:  # never in a circle
                growth = looked
            seen.add(_causes(growth))
    return in_place(with_sections(truly_named(still_needed(growth))), candidates)


def together(growth: Growth, likely: Likely, candidates: Candidates) -> Growth | None:
    """With two or three further effects at once, each convincing only beside the others, or None.

    What one leaves over while the others are not yet modelled looks like noise that goes along with it.
    """
    trial = growth
    for _ in range(MOST_TOGETHER):
        further = grown(trial, likely, judged=False)
        if further is None or further.steps[len(trial.steps)].refines is not None:
            return None
        trial = paired(further, candidates)
        new = trial.findings[len(growth.findings) :]
        if len(new) > 1 and all(_beside(trial.without(g), g) for g in new):
            return trial
        likely = _likely(trial.bench, candidates)
    return None


def still_needed(growth: Growth) -> Growth:
    """Without findings that what was found after them explains as well, the slightest first."""
    for group in sorted(growth.findings, key=lambda g: g[0].drop):
        others = [g for g in growth.findings if g[0] is not group[0]]
        if others and not _beside(growth.without(group), group):
            fewer = of_groups(growth.start, others)
            if heldout_rms(fewer.bench) < HARDLY * heldout_rms(growth.bench):
                growth = fewer
    return growth


def _beside(bench: Workbench, group: Sequence[Step]) -> bool:
    """Whether a finding is convincing beside what the bench has, whatever the noise."""
    effects = [s.effect for s in group if s.effect.tied == group[0].effect.tied]
    [(_, evidence)] = coloured.evidence(bench, [effects])
    return bool(evidence - np.log(max(group[0].searched, 1)) - SHAPES_TRIED >= DETECT)


def grown(growth: Growth, likely: Likely, *, judged: bool = True) -> Growth | None:
    """With the best of what is likely next, or None where nothing more is to be found.

    Not `judged`: an effect that outweighs the search in white noise will do.
    """
    bench = growth.bench
    if likely is None:
        return None
    steps, best = likely
    explained = sum(s.drop for s in growth.steps if not s.effect.tied)  # a curve has no shape of its own to miss
    own = refined(growth, best)
    if own is None:  # what little there is a finding explains as well, in another form: that is the simpler story
        could = [(s, refined(growth, s)) for s in steps if s.evidence > 0.7 * best.evidence]
        others = [s for s, k in could if k is not None and is_departure(growth, k, best.effect)]
        best = max(others, key=lambda s: s.evidence, default=best)
        own = refined(growth, best) if others else left_over(growth, best)
    if own is not None:
        best = replace(best, refines=own)
    elif (
        not convincing(bench, best, judged=judged)
        or best.drop < LEAK * explained
        or len(growth.findings) >= MOST_FINDINGS
    ):
        # not enough for a finding: perhaps a refinement among what follows
        further = [s for s in steps if s.evidence > WORTH and refined(growth, s) is not None]
        if not further:
            return None
        best = replace(further[0], refines=refined(growth, further[0]))
    tries = [best]
    if best.refines is not None:  # of what else the finding may be made of, the best together with what it is now
        near = [s for s in steps if s is not best and s.evidence > max(WORTH, 0.3 * best.evidence)]
        tries += [replace(s, refines=best.refines) for s in near if refined(growth, s) == best.refines][:4]
    error, _, best_growth = min(
        (heldout_rms(g.bench), k, g) for k, g in enumerate(lags_settled(with_step(growth, s)) for s in tries)
    )
    return best_growth if error < heldout_rms(bench) else None


def _likely(bench: Workbench, candidates: Candidates) -> Likely:
    """The best proposals beside what the bench has, polished, and the one to be preferred among them."""
    steps = polished(bench, candidates, LIKELY, WORTH)
    if not steps:
        return None
    best = choose(bench, steps)
    if "temperature" in roots(best.effect) and (best.effect.generic or not convincing(bench, best)):
        best = _by_two_causes(bench, candidates, steps, best) or best
    return steps, best


def _able(bench: Workbench, likely: Likely) -> Likely:
    """Those that are convincing by themselves: what bends to two effects at once is neither, one of them may be."""
    able = [s for s in likely[0] if convincing(bench, s)] if likely else []
    return (able, choose(bench, able)) if able else None


def _predicting(growth: Growth, able: Likely) -> Likely:
    """Of the convincing ones those that predict left-out rows better: of two sensors alike, one may and one may not.

    Only before anything was found: what is slight beside a finding, and predicts a little, is no further one.
    """
    if able is None or growth.steps:
        return None
    before = heldout_rms(growth.bench)
    better = [s for s in able[0] if heldout_rms(with_step(growth, s).bench) < before]
    return (better, choose(growth.bench, better)) if better else None


def _by_two_causes(bench: Workbench, candidates: Candidates, steps: Sequence[Step], form: Step) -> Step | None:
    """The thermal effect that, once it has two sensors or lags, explains most, if as much as a mere form does."""
    able: list[Step] = []
    for step in sorted((s for s in steps if not s.effect.generic), key=lambda s: -s.evidence):
        found = best_pair(bench, step.effect, candidates.effects)
        if found is None or found[2] < WORTH:
            continue
        one, other, more = found
        both = bench.with_effect(one).with_effect(other)
        drop = bench.drop(both)
        if drop > FORM * form.drop:
            able.append(replace(step, effect=one, partner=(other,), evidence=step.evidence + more, drop=drop))
    return max(able, key=lambda s: s.drop, default=None)


def lags_settled(growth: Growth) -> Growth:
    """All time constants once more, each with the other effects in place: two that lag share what each had alone."""
    from scipy.optimize import minimize_scalar

    for _ in range(SWEEPS if len(growth.steps) > 1 else 0):
        before = growth.bench.square
        for k, step in enumerate(growth.steps):
            tau, quickest = getattr(step.effect, "tau", None), growth.start.scene.duration / 1000
            if tau is None or not quickest:
                continue
            rest = growth.without([step])

            def left(x: float, effect: Effect = step.effect, rest: Workbench = rest) -> float:
                return rest.square_with(_with_tau(effect, x))

            middle = float(np.log(tau or 6 * quickest))  # none at all: from hardly any to the shortest that was tried
            reach = 1.0 if tau else 1.8
            bounds = (middle - reach, middle + reach)
            found = minimize_scalar(left, bounds=bounds, method="bounded", options={"maxiter": 12})
            if found.fun < rest.square_with(step.effect) - 1e-9:
                steps = list(growth.steps)
                steps[k] = replace(step, effect=_with_tau(step.effect, float(found.x)))
                growth = replayed(growth.start, steps)
        if growth.bench.square > 0.995 * before:
            break
    return growth


def paired(growth: Growth, candidates: Candidates) -> Growth:
    """The latest finding as that of two causes, where they explain it better than what it is made of now."""
    *others, group = growth.findings
    if any(s.effect.generic for s in group[:1]) or len(group) > 2:
        return growth
    bench = growth.without(group)
    found = best_pair(bench, group[0].effect, candidates.effects)
    if found is None or found[2] < WORTH:
        return growth
    one, other, evidence = found
    pair = [replace(group[0], effect=one), Step(other, evidence, 0.0, group[0].absorbed)]
    trial = lags_settled(of_groups(growth.start, [*others, pair]))
    return trial if heldout_rms(trial.bench) < heldout_rms(growth.bench) else growth


def _with_tau(effect: Effect, logarithm: float) -> Effect:
    return effect.model_copy(update={"tau": float(f"{np.exp(logarithm):.6g}")})


def _causes(growth: Growth) -> frozenset[object]:
    """What each finding is and where."""
    return frozenset(main.effect.key for main, *_ in growth.findings)


def _otherwise_named(growth: Growth, step: Step) -> bool:
    """Whether a refinement has a name of its own, and no curve's: perhaps it is what the finding should be called."""
    main = growth.steps[step.refines or 0].effect
    return not (step.effect.generic or step.effect.pliant) and step.effect.effect != main.effect


def second_look(growth: Growth, candidates: Candidates) -> Growth:
    """Each finding once more, with the others in place: another explanation may now be the better one, or none."""
    groups = growth.findings
    for group in groups:
        old, *more = group
        bench = growth.without(group)
        steps = polished(bench, candidates, RIVALS)
        if not steps:
            continue
        best = choose(bench, steps)
        same = best.effect == old.effect or (bool(more) and best.effect.key == old.effect.key)
        as_good = same or best.drop < 1.02 * bench.drop(bench.with_effect(old.effect))
        if as_good or not convincing(bench, best):
            continue
        # refinements whose finding has gone, or whose number has changed, stand or fall with the next search
        mains = [g[0] for g in groups if g is not group]
        return replayed(growth.start, [*mains, best])
    return growth


def in_place(growth: Growth, candidates: Candidates) -> Growth:
    """Each finding's evidence and rivals as they are beside the others: what these explain is no longer theirs."""
    groups = growth.findings
    for k, (main, *more) in enumerate(groups):
        bench = growth.without([main, *more])
        steps = polished(bench, candidates, RIVALS)
        own = weighed(bench, main.effect, len(candidates.of_key.get(main.effect.key, [0])), main.searched) or main
        alone = max([own.evidence, *(s.evidence for s in steps if s.effect.key == main.effect.key)])
        # with what is said of it: further causes of its name, such as a second sensor; without a name, all of it
        evidence, beside = own.evidence, bench
        for before, step in pairwise([main, *more]):
            beside = beside.with_effect(before.effect)
            if main.effect.generic or step.effect.effect == main.effect.effect:
                evidence += max([0.0, *Candidates.of(beside, [step.effect]).scores(beside).evidence.tolist()])
        rivals = tuple(s for s in sorted(steps, key=lambda s: -s.evidence) if s.effect.key != main.effect.key)
        groups[k] = [replace(own, evidence=max(evidence, alone), alone=alone, rivals=rivals), *more]
    return of_groups(growth.start, groups)


def in_noise(growth: Growth) -> Growth:
    """Each finding's evidence and its rivals' as noise that goes along from row to row leaves them."""
    groups = growth.findings
    for k, (main, *more) in enumerate(groups):
        steps = [main, *main.rivals]
        nats = in_any_noise(growth.without([main, *more]), steps)
        best, *rivals = (replace(s, evidence=min(s.evidence, n)) for s, n in zip(steps, nats, strict=True))
        rivals.sort(key=lambda r: -r.evidence)
        groups[k] = [replace(best, rivals=tuple(rivals)), *more]
    return of_groups(growth.start, groups)
