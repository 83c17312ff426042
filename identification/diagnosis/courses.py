"""Motions that take a course of their own in time: jumps and curves, findings without a name that are predicted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from errormodel.arrays import Array
from errormodel.conventions import MOTIONS
from errormodel.effects.base import Effect
from errormodel.effects.unnamed import Unnamed
from identification.diagnosis.decisions.constants import NO_WORSE
from identification.diagnosis.decisions.log import DecisionLog, ratio
from identification.diagnosis.extension import Explanation
from identification.diagnosis.jumps import jump_of
from identification.diagnosis.kept_findings import that_predicts
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.noise_of_kinds import kinds_of
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.linear.row_residuals import noise_mm, spread
from identification.diagnosis.results.nameless_alternative import refusal
from identification.diagnosis.results.nameless_evidence import best_of
from identification.diagnosis.results.recorded_functions import recorded, wandering
from identification.diagnosis.results.residual_dependence import Dependence, dependence_of
from identification.diagnosis.search.candidates import Candidates
from identification.diagnosis.search.conditional_evidence import in_correlated_noise
from identification.diagnosis.search.criteria import heldout_rms
from identification.diagnosis.search.forward_selection import add_best, forward_select
from identification.diagnosis.search.model import EffectModel, of_groups, with_step
from identification.diagnosis.search.proposals import proposed
from identification.diagnosis.search.refinement import by_clock_alone
from identification.diagnosis.search.scoring import Step
from identification.diagnosis.search.shape_fit import scored
from identification.runtime.progress import Progress

PIECES = 16  # intervals of the survey's time, of a curve
MOST_COURSES = 3
EDGES = 200  # times of a jump that are tried first


def with_wanderer(found: Explanation, changes: Sequence[Effect], progress: Progress, log: DecisionLog) -> Explanation:
    """What was found, with the course of the motion in whose favour a finding was left out, if there is one.

    It has more evidence than what was accepted, and needs no other test.
    """
    if found.wanders is None:
        return found
    step = _course(found.model.linear, found.wanders.element, found.wanders.motion)
    longer = None if step is None else with_step(found.model, step)
    if longer is None or heldout_rms(longer.linear) >= heldout_rms(found.model.linear):
        return found
    return _fitted(found, longer, longer.steps[-1].effect, changes, progress, log) or found


def with_courses(
    found: Explanation, changes: Sequence[Effect], progress: Progress, log: DecisionLog
) -> tuple[Explanation, Dependence | None]:
    """What was found, with the courses of motions that what is left shows, and on what the rest depends.

    Parameters
    ----------
    changes : effects that mend blunders.
    """
    earlier = {g[0].effect.key for g in found.model.findings}
    for number in range(MOST_COURSES + 1):
        left, linear = _left(found, progress, log), found.model.linear
        if left is None or linear.scene.clock not in left.channels or number == MOST_COURSES:
            break
        _, _, most = best_of(linear, wandering(linear, np.unique(linear.index)))
        log.begin(len(found.model.steps))
        step = None if most is None else _course(linear, most.element, most.motion)
        longer = None if step is None else add_best(found.model, ([step], step), log)
        further = None if longer is None else _fitted(found, longer, longer.steps[-1].effect, changes, progress, log)
        if further is None:
            break
        found = _with_more(further, changes, progress, log)
    return _named_only(found, earlier, left, changes, progress, log)


def _left(found: Explanation, progress: Progress, log: DecisionLog) -> Dependence | None:
    """On what it depends what is left."""
    with progress("Testing what is left"):
        components, fit = 3 if found.final.fitted.n else 1, found.before
        linear, start = found.model.linear, found.model.start
        if len(kinds_of(fit, start)) > 1:
            fit = found.final  # what was found had been noise of some kinds, and not of others
            linear = start = set_up(fit)
        # of one whitened observation: where noise was declared it is not what the fit before left
        sigma_um = 1e3 * noise_mm(fit) / float(np.sqrt(start.square / start.freedom))
        return dependence_of(linear, sigma_um, log, components, found.wave)


def _fitted(
    found: Explanation,
    model: EffectModel,
    new: Effect | None,
    changes: Sequence[Effect],
    progress: Progress,
    log: DecisionLog,
) -> Explanation | None:
    """What was found with another model; None where rows left out are predicted worse with what is new in it."""
    with progress("Fitting the extended machine"):
        model, final, larger = that_predicts(found.before, model, found.survey, changes, log)
    errors = [spread(f, heldout=True).rms_um or 0.0 for f in (final, found.final)]
    if new is not None and (larger or errors[0] > NO_WORSE * errors[1]):
        log.add("prediction-made-worse", "removed", new, ratio(*errors), NO_WORSE)
        return None
    return replace(found, model=model, final=final)


def _with_more(found: Explanation, changes: Sequence[Effect], progress: Progress, log: DecisionLog) -> Explanation:
    """What was found, and what else with a name is seen beside a course: it was noise to it, and correlated at that.

    What time alone drives is not looked for: the course follows it as well. What has no name is what it leaves.
    """
    start = found.model.start
    candidates = Candidates.of(start, [e for e in proposed(start) if not by_clock_alone(e)])
    candidates.scores(start)
    more = in_correlated_noise(forward_select(start, candidates, progress, found.model.steps, log), log)
    del candidates
    known = {g[0].effect.key for g in found.model.findings}
    kept = [g for g in more.findings if g[0].effect.key in known]
    new = [g for g in more.findings if g[0].effect.key not in known and not g[0].effect.empirical]
    if not new or len(kept) < len(known):  # a course gives way to no name
        return found
    return _fitted(found, of_groups(start, [*kept, *new]), new[0][0].effect, changes, progress, log) or found


def _named_only(
    found: Explanation,
    earlier: set[tuple[object, ...]],
    left: Dependence | None,
    changes: Sequence[Effect],
    progress: Progress,
    log: DecisionLog,
) -> tuple[Explanation, Dependence | None]:
    """What was found, without what was seen beside courses and has no name beside all of them; and what is left.

    Parameters
    ----------
    earlier : keys of what was found before.
    """
    model, groups = found.model, found.model.findings
    new = [g[0].effect.key not in earlier and not g[0].effect.empirical for g in groups]
    functions = recorded(model.start, np.unique(model.start.index)) if any(new) else []
    kept = [g for g, own in zip(groups, new, strict=True) if not own or refusal(model, g, functions, log) is None]
    if len(kept) == len(groups):
        return found, left
    found = _fitted(found, of_groups(model.start, kept), None, changes, progress, log) or found
    return found, _left(found, progress, log)


def _course(linear: LinearModel, element: str, motion: str) -> Step | None:
    """The course of a motion in time, or with the rows, as a step: a smooth curve, or one jump of more evidence.

    None where neither times nor one file's order say what came after what.
    """
    if not (clock := linear.scene.clock):
        return None
    time = linear.channel(clock)
    low, high, rows = float(time.min()), float(time.max()), len(np.unique(time))
    center, half = float(f"{(low + high) / 2:.4g}"), float(f"{(high - low) / 2:.4g}")
    form = {"element": element, "motion": motion, "driver": clock, "center": center, "half_range": half}
    curve = Unnamed.model_validate({**form, "pieces": PIECES})
    jump = jump_of(linear, element, motion, _edge(linear, time, linear.levers[element][MOTIONS.index(curve.motion)]))
    smooth, sudden = (linear.random(linear.columns(form)[0]) for form in (curve, jump))
    places = len(linear.scene.moving) * len(MOTIONS)
    if sudden.best()[1] - np.log(rows) > smooth.best()[1]:  # it may be before any of the rows
        return scored(linear, jump, rows, places, 1, places)
    curve = curve.model_copy(update={"size": float(f"{smooth.likeliest_size():.3g}")})
    return scored(linear, curve, 1, places, 1, places)


def _edge(linear: LinearModel, time: Array, lever: Array) -> float:
    """The time (s) between two rows at which a jump of a motion explains most: of some in all, then of all there."""
    seen, between = len(linear.index), np.unique(time)
    edges = (between[1:] + between[:-1]) / 2
    width = max(len(edges) // EDGES, 1)
    tried = np.arange(width // 2, len(edges), width)
    for _ in range(2):
        columns = np.where(time > edges[tried, None], lever, -lever)
        left = np.square(columns).sum(axis=1) - np.square(columns @ linear.basis[:seen]).sum(axis=1)
        gain = np.square(columns @ linear.residual[:seen]) / np.maximum(left, 1e-3 * (lever @ lever))
        best = int(tried[np.argmax(gain)])
        tried = np.arange(max(best - width, 0), min(best + width + 1, len(edges)))
    return float(edges[best])
