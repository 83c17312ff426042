"""A delay of recordings that were taken on the fly is found by the times of their rows, without a feed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from identification.diagnosis.pipeline import diagnose
from identification.estimation.fit import fit_machine
from identification.results import store
from identification.uncertainty.prediction import notes, predict
from tests.helpers.diagnosed import empty_survey, showing
from tests.helpers.nightly import first_of

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


@pytest.mark.long
def test_a_delay_is_found_without_a_feed(path: tuple[Machine, Survey]) -> None:
    machine, survey = path
    found = diagnose(machine, showing(survey, machine, [(ON_THE_FLY, [DELAY_S])], 0.005)).diagnosis
    (finding,) = found.findings
    assert (finding.effect, finding.where) == ("clock-offset", "instrument")
    (delay,) = finding.parameters
    assert abs(delay.value - DELAY_S) < 4 * delay.std
    assert "driven by the speeds of X, Y and Z: " in finding.statement


@pytest.mark.parametrize("joint", first_of(["X", "Z"]))
def test_one_joint_that_follows_late_is_its_servo_lag(path: tuple[Machine, Survey], joint: str) -> None:
    machine, survey = path
    lag = EffectSpec("servo-lag", {"joint": joint, "speed": "clock"})
    (finding,) = diagnose(machine, showing(survey, machine, [(lag, [2e-3])], 0.005)).diagnosis.findings
    assert (finding.effect, finding.where, finding.driver) == ("servo-lag", joint, [f"rate({joint})"])
    assert abs(finding.parameters[0].value - 2e-3) < 4 * finding.parameters[0].std


def test_a_path_without_a_delay_is_adequate(path: tuple[Machine, Survey]) -> None:
    machine, survey = path
    assert diagnose(machine, showing(survey, machine, [], 0.005)).diagnosis.verdict == "adequate"


def test_later_poses_say_whether_they_were_taken_to_move(path: tuple[Machine, Survey], tmp_path: Path) -> None:
    """Times of poses at rest say a speed that they did not have: it is noted, and uncertain."""
    machine, survey = path
    diagnosed = diagnose(machine, showing(survey, machine, [(ON_THE_FLY, [DELAY_S])], 0.005))
    assert diagnosed.diagnosis.findings[0].brief.startswith("clock-offset of the instrument by ")
    assert diagnosed.diagnosis.findings[0].brief.endswith(" ms")
    store.save(diagnosed.final, tmp_path)
    stored = store.load(tmp_path)
    poses = empty_survey(machine, 40, 6, channels=False, grid=False)
    still, timed = (replace(poses, table=poses.table.assign(time=t)) for t in (0.0, 10.0 * np.arange(40)))
    at_rest, moved = predict(stored, still), predict(stored, timed)
    assert not [n for n in notes(stored, still) if "on the fly" in n]
    assert [n for n in notes(stored, timed) if "taken as poses at rest" in n and "mm/s" in n]
    assert [n for n in notes(stored, survey) if "taken as read on the fly" in n]
    alone = replace(timed, table=timed.table[:1])
    assert [n for n in notes(stored, alone) if "a single row has no speed" in n]
    for axis in "xyz":
        np.testing.assert_allclose(moved[f"m{axis}"], at_rest[f"m{axis}"], atol=1e-9)
        assert moved[f"u{axis}"].max() > 0.01
    with pytest.raises(InputError, match="one and the same time in every row"):
        predict(stored, poses)


def test_a_time_that_stands_still_determines_no_delay(path: tuple[Machine, Survey]) -> None:
    machine, survey = path
    still = showing(replace(survey, table=survey.table.assign(time=5.0)), machine, [], 0.005)
    fit = fit_machine(replace(machine, effects=(ON_THE_FLY,)), still)
    assert [n for n in fit.notes if "clock-offset (frame.dx.clock-offset) moves nothing in these rows" in n]


@pytest.mark.long
def test_without_times_it_is_said_that_a_delay_would_look_like_other_things(path: tuple[Machine, Survey]) -> None:
    machine, survey = path
    delayed = showing(survey, machine, [(ON_THE_FLY, [DELAY_S])], 0.005)
    untimed = replace(delayed, table=delayed.table.drop(columns="time"))
    assert [n for n in diagnose(machine, untimed).diagnosis.notes if "whether they were read on the fly" in n]


@pytest.mark.long
@pytest.mark.parametrize(("step_s", "quick"), first_of([(0.5, True), (5.0, False)]))
def test_lines_of_one_axis_that_are_read_quickly_have_a_delay(step_s: float, quick: bool) -> None:
    """To and fro at one speed a delay looks like play, which predicts another position at rest."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 12 * 16, 5, channels=False, grid=False)
    across, along = (
        np.repeat(np.linspace(0.1, 0.9, 6), 32),
        np.tile(np.append(*[np.linspace(0, 1, 16)[::s] for s in (1, -1)]), 6),
    )
    places = {
        j.name: j.travel[0] + np.ptp(j.travel) * share
        for j, share in zip(machine.joints, (along, across, across), strict=True)
    }
    time = step_s * np.arange(12 * 16) + 5.0 * np.repeat(np.arange(12), 16)
    lines = replace(survey, table=survey.table.assign(time=time, **places))
    delay = 0.02 / (np.ptp(machine.joints[0].travel) / 15 / step_s)  # that moves the readings by 0.02 mm
    found = diagnose(machine, showing(lines, machine, [(ON_THE_FLY, [delay])], 0.003)).diagnosis.findings
    names = {found[0].effect, *(a.effect for a in found[0].alternatives)}
    assert ("clock-offset" in names) == quick
