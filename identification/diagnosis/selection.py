"""Growing the model: the best explanation first, named physics before mere forms, then a second look at each.

What an accepted effect leaves over because nature does not follow textbooks (another exponent, a sensor that lags) is
modelled at the same place and driver as a refinement of the same finding; it is not a second finding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from errormodel.effects.base import Effect
from identification.diagnosis import coloured
from identification.diagnosis.candidates import Candidates, Scores
from identification.diagnosis.choosing import DETECT, FORM, Step, choose, convincing
from identification.diagnosis.growth import Growth, of_groups, replayed, with_step
from identification.diagnosis.judging import heldout_rms, roots
from identification.diagnosis.pairs import best_pair
from identification.diagnosis.refinements import bent, forms, is_departure, left_over, refined, truly_named
from identification.diagnosis.switching import switched
from identification.diagnosis.workbench import Workbench
from identification.progress import Tell, silent
from identification.side_by_side import side_by_side

LEAK = 0.06  # of what is already explained: less than this elsewhere may be the shape of what was found
WORTH = 7.0  # nats below which nothing is looked at further
HARDLY = 1.05  # times the held-out error: what no evidence asks for gains as much by chance
ROUNDED = 0.01  # nats, in scores from columns in single precision
MAYBE = 0.5  # of the best evidence
MOST_FINDINGS = 12
MOST_STEPS = 24
MOST_TOGETHER = 3
SHAPES_TRIED = 3.0  # nats for the shapes of one effect
SWEEPS = 4  # over all time constants
SHAPES = ("period", "by_period", "edge", "by_edge", "per_turn", "tau", "at", "width", "exponent", "overlap")


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
                or grown(growth, _able(growth.bench, likely))
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
    return truly_named(still_needed(growth))


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
    best = replace(best, rivals=_others(steps, best))
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
    scores = candidates.scores(bench)
    ranked = scores.by_key()
    if not ranked or ranked[0][0] < WORTH:
        return None
    steps = _all_polished(bench, candidates, scores, ranked, 12)
    best = choose(bench, steps)
    if "temperature" in roots(best.effect) and (best.effect.generic or not convincing(bench, best)):
        best = _by_two_causes(bench, candidates, steps, best) or best
    return steps, best


def _able(bench: Workbench, likely: Likely) -> Likely:
    """Those that are convincing by themselves: what bends to two effects at once is neither, one of them may be."""
    able = [s for s in likely[0] if convincing(bench, s)] if likely else []
    return (able, choose(bench, able)) if able else None


def _shortlist(candidates: Candidates, ranked: Sequence[tuple[float, int]], first: int) -> list[int]:
    """The first proposals, and the best of each further name that may yet prove the better one when bent a little."""
    names = {candidates.effects[n].effect for _, n in ranked[:first]}
    out = [n for _, n in ranked[:first]]
    for evidence, n in ranked[first:]:
        if evidence < MAYBE * ranked[0][0]:
            break
        if candidates.effects[n].effect not in names:
            names.add(candidates.effects[n].effect)
            out.append(n)
    return out


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
                return rest.with_effect(_with_tau(effect, x)).square

            middle = float(np.log(tau or 6 * quickest))  # none at all: from hardly any to the shortest that was tried
            reach = 1.0 if tau else 1.8
            bounds = (middle - reach, middle + reach)
            found = minimize_scalar(left, bounds=bounds, method="bounded", options={"maxiter": 12})
            if found.fun < rest.with_effect(step.effect).square - 1e-9:
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
    """Each finding once more, with the others in place: another explanation may now be the better one, or none.

    One that stays has from then on the rivals that it has there: what the others explained is no longer theirs.
    """
    for number in [k for k, s in enumerate(growth.steps) if s.refines is None]:
        mine = [s for k, s in enumerate(growth.steps) if number in (k, s.refines)]
        others = [s for s in growth.steps if s not in mine]
        bench = growth.without(mine)
        scores = candidates.scores(bench)
        ranked = scores.by_key()
        steps = _all_polished(bench, candidates, scores, ranked, 8)
        best = choose(bench, steps)
        old = growth.steps[number]
        same = best.effect == old.effect or (len(mine) > 1 and best.effect.key == old.effect.key)
        as_good = same or best.drop < 1.02 * bench.drop(bench.with_effect(old.effect))
        if as_good or not convincing(bench, best):
            own = next((s for s in steps if s.effect.key == old.effect.key), None)
            if own is not None and len(mine) == 1:
                kept = replace(old, evidence=own.evidence, rivals=_others(steps, own))
                growth = replace(growth, steps=tuple(kept if s is old else s for s in growth.steps))
            continue
        # refinements whose finding has gone, or whose number has changed, stand or fall with the next search
        mains = [s for s in others if s.refines is None]
        return replayed(growth.start, [*mains, replace(best, rivals=_others(steps, best))])
    return growth


def _others(steps: Sequence[Step], one: Step) -> tuple[Step, ...]:
    """The rivals of a step: the others, best first."""
    return tuple(s for s in sorted(steps, key=lambda s: -s.evidence) if s is not one)


def _all_polished(
    bench: Workbench, candidates: Candidates, scores: Scores, ranked: Sequence[tuple[float, int]], first: int
) -> list[Step]:
    """The shortlist's proposals, polished."""
    numbers = _shortlist(candidates, ranked, first)
    return side_by_side([partial(_polished, candidates, scores, bench, n, len(ranked)) for n in numbers])


