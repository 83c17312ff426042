"""Forward selection of effects by log Bayes factor and cross-validation, with backward elimination.

The best candidate is added first, named physics before empirical terms. What it leaves over because its form is not
exact (another exponent, a sensor that lags) is added at the same place and driver as a refinement of the same finding,
not as a second finding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from errormodel.effects.base import Effect
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog, Outcome, named, ratio
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search import correlated_noise as coloured
from identification.diagnosis.search.candidates import Candidates
from identification.diagnosis.search.conditional_evidence import conditional_scores
from identification.diagnosis.search.criteria import heldout_rms, log_likelihood_gain
from identification.diagnosis.search.model import EffectModel, of_groups, replayed, with_step
from identification.diagnosis.search.refinement import forms, is_departure, refined, refinement_of
from identification.diagnosis.search.scoring import DETECT, Step, accepted, choose
from identification.diagnosis.search.sensor_pairs import best_pair
from identification.diagnosis.search.shape_fit import optimise_shapes
from identification.diagnosis.search.step_functions import switched
from identification.runtime.progress import Progress, silent

LEAK = 0.06  # share of what is explained already: a smaller effect elsewhere may be a discrepancy of a finding
LEAST_EVIDENCE = 7.0  # log Bayes factor below which a proposal is not examined
NEAR_BEST = 0.7  # of the best evidence: proposals that are tried as refinements before it
HARDLY = 1.05  # times the cross-validation error: a superfluous effect gains as much by chance
MOST_FINDINGS = 12
MOST_STEPS = 24
SHAPES_TRIED = 3.0  # log of the trials factor of one effect's shapes
SWEEPS = 4  # over all time constants
SETTLING_ROWS = 2.0  # rows that a time constant of a clock lasts at least
LIKELY = 12  # proposals that are looked at closely, to be accepted next

Likely = tuple[list[Step], Step] | None


def forward_select(
    linear: LinearModel,
    candidates: Candidates,
    progress: Progress = silent,
    begin: Sequence[Step] = (),
    log: DecisionLog = UNRECORDED,
) -> EffectModel:
    """The model after forward selection: effects are added while evidence and cross-validation support them.

    Parameters
    ----------
    begin : steps that the selection starts with.
    log : takes down what is decided.
    """
    model = replayed(linear, begin)
    for number, step in enumerate(begin):
        log.begin(number)
        log.add("search-from", "added", step.effect)
        candidates = candidates.joined(Candidates.of(linear, list(forms(linear, step.effect))))
    while len(model.steps) < MOST_STEPS and not model.linear.exact:
        log.begin(len(model.steps))
        last = model.steps[-1].effect if model.steps else None
        with progress(
            f"Looking further than {last.effect} of {last.where}" if last else "Looking for what was left out"
        ):
            likely = _likely(model.linear, candidates, log)
            further = (
                add_best(model, likely, log)
                or add_best(model, able := _accepted(model.linear, likely, log), log)
                or add_best(model, _that_predict(model, able, log), log)
            )
        if further is None:
            break
        added = further.steps[len(model.steps) :]
        model = switched(add_second_sensor(further, candidates, log), log)
        for step in added:
            if step.parent is None:
                candidates = candidates.joined(Candidates.of(linear, list(forms(linear, step.effect))))
    else:
        log.add("most-steps", "refused", None, len(model.steps), MOST_STEPS)
    return conditional_scores(backward_eliminate(model, log), candidates, log)


def _others(groups: Sequence[Sequence[Step]], group: Sequence[Step]) -> str:
    return " ".join(named(g[0].effect) for g in groups if g is not group)


def backward_eliminate(model: EffectModel, log: DecisionLog = UNRECORDED) -> EffectModel:
    """The model without findings that later ones have made superfluous, the smallest first."""
    for group in sorted(model.findings, key=lambda g: g[0].delta_chi2):
        others = [g for g in model.findings if g[0] is not group[0]]
        if others and not _accepted_beside(model.without(group), group, "superfluous", log):
            fewer = of_groups(model.start, others)
            errors = heldout_rms(fewer.linear), heldout_rms(model.linear)
            out = errors[0] < HARDLY * errors[1]
            word: Outcome = "removed" if out else "kept"
            beside = _others(model.findings, group)
            log.add("superfluous-by-cross-validation", word, group[0].effect, ratio(*errors), HARDLY, beside=beside)
            if out:
                model = fewer
    return model


def _accepted_beside(linear: LinearModel, group: Sequence[Step], rule: str, log: DecisionLog) -> bool:
    """Whether a finding passes the acceptance test under correlated noise, given the linear model."""
    effects = [s.effect for s in group if s.effect.random == group[0].effect.random]
    [(_, evidence)] = coloured.evidence(linear, [effects])
    surplus = evidence - np.log(max(group[0].trials, 1)) - SHAPES_TRIED
    clear = bool(surplus >= DETECT)
    log.add(rule, "accepted" if clear else "refused", group[0].effect, float(surplus), DETECT)
    return clear


def add_best(model: EffectModel, likely: Likely, log: DecisionLog = UNRECORDED) -> EffectModel | None:
    """The model with the best proposal added, as a finding or as a refinement; None where none is accepted."""
    linear = model.linear
    if likely is None:
        return None
    steps, best = likely
    own, rule = refinement_of(model, best)
    if own is None:  # before a new finding, try it as a refinement of an existing one
        could = [(s, refined(model, s)) for s in steps if s.evidence > NEAR_BEST * best.evidence]
        others = [s for s, k in could if k is not None and is_departure(model, k, best.effect)]
        if others:
            first, best = best, max(others, key=lambda s: s.evidence)
            own, rule = refinement_of(model, best)
            least = NEAR_BEST * first.evidence
            log.add("refinement-first", "preferred", best.effect, best.evidence, least, beside=first.effect)
    if own is not None:
        best = replace(best, parent=own)
        log.add(rule, "merged", best.effect, beside=model.steps[own].effect)
    elif not _is_finding(model, best, log):
        # below the acceptance level: try the following proposals as refinements
        further = [s for s in steps if s.evidence > LEAST_EVIDENCE and refined(model, s) is not None]
        if not further:
            return None
        best = replace(further[0], parent=refined(model, further[0]))
        into = model.steps[best.parent or 0].effect
        log.add("refinement-below-detection", "merged", best.effect, best.evidence, LEAST_EVIDENCE, beside=into)
    larger = refit_time_constants(with_step(model, best))
    error, before = heldout_rms(larger.linear), heldout_rms(linear)
    new = larger.steps[len(model.steps)]
    word: Outcome = "refused" if error >= before else "added" if new.parent is None else "merged"
    gain = log_likelihood_gain(linear, linear.delta_chi2(larger.linear))
    beside = None if new.parent is None else model.steps[new.parent].effect
    log.add("cross-validation", word, new.effect, ratio(error, before), 1.0, beside=beside, gain=gain)
    return larger if error < before else None


def _is_finding(model: EffectModel, best: Step, log: DecisionLog) -> bool:
    """Whether a proposal is a finding of its own: it is accepted, no small part of what is found, and there is room."""
    if not accepted(model.linear, best, log):
        return False
    explained = sum(s.delta_chi2 for s in model.steps if not s.effect.random)  # a free curve has no discrepancy
    large = not best.delta_chi2 < LEAK * explained
    if explained > 0:
        share = ratio(best.delta_chi2, explained)
        log.add("share-of-findings", "accepted" if large else "refused", best.effect, share, LEAK)
    few = len(model.findings) < MOST_FINDINGS
    if not few:
        log.add("most-findings", "refused", best.effect, len(model.findings), MOST_FINDINGS)
    return large and few


def _likely(linear: LinearModel, candidates: Candidates, log: DecisionLog) -> Likely:
    """The best proposals with optimised shapes, and the preferred one among them."""
    steps = optimise_shapes(linear, candidates, LIKELY, LEAST_EVIDENCE, log)
    if not steps:
        return None
    return steps, choose(linear, steps, log)


def _accepted(linear: LinearModel, likely: Likely, log: DecisionLog) -> Likely:
    """The proposals that pass the acceptance test on their own, and the preferred one among them."""
    able = [s for s in likely[0] if accepted(linear, s, log)] if likely else []
    return (able, choose(linear, able, log)) if able else None


def _that_predict(model: EffectModel, able: Likely, log: DecisionLog) -> Likely:
    """Of the convincing ones those that predict left-out rows better: of two sensors alike, one may and one may not.

    Only before anything was found: what is slight beside a finding, and predicts a little, is no further one.
    """
    if able is None or model.steps:
        return None
    before = heldout_rms(model.linear)
    errors = [heldout_rms(with_step(model, s).linear) for s in able[0]]
    for step, error in zip(able[0], errors, strict=True):
        log.add("accepted-alone", "accepted" if error < before else "refused", step.effect, ratio(error, before), 1.0)
    better = [s for s, error in zip(able[0], errors, strict=True) if error < before]
    return (better, choose(model.linear, better, log)) if better else None


def refit_time_constants(model: EffectModel) -> EffectModel:
    """The model with each time constant optimised again, given the other effects, in up to `SWEEPS` sweeps."""
    from scipy.optimize import minimize_scalar

    for _ in range(SWEEPS if len(model.steps) > 1 else 0):
        before = model.linear.square
        for k, step in enumerate(model.steps):
            tau, quickest = getattr(step.effect, "tau", None), model.start.scene.duration / 1000
            if tau is None or not quickest:
                continue
            rest = model.without([step])

            def left(x: float, effect: Effect = step.effect, rest: LinearModel = rest) -> float:
                return rest.square_with(_with_tau(effect, x))

            middle = float(np.log(tau or 6 * quickest))  # none at all: from hardly any to the shortest that was tried
            reach = 1.0 if tau else 1.8
            # what settles between two rows is an error of one row
            least = middle - reach if "time" not in step.effect.drivers else np.log(SETTLING_ROWS * _between(model))
            bounds = (min(max(middle - reach, least), middle), middle + reach)
            found = minimize_scalar(left, bounds=bounds, method="bounded", options={"maxiter": 12})
            if found.fun < rest.square_with(step.effect) - 1e-9:
                steps = list(model.steps)
                steps[k] = replace(step, effect=_with_tau(step.effect, float(found.x)))
                model = replayed(model.start, steps)
        if model.linear.square > 0.995 * before:
            break
    return model


def _between(model: EffectModel) -> float:
    """Mean time between two rows, s."""
    scene = model.start.scene
    return scene.duration / len(scene.columns["time"])


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
    pair = [replace(group[0], effect=one), Step(other, evidence, 0.0, group[0].absorbed)]
    trial = refit_time_constants(of_groups(model.start, [*others, pair]))
    better = heldout_rms(trial.linear) < heldout_rms(model.linear)
    log.add("second-sensor", "merged" if better else "refused", other, evidence, LEAST_EVIDENCE, beside=group[0].effect)
    return trial if better else model


def _with_tau(effect: Effect, logarithm: float) -> Effect:
    return effect.model_copy(update={"tau": float(f"{np.exp(logarithm):.6g}")})
