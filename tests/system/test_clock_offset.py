"""A delay of recordings that were taken on the fly is found by the times of their rows, without a feed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from identification.diagnosis.pipeline import diagnose
from tests.helpers.diagnosed import empty_survey, showing

DELAY_S = 4e-3
ON_THE_FLY = EffectSpec("clock-offset", {"speed": "clock"})


@pytest.fixture(scope="module")
def path() -> tuple[Machine, Survey]:
    """A smooth path of all axes, some 10 mm/s, of which a tracker took a row every 4 s."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 260, 5, channels=False, grid=False)
    time, rng = 4.0 * np.arange(260), np.random.default_rng(8)
    turns = {j.name: np.sin(time[:, None] * rng.uniform(0.01, 0.05, 3) + rng.uniform(0, 6, 3)) for j in machine.joints}
    places = {j.name: np.mean(j.travel) + np.ptp(j.travel) / 7 * turns[j.name].sum(axis=1) for j in machine.joints}
    return machine, replace(survey, table=survey.table.assign(time=time, **places))


def test_a_delay_is_found_without_a_feed(path: tuple[Machine, Survey]) -> None:
    machine, survey = path
    found = diagnose(machine, showing(survey, machine, [(ON_THE_FLY, [DELAY_S])], 0.005)).diagnosis
    (finding,) = found.findings
    assert (finding.effect, finding.where) == ("clock-offset", "instrument")
    (delay,) = finding.parameters
    assert abs(delay.value - DELAY_S) < 4 * delay.std
    assert "driven by the speeds of X, Y and Z: " in finding.statement


def test_a_path_without_a_delay_is_adequate(path: tuple[Machine, Survey]) -> None:
    machine, survey = path
    assert diagnose(machine, showing(survey, machine, [], 0.005)).diagnosis.verdict == "adequate"