def _polished(candidates: Candidates, scores: Scores, bench: Workbench, number: int, searched: int) -> Step:
    """The proposal with its shape parameters moved off the grid to where they fit best."""
    from scipy.optimize import minimize_scalar

    effect = candidates.effects[number]
    if effect.tied:
        ratio, _, noise = bench.tied(bench.columns(effect)[0]).best()
        effect = effect.model_copy(update={"size": float(f"{np.sqrt(ratio * noise):.3g}")})
    family = [candidates.effects[n] for n in candidates.of_key[effect.key]]
    for name in SHAPES:
        value = getattr(effect, name, None) if name in type(effect).model_fields else None
        if not isinstance(value, float) or value == 0 or effect.tied:  # a curve repeats with the wave that it refines
            continue
        grid = sorted({float(getattr(e, name)) for e in family})
        edge = 0.3 * abs(value)
        below = max((g for g in grid if g < value and g != 0), default=value - edge)
        above = min((g for g in grid if g > value and g != 0), default=value + edge)
        lowest, highest = type(effect).bounds(name)
        below, above = max(below, lowest), min(above, highest)

        def left(x: float, name: str = name, effect: Effect = effect) -> float:
            return bench.with_effect(effect.model_copy(update={name: float(x)})).square

        found = minimize_scalar(left, bounds=(below, above), method="bounded", options={"maxiter": 20})
        if found.fun < left(value):
            effect = effect.model_copy(update={name: float(found.x)})
    alone = Candidates.of(bench, [effect])
    own = alone.scores(bench)
    if not len(own.evidence):
        evidence, drop, absorbed = (float(v[number]) for v in (scores.evidence, scores.drop, scores.absorbed))
        effect = candidates.effects[number]
        return Step(effect, evidence, drop, absorbed, len(bench.columns(effect)[1]), searched=searched)
    same = len(family)
    evidence, drop, absorbed = (float(v[0]) for v in (own.evidence, own.drop, own.absorbed))
    if scores.evidence[number] > evidence + ROUNDED:  # where the squares are least a size may be beyond what is usual
        effect = candidates.effects[number]
        evidence, drop, absorbed = (float(v[number]) for v in (scores.evidence, scores.drop, scores.absorbed))
    worth, bend = bent(bench, effect)
    count = len(bench.columns(effect)[1])
    return Step(
        effect, evidence + worth - np.log(same), drop + bend, absorbed, count, bend=bend, worth=worth, searched=searched
    )
