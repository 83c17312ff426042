"""Jumps of one motion in time, without a name, as alternatives of what moves an element in several motions alike."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from errormodel.arrays import Array
from errormodel.effects.unnamed import Unnamed
from identification.diagnosis.decisions.constants import LEAST_EVIDENCE
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.results.nameless_evidence import best_of
from identification.diagnosis.results.recorded_functions import CLOCK, in_one_motion
from identification.diagnosis.search.model import EffectModel, steps_of
from identification.diagnosis.search.scoring import Step
from identification.diagnosis.search.shape_fit import scored


def jumps_instead(model: EffectModel, log: DecisionLog) -> Iterator[list[Step]]:
    """Steps to search from, with a jump of one motion in place of one that moves an element in several motions alike.

    A station that is knocked moves in all directions; what moves in one only is a state of a joint.
    """
    for main, *more in model.findings:
        without, at = model.without([main, *more]), getattr(main.effect, "at", None)
        if at is None or not (courses := in_one_motion(without, [main.effect])):
            continue
        evidence, _, best = best_of(without, courses)
        least = main.evidence - LEAST_EVIDENCE
        if best is None or evidence < least:
            continue
        jump = jump_of(without.channel(CLOCK), best.element, best.motion, at)
        if (step := scored(without, jump, 1, main.trials, main.names, len(courses))) is not None:
            log.add("strong-alternative", "examined", jump, evidence, least, beside=main.effect)
            yield [*steps_of(g for g in model.findings if g[0] is not main), step]


def jump_of(time: Array, element: str, motion: str, edge: float) -> Unnamed:
    """A motion that takes another value from a time (s) on."""
    once = {"period": float(f"{4 * np.ptp(time):.4g}"), "edge": float(f"{edge:.8g}")}
    return Unnamed.model_validate({"element": element, "motion": motion, "driver": CLOCK, **once})
