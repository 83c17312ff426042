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
from identification.diagnosis.extension import Explanation, that_predicts
from identification.diagnosis.jumps import jump_of
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.row_residuals import noise_mm, spread
from identification.diagnosis.results.nameless_evidence import best_of
from identification.diagnosis.results.recorded_functions import wandering
from identification.diagnosis.results.residual_dependence import Dependence, dependence_of
from identification.diagnosis.search.forward_selection import add_best
from identification.diagnosis.search.scoring import Step
from identification.diagnosis.search.shape_fit import scored
from identification.runtime.progress import Progress

PIECES = 16  # intervals of the survey's time, of a curve
MOST_COURSES = 3
EDGES = 200  # times of a jump that are tried first


def with_courses(
    found: Explanation, changes: Sequence[Effect], progress: Progress, log: DecisionLog
) -> tuple[Explanation, Dependence | None]:
    """What was found, with the courses of motions that what is left shows, and on what the rest depends.

    Parameters
    ----------
    changes : effects that mend blunders.
    """
    for number in range(MOST_COURSES + 1):
        with progress("Testing what is left"):
            components = 3 if found.final.fitted.n else 1
            left = dependence_of(found.model.linear, 1e3 * noise_mm(found.before), log, components, found.wave)
        linear = found.model.linear
        if left is None or linear.scene.clock not in left.channels or number == MOST_COURSES:
            break
        _, _, most = best_of(linear, wandering(linear, np.unique(linear.index)))
        if most is None:
            break
        log.begin(len(found.model.steps))
        step = _course(linear, most.element, most.motion)
        longer = None if step is None else add_best(found.model, ([step], step), log)
        if longer is None:
            break
        with progress("Fitting the extended machine"):
            model, final, _ = that_predicts(found.before, longer, found.survey, changes, log)
        errors = [spread(fit, heldout=True).rms_um or 0.0 for fit in (final, found.final)]
        if errors[0] > NO_WORSE * errors[1]:
            log.add("prediction-made-worse", "removed", longer.steps[-1].effect, ratio(*errors), NO_WORSE)
            break
        found = replace(found, model=model, final=final)
    return found, left


def _course(linear: LinearModel, element: str, motion: str) -> Step | None:
    """The course of a motion in time, or with the rows, as a step: a smooth curve, or one jump of more evidence."""
    clock = linear.scene.clock
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
