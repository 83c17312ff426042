"""Forward selection of effects by log Bayes factor and cross-validation, with reselection and backward elimination.

The best candidate is added first, named physics before empirical terms. What it leaves over because its form is not
exact (another exponent, a sensor that lags) is added at the same place and driver as a refinement of the same finding,
not as a second finding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from errormodel.arrays import Array
from errormodel.effects.base import Effect
from errormodel.effects.shared import SLOWEST
from identification.diagnosis.decisions.constants import LEAST_EVIDENCE, LITTLE, MUCH, NEAR, NO_WORSE
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog, Outcome, named, ratio
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search import correlated_noise as coloured
from identification.diagnosis.search.candidates import Candidates
from identification.diagnosis.search.conditional_evidence import MOST_EXAMINED, conditional_scores
from identification.diagnosis.search.criteria import (
    base_channels,
    heldout_rms,
    log_likelihood_gain,
    predictive_deviation,
)
from identification.diagnosis.search.model import (
    EffectModel,
    fitted_of_groups,
    of_groups,
    replayed,
    with_step,
)
from identification.diagnosis.search.refinement import (
    could_refine,
    forms,
    left_over,
    other_causes,
    refined,
    refinement_of,
)
from identification.diagnosis.search.scoring import DETECT, Step, accepted, choose
from identification.diagnosis.search.sensor_pairs import best_pair
from identification.diagnosis.search.shape_fit import optimise_shapes
from identification.diagnosis.search.step_functions import switched
from identification.runtime.progress import Progress, silent

MOST_COMPETING = 4  # refinements of one finding that are tried beside the best
MOST_STEPS = 24
LIKELY = 12  # proposals that are looked at closely, to be accepted next
SWEEPS = 4  # over all time constants
SETTLING_ROWS = 2.0  # rows that a time constant of a clock lasts at least

Likely = tuple[list[Step], Step] | None


def forward_select(
    linear: LinearModel,
    candidates: Candidates,
    progress: Progress = silent,
    begin: Sequence[Step] = (),
    log: DecisionLog = UNRECORDED,
    looked: dict[object, Array] | None = None,
    least: float | None = None,
) -> EffectModel:
    """The model after forward selection: effects are added while evidence and cross-validation support them.

    Parameters
    ----------
    begin : steps that the selection starts with.
    log : takes down what is decided.
    looked : of findings (by key) that were compared with others, what was fitted of them then (`reselect`).
    least : log evidence up to which nobody asks for that of each finding beside the others.
    """
    model = replayed(linear, begin)
    for number, step in enumerate(begin):
        log.begin(number)
        log.add("search-from", "added", step.effect)
        if step.parent is None:
            candidates = candidates.joined(Candidates.of(linear, list(forms(linear, step.effect))))
    seen = {_causes(model)}
    looked = {} if looked is None else looked
    while len(model.steps) < MOST_STEPS and not model.linear.exact:
        log.begin(len(model.steps))
        last = model.steps[-1].effect if model.steps else None
        with progress(
            f"Looking further than {last.effect} of {last.where}" if last else "Looking for what was left out"
        ):
            likely = _likely(model.linear, candidates, log)
            further = add_best(model, likely, log) or add_best(model, _accepted(model, likely, log), log)
        if further is None:
            break
        added = further.steps[len(model.steps) :]
        model = switched(add_second_sensor(further, candidates, log), log)
        for step in added:
            if step.parent is None:
                candidates = candidates.joined(Candidates.of(linear, list(forms(linear, step.effect))))
        beside = len(model.findings) > 1 and any(s.parent is None for s in added)
        if beside or any(_otherwise_named(model, s) for s in added if s.parent is not None):
            other = reselect(model, candidates, log, looked)
            if _causes(other) == _causes(model) or _causes(other) not in seen:  # one seen before would start a cycle
                model = other
            else:
                log.add("seen-before", "refused", other.steps[-1].effect)
            seen.add(_causes(model))
    else:
        log.add("most-steps", "refused", None, len(model.steps), MOST_STEPS)
    model = backward_eliminate(_without_hidden_lags(model), candidates, log)
    asked = least is None or model.log_posterior > least
    return conditional_scores(model, candidates, log) if asked else model


def _others(groups: Sequence[Sequence[Step]], group: Sequence[Step]) -> str:
    return " ".join(named(g[0].effect) for g in groups if g is not group)


def backward_eliminate(model: EffectModel, candidates: Candidates, log: DecisionLog = UNRECORDED) -> EffectModel:
    """The model without findings that later ones have made superfluous, the smallest first."""
    for group in sorted(model.findings, key=lambda g: g[0].delta_chi2):
        others = [g for g in model.findings if g[0] is not group[0]]
        if others and not _accepted_beside(model.without(group), group, candidates, log):
            fewer = of_groups(model.start, others)
            errors = predictive_deviation(fewer.linear), predictive_deviation(model.linear)
            out = errors[0] < NO_WORSE * errors[1]
            word: Outcome = "removed" if out else "kept"
            beside = _others(model.findings, group)
            log.add("superfluous-by-cross-validation", word, group[0].effect, ratio(*errors), NO_WORSE, beside=beside)
            if out:
                model = fewer
    return model


def _accepted_beside(linear: LinearModel, group: Sequence[Step], candidates: Candidates, log: DecisionLog) -> bool:
    """Whether a finding passes the acceptance test under correlated noise, given the linear model."""
    effects = [s.effect for s in group if s.effect.random == group[0].effect.random]
    [(_, evidence)] = coloured.evidence(linear, [effects])
    shapes = len(candidates.of_key.get(group[0].effect.key, [0]))  # of which the best was chosen
    surplus = evidence - np.log(max(group[0].trials, 1) * shapes)
    clear = bool(surplus >= DETECT)
    log.add("superfluous", "accepted" if clear else "refused", group[0].effect, float(surplus), DETECT)
    return clear


def add_best(model: EffectModel, likely: Likely, log: DecisionLog = UNRECORDED) -> EffectModel | None:
    """The model with the best proposal added, as a finding or as a refinement; None where none is accepted."""
    if likely is None:
        return None
    steps, best = likely
    own, rule = refinement_of(model, best)
    if own is None and (others := could_refine(model, steps, best)):  # tried before a new finding
        first = max(others, key=lambda s: s.evidence)
        least = (1 - MUCH) * best.evidence
        log.add("refinement-first", "preferred", first.effect, first.evidence, least, beside=best.effect)
        if (more := _with_refinement(model, steps, first, refinement_of(model, first), log)) is not None:
            return more
    if own is None:
        own, rule = left_over(model, best), "left-over"
    if own is not None:
        return _with_refinement(model, steps, best, (own, rule), log)
    explained = sum(s.delta_chi2 for s in model.steps if not s.effect.random)  # a free curve has no discrepancy
    if _is_finding(model, best, explained, log):
        return _added(model, [best], log)
    # below the acceptance level: try the following proposals as refinements
    for below in (s for s in steps if s.evidence > LEAST_EVIDENCE):
        if (own := refined(model, below)) is not None:
            return _with_refinement(model, steps, below, (own, "refinement-below-detection"), log)
    return None


def _with_refinement(
    model: EffectModel, steps: Sequence[Step], best: Step, of: tuple[int | None, str], log: DecisionLog
) -> EffectModel | None:
    """The model with a finding refined by the best proposal, or by another that predicts better."""
    own, rule = of
    assert own is not None
    least = LEAST_EVIDENCE if rule == "refinement-below-detection" else None
    value = None if least is None else best.evidence
    log.add(rule, "merged", best.effect, value, least, beside=model.steps[own].effect)
    tries = [replace(best, parent=own)]
    enough = max(LEAST_EVIDENCE, MUCH * best.evidence)
    causes = base_channels(best.effect)
    able = [s for s in steps if s is not best and s.evidence > enough and other_causes(model, own, s.effect) <= causes]
    for s in [s for s in able if refined(model, s) == own][:MOST_COMPETING]:
        log.add("competing-refinement", "examined", s.effect, s.evidence, enough, beside=best.effect)
        tries.append(replace(s, parent=own))
    return _added(model, tries, log)


def _added(model: EffectModel, tries: Sequence[Step], log: DecisionLog) -> EffectModel | None:
    """The model with the one of some steps that predicts rows left out best; None where none predicts them better."""
    # a form of physics is judged by its density; a curve of any form by how near its predictions come
    main = tries[0]
    of_any_form = main.parent is not None or main.effect.empirical or main.effect.flexible
    linear, measure = model.linear, heldout_rms if of_any_form else predictive_deviation
    error, _, best_growth = min(
        (measure(g.linear), k, g) for k, g in enumerate(refit_time_constants(with_step(model, s)) for s in tries)
    )
    before = measure(linear)
    new = best_growth.steps[len(model.steps)]
    word: Outcome = "refused" if error >= before else "added" if new.parent is None else "merged"
    gain = log_likelihood_gain(linear, linear.delta_chi2(best_growth.linear))
    beside = None if new.parent is None else model.steps[new.parent].effect
    log.add("cross-validation", word, new.effect, ratio(error, before), 1.0, beside=beside, gain=gain)
    return best_growth if error < before else None


def _is_finding(model: EffectModel, best: Step, explained: float, log: DecisionLog) -> bool:
    """Whether a proposal may be a finding of its own, beside those that explain so much delta chi-squared."""
    if not accepted(model.linear, best, log=log):
        return False
    large = not best.delta_chi2 < LITTLE * explained
    if explained > 0:
        share = ratio(best.delta_chi2, explained)
        log.add("share-of-findings", "accepted" if large else "refused", best.effect, share, LITTLE)
    return large


def _likely(linear: LinearModel, candidates: Candidates, log: DecisionLog) -> Likely:
    """The best proposals with optimised shapes, and the preferred one among them."""
    steps = optimise_shapes(linear, candidates, LIKELY, LEAST_EVIDENCE, log)
    if not steps:
        return None
    return steps, choose(steps, log)


def _accepted(model: EffectModel, likely: Likely, log: DecisionLog) -> Likely:
    """The proposals that pass the acceptance test on their own, and the preferred one among them.

    Without the one that was preferred before, if it refines a finding: where that does not predict, another cause may.
    """
    if likely is None:
        return None
    steps, best = likely
    others = [s for s in steps if s is not best] if refined(model, best) is not None else steps
    able = [s for s in others if accepted(model.linear, s, log=log)]
    return (able, choose(able, log)) if able else None


def refit_time_constants(model: EffectModel) -> EffectModel:
    """The model with each time constant optimised again, given the other effects, in up to `SWEEPS` sweeps."""
    from scipy.optimize import minimize_scalar

    for _ in range(SWEEPS if len(model.steps) > 1 else 0):
        before = model.linear.square
        for k, step in enumerate(model.steps):
            tau, quickest = getattr(step.effect, "tau", None), model.start.scene.worked / 1000
            if tau is None or not quickest:
                continue
            rest = model.without([step])

            def left(x: float, effect: Effect = step.effect, rest: LinearModel = rest) -> float:
                return rest.square_with(_with_tau(effect, x))

            middle = float(np.log(tau or 6 * quickest))  # none at all: from hardly any to the shortest that was tried
            reach = 1.0 if tau else 1.8
            # what settles between two rows is an error of one row
            least = middle - reach if "time" not in step.effect.drivers else np.log(SETTLING_ROWS * _between(model))
            # what settles longer than is searched shows no settling: two such would make any drift
            most = np.log(SLOWEST * model.start.scene.duration)
            bounds = (min(max(middle - reach, least), middle), max(min(middle + reach, most), middle))
            found = minimize_scalar(left, bounds=bounds, method="bounded", options={"maxiter": 12})
            if found.fun < rest.square_with(step.effect) - 1e-9:
                steps = list(model.steps)
                steps[k] = replace(step, effect=_with_tau(step.effect, float(found.x)))
                model = replayed(model.start, steps)
        if model.linear.square > 0.995 * before:
            break
    return model


def _without_hidden_lags(model: EffectModel) -> EffectModel:
    """The model without lags shorter than the time between two rows that are not worth a parameter (Schwarz)."""
    for k, step in enumerate(model.steps):
        tau = getattr(step.effect, "tau", None)
        if not tau or "time" in step.effect.drivers or tau > _between(model):
            continue
        at_once, rest = step.effect.model_copy(update={"tau": 0.0}), model.without([step])
        freedom = max(model.linear.freedom, 2)
        if rest.square_with(at_once) < rest.square_with(step.effect) + np.log(freedom) * model.linear.square / freedom:
            steps = list(model.steps)
            steps[k] = replace(step, effect=at_once)
            model = replayed(model.start, steps)
    return model


def _between(model: EffectModel) -> float:
    """Mean time between two rows, s."""
    scene = model.start.scene
    return scene.worked / len(scene.columns["time"])


def add_second_sensor(model: EffectModel, candidates: Candidates, log: DecisionLog = UNRECORDED) -> EffectModel:
    """The model with two sensors or lags for its latest finding, where that lowers the cross-validation error."""
    *others, group = model.findings
    if any(s.effect.empirical for s in group[:1]) or len(group) > 2:
        return model
    linear = model.without(group)
    found = best_pair(linear, group[0].effect, candidates.effects)
    if found is None or found[2] < LEAST_EVIDENCE:
        if found is not None:
            log.add("second-sensor", "refused", found[1], found[2], LEAST_EVIDENCE, beside=group[0].effect)
        return model
    one, other, evidence = found
    pair = [replace(group[0], effect=one), group[0].of_another(other, evidence)]
    trial = refit_time_constants(of_groups(model.start, [*others, pair]))
    better = predictive_deviation(trial.linear) < predictive_deviation(model.linear)
    log.add("second-sensor", "merged" if better else "refused", other, evidence, LEAST_EVIDENCE, beside=group[0].effect)
    return trial if better else model


def _with_tau(effect: Effect, logarithm: float) -> Effect:
    return effect.model_copy(update={"tau": float(f"{np.exp(logarithm):.6g}")})


def _causes(model: EffectModel) -> frozenset[object]:
    """Keys (effect and place) of all findings."""
    return frozenset(main.effect.key for main, *_ in model.findings)


def _otherwise_named(model: EffectModel, step: Step) -> bool:
    """Whether a refinement is named physics of another kind: the finding may have to be named after it."""
    main = model.steps[step.parent or 0].effect
    return not (step.effect.empirical or step.effect.flexible) and step.effect.effect != main.effect


def reselect(
    model: EffectModel,
    candidates: Candidates,
    log: DecisionLog = UNRECORDED,
    looked: dict[object, Array] | None = None,
) -> EffectModel:
    """The model with one finding replaced by another effect, or left out, where that model has more evidence.

    The refinements of the other findings stay; those of the finding itself stay if the model has more evidence with
    them. What else is still needed of them, the next rounds of selection find.

    Parameters
    ----------
    looked : of findings (by key) that were looked at, what was fitted of them then; those that the later ones have
        hardly changed are not looked at again.
    """
    groups, looked = model.findings, {} if looked is None else looked
    for group, fitted in zip(groups, fitted_of_groups(model), strict=True):
        old, *more = group
        if (before := looked.get(old.effect.key)) is not None:
            change = ratio(float(np.linalg.norm(fitted - before)), float(np.linalg.norm(before)))
            if change < NEAR:
                log.add("unmoved", "kept", old.effect, change, NEAR)
                continue
        looked[old.effect.key] = fitted
        linear = model.without(group)
        steps = optimise_shapes(linear, candidates, MOST_EXAMINED)
        if not steps:
            continue
        best = choose(steps)
        if best.effect == old.effect or (bool(more) and best.effect.key == old.effect.key):
            continue
        rest = [s for s in more if s.effect.key != best.effect.key]
        others = of_groups(model.start, [g for g in groups if g is not group])
        trial = max((_with(others, own) for own in ([], [best], [best, *rest])), key=lambda m: m.log_posterior)
        gain = trial.log_posterior - model.log_posterior
        log.add("reselection", "replaced" if gain > 0 else "kept", old.effect, gain, 0.0, beside=best.effect)
        if gain > 0:
            return trial
    return model


def _with(model: EffectModel, group: Sequence[Step]) -> EffectModel:
    """The model with one finding more, or with what refines one that it has."""
    for main, *more in [group] if group else []:
        parent = refined(model, main)
        number = len(model.steps) if parent is None else parent
        model = with_step(model, replace(main, parent=parent))
        for step in more:
            model = with_step(model, replace(step, parent=number))
    return model
