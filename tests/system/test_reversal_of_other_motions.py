"""Friction that turns a carriage, and a target that was put back: effects of another motion, or of another run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from identification.diagnosis.pipeline import diagnose
from tests.helpers.commands import MILL
from tests.helpers.diagnosed import empty_survey, showing

ROWS = 240
MACHINE = read_machine(MILL)


def to_and_fro(lengths: Sequence[float]) -> Survey:
    """X goes through its travel in steps of some lengths and turns round often; Y and Z go anywhere."""
    survey = empty_survey(MACHINE, ROWS, 4, channels=False, grid=False)
    (low, high), rng = MACHINE.joints[0].travel, np.random.default_rng(7)
    steps = rng.choice(lengths, ROWS) * (high - low) * rng.choice([-1.0, 1.0], ROWS)
    at = np.cumsum(steps) % (2 * (high - low))
    x = low + np.minimum(at, 2 * (high - low) - at)
    return replace(survey, table=survey.table.assign(X=x, time=30.0 * np.arange(ROWS)))


def test_a_carriage_that_friction_turns() -> None:
    """A yaw of three plays of several widths is hysteresis of its joint, in the motion that it has."""
    survey = to_and_fro([0.01, 0.03, 0.1, 0.3])
    plays = [EffectSpec("hysteresis", {"joint": "X", "width": w, "motion": "ec"}) for w in (15.0, 60.0, 180.0)]
    found = diagnose(MACHINE, showing(survey, MACHINE, [(p, [2e-5]) for p in plays], 0.002)).diagnosis.findings
    assert [(f.effect, f.where) for f in found] == [("hysteresis", "X")]
    assert set(found[0].motion) == {"ec"}
    assert found[0].probability is not None
    assert found[0].probability > 0.9


def test_a_carriage_that_turns_at_once() -> None:
    """Where no move is shorter than the friction's way, a yaw at each reversal is hysteresis, and no racking."""
    play = EffectSpec("hysteresis", {"joint": "X", "width": 5.0, "motion": "ec"})
    found = diagnose(MACHINE, showing(to_and_fro([0.2, 0.3]), MACHINE, [(play, [3e-5])], 0.002)).diagnosis.findings
    assert [(f.effect, f.where) for f in found] == [("hysteresis", "X")]
    assert set(found[0].motion) == {"ec"}


def test_a_target_that_was_put_back() -> None:
    """Between two runs all readings move by one vector: the target, or a station that did not turn."""
    survey = empty_survey(MACHINE, ROWS, 5, channels=False, grid=False)
    run = np.where(np.arange(ROWS) < ROWS // 2, "1", "2")
    survey = replace(survey, table=survey.table.assign(run=run, time=30.0 * np.arange(ROWS)))
    moved = EffectSpec("target-offset", {"run": "2"})
    (found,) = diagnose(MACHINE, showing(survey, MACHINE, [(moved, [0.008, -0.005, 0.004])], 0.002)).diagnosis.findings
    said = {found.effect: found.probability, **{a.effect: a.probability for a in found.alternatives}}
    assert found.effect == "target-offset"
    assert said["station-shift"] is not None
    assert 0.1 < said["station-shift"] < 0.9  # it looks alike
