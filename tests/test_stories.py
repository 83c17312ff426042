"""Whole explanations weighed beside each other, and surfaces over two joints that turn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from errormodel.chain import Chain
from errormodel.effects import make
from errormodel.machine import EffectSpec
from errormodel.schema import read_machine
from errormodel.simulate import Truth, simulate
from identification.diagnosis.choosing import Step
from identification.diagnosis.growth import replayed
from identification.diagnosis.run import diagnose
from identification.diagnosis.stories import story
from identification.diagnosis.workbench import set_up
from identification.fit.run import fit_machine
from tests.test_diagnosis_empty import empty_survey

MEASURED = ["mx", "my", "mz"]


def test_a_story_gains_by_what_is_there_and_loses_by_what_is_not() -> None:
    """Warmth moves the carriage; a play that it does not have is one place more that was looked at."""
    machine = read_machine("bridge_cmm")
    survey = empty_survey(machine, 400, 11, channels=True, grid=False)
    truth = EffectSpec("structure-drift", {"element": "carriage", "motion": "dx", "sensor": "T_0"})
    chain = Chain(replace(machine, effects=(truth,)))
    values = {chain.effect_ids[0][0]: 0.005}
    table = survey.table.copy()
    seen = simulate(chain.machine, table, Truth(values, (500.0, -200.0, 100.0), (0.1, 0.2, 0.5)), 0.003, 3)
    table[MEASURED] = seen[MEASURED]
    bench = set_up(fit_machine(machine, replace(survey, table=table)))

    def told(*specs: EffectSpec) -> float:
        return story(replayed(bench, [Step(make(s), 0.0, 0.0, 0.0, searched=1000) for s in specs]))

    play = EffectSpec("backlash", {"joint": "X"})
    assert told() == 0
    assert told(truth) > 50
    assert told(play) < 0
    assert told(truth, play) < told(truth)


def test_a_surface_over_two_joints_that_turn_is_found() -> None:
    """A chequer board over two joints of an arm: no curve of one joint, and no product of straight lines."""
    machine = read_machine("six_axis_arm")
    survey = empty_survey(machine, 500, 5, channels=False, grid=False)
    one, two, *_ = machine.joints
    moved = survey.table.copy()
    waves = [np.sin(2.5 * np.pi * (moved[j.name] - j.travel[0]) / (j.travel[1] - j.travel[0])) for j in (one, two)]
    moved["mz"] += 0.03 * np.sign(waves[0]) * np.sign(waves[1])
    found = diagnose(machine, replace(survey, table=moved)).diagnosis.findings
    assert {f.effect for f in found} == {"unnamed"}  # a little of it may show as a tilt at the other of the two
    assert all(set(f.driver) == {one.name, two.name} for f in found)
    assert found[0].heldout_rms_um.after < 0.8 * found[0].heldout_rms_um.before


def test_pulses_become_a_curve_over_their_period() -> None:
    """Oil lifts a carriage every quarter of an hour and it sinks again: no sine, and no second finding."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 450, 7, channels=True, grid=False)
    moved = survey.table.copy()
    moved["mz"] += 0.03 * np.exp(-np.mod(moved["time"], 900.0) / 300.0)
    told = diagnose(machine, replace(survey, table=moved))
    [found] = told.diagnosis.findings
    assert (found.effect, found.driver) == ("unnamed", ["time"])
    assert found.period is not None
    assert abs(found.period - 900) < 5
    assert "with a period of 15 min" in found.statement
    assert [(s.refines, s.effect.tied) for s in told.growth.steps] == [(None, False), (0, True)]


def test_steps_over_two_joints_get_overtones() -> None:
    """A table whose plates lie higher and lower in turn: one pair of waves leaves 12 um held out, 9 of them noise."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 450, 7, channels=True, grid=False)
    moved = survey.table.copy()
    x, y = (
        np.sin(3 * np.pi * (moved[j.name] - j.travel[0]) / (j.travel[1] - j.travel[0]) + 0.4)
        for j in machine.joints[:2]
    )
    moved["mz"] += 0.015 * np.sign(x) * np.sign(y)
    [found] = diagnose(machine, replace(survey, table=moved)).diagnosis.findings
    assert found.effect == "unnamed"
    assert set(found.driver) == {j.name for j in machine.joints[:2]}
    assert found.heldout_rms_um.after < 11.0
