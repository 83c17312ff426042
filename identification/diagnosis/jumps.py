"""Jumps of one motion in time, without a name, as alternatives of what moves an element in several motions alike."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from errormodel.effects.unnamed import Unnamed
from identification.diagnosis.decisions.constants import LEAST_EVIDENCE
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.results.nameless_evidence import best_of
from identification.diagnosis.results.recorded_functions import in_one_motion
from identification.diagnosis.search.model import EffectModel, steps_of
from identification.diagnosis.search.scoring import Step
from identification.diagnosis.search.shape_fit import moment_between, scored

NEARBY = 0.05  # of the recording: where another form has its jump


def jumps_instead(model: EffectModel, log: DecisionLog) -> Iterator[list[Step]]:
    """Steps to search from, with a jump of one motion in place of one that moves an element in several motions alike.

    A station that is knocked moves in all directions; what moves in one only is a state of a joint.
    """
    for main, *more in model.findings:
        without, clock = model.without([main, *more]), model.linear.scene.clock
        at = getattr(main.effect, "row" if clock == "row" else "at", None)
        if at is None or not (courses := in_one_motion(without, [main.effect])):
            continue
        evidence, _, best = best_of(without, courses)
        least = main.evidence - LEAST_EVIDENCE
        if best is None or evidence < least:
            continue
        jump = jump_of(without, best.element, best.motion, _moment(without, best.element, best.motion, at))
        if (step := scored(without, jump, 1, main.trials, main.names, len(courses))) is not None:
            log.add("strong-alternative", "examined", jump, evidence, least, beside=main.effect)
            yield [*steps_of(g for g in model.findings if g[0] is not main), step]


def _moment(linear: LinearModel, element: str, motion: str, near: float) -> float:
    """When one motion jumps, near the moment at which it does so in all motions of an element."""
    x = linear.channel(linear.scene.clock)

    def left(edges: Sequence[float]) -> list[float]:
        return linear.squares_with([jump_of(linear, element, motion, edge) for edge in edges])

    return moment_between(x, near - NEARBY * np.ptp(x), near + NEARBY * np.ptp(x), near, left)


def jump_of(linear: LinearModel, element: str, motion: str, edge: float) -> Unnamed:
    """A motion that takes another value from a time (s) on, or from a row on where no times were recorded."""
    clock = linear.scene.clock
    once = {"period": float(f"{4 * np.ptp(linear.channel(clock)):.4g}"), "edge": float(f"{edge:.8g}")}
    return Unnamed.model_validate({"element": element, "motion": motion, "driver": clock, **once})
