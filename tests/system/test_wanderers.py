"""A motion that wanders is not driven by the temperature that it resembles."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.effects import make
from errormodel.machine import EffectSpec
from errormodel.machine_file import read_machine
from identification.diagnosis.courses import _course
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.linear.of_fit import set_up
from identification.diagnosis.pipeline import diagnose
from identification.diagnosis.results.nameless_alternative import without_wanderers
from identification.diagnosis.search.model import replayed
from identification.diagnosis.search.scoring import Step
from identification.estimation.fit import fit_machine
from identification.results import store
from identification.uncertainty.prediction import predict
from tests.helpers.diagnosed import empty_survey, showing
from tests.helpers.nightly import first_of

MEASURED = ["mx", "my", "mz"]


@pytest.mark.parametrize(("driver", "kept"), [("w_level", False), ("T_0", True)])
def test_what_wanders_more_than_the_temperature_tells_is_not_its_doing(driver: str, kept: bool) -> None:
    """`T_0` follows what wanders, but slowly: either the one or the other moves the carriage."""
    machine = read_machine("bridge_cmm")
    survey = empty_survey(machine, 400, 11, channels=True, grid=False)
    level = survey.table["w_level"].to_numpy()
    slow = np.convolve(np.pad(level, 30, mode="edge"), np.ones(61) / 61, mode="valid")
    table = survey.table.assign(T_0=20 + (slow - slow.mean()) / np.ptp(slow) * 4)
    common = {"element": "carriage", "motion": "dx", "center": float(np.mean(table[driver]))}
    truth = EffectSpec("unnamed", {**common, "driver": driver, "half_range": float(np.ptp(table[driver]) / 2)})
    shown = showing(replace(survey, table=table), machine, [(truth, [0.02])], 0.003)
    found = make(EffectSpec("structure-drift", {"element": "carriage", "motion": "dx", "sensor": "T_0"}))
    linear = set_up(fit_machine(machine, replace(shown, table=shown.table.drop(columns="w_level"))))
    model, log = replayed(linear, [Step(found, 50.0, 100.0, 0.1)]), DecisionLog()
    left, _ = without_wanderers(model, log)
    assert [s.effect for s in left.steps] == [found] * kept
    (decision,) = (d for d in log if d.rule == "wanders-instead")
    assert decision.outcome == ("kept" if kept else "removed")


def test_a_finding_beside_something_larger_that_wanders_stays() -> None:
    machine = read_machine("bridge_cmm")
    survey = empty_survey(machine, 400, 11, channels=True, grid=False)
    joint, level = machine.joints[1].name, survey.table["w_level"].to_numpy()
    wander = {"element": "carriage", "motion": "dx", "driver": "w_level", "center": float(level.mean())}
    larger = EffectSpec("unnamed", {**wander, "half_range": float(np.ptp(level) / 2)})
    shown = showing(survey, machine, [(larger, [0.03]), (EffectSpec("backlash", {"joint": joint}), [0.006])], 0.003)
    hidden = replace(shown, table=shown.table.drop(columns="w_level"))
    found = make(EffectSpec("backlash", {"joint": joint}))
    model, log = replayed(set_up(fit_machine(machine, hidden)), [Step(found, 50.0, 100.0, 0.1)]), DecisionLog()
    left, _ = without_wanderers(model, log)
    (decision,) = (d for d in log if d.rule == "wanders-instead")
    assert decision.value is not None
    assert decision.value > 5.0  # what wanders has far more evidence
    assert [s.effect for s in left.steps] == [found]


@pytest.mark.parametrize("seed", first_of([3, 5]))
def test_what_the_travel_leaves_behind_is_no_curve_of_it(seed: int) -> None:
    """A state that the ends of strokes set, of 8 um in one direction: no curve of the position is its cause."""
    machine, rows = read_machine("bridge_cmm"), 300
    survey = empty_survey(machine, rows, seed, channels=False, grid=False)
    joint = machine.joints[0]
    low, high = joint.travel
    stroke = (low + high) / 2 + 0.49 * (high - low) * np.sin(2 * np.pi * np.arange(rows) / 100 + seed)
    ends = np.where(stroke > low + 0.7 * (high - low), 1.0, np.where(stroke < low + 0.3 * (high - low), -1.0, np.nan))
    state = pd.Series(ends).ffill().fillna(-1.0).to_numpy()
    truth = EffectSpec("unnamed", {"element": joint.name, "motion": "dy", "driver": "w_state"})
    table = survey.table.assign(**{joint.name: stroke, "w_state": state})
    shown = showing(replace(survey, table=table), machine, [(truth, [0.008])], 0.003)
    found = diagnose(machine, replace(shown, table=shown.table.drop(columns="w_state"))).diagnosis
    assert not [f.effect for f in found.findings if f.effect != "unnamed"]  # a curve was named before
    assert found.verdict != "adequate"


def test_what_is_left_over_is_no_less_than_what_depends_on_time() -> None:
    """A seat that clicks with the path, of 15 times the declared noise: more had been said of it than is left."""
    machine, rows = read_machine("vertical_three_axis"), 240
    survey = empty_survey(machine, rows, 6, channels=False, grid=False)
    x = survey.table["X"].to_numpy()
    low, high = machine.joints[0].travel
    moved = np.where(x > low + 0.8 * (high - low), 1.0, np.where(x < low + 0.2 * (high - low), 0.0, np.nan))
    state = pd.Series(moved).ffill().fillna(0.0).to_numpy()
    truth = EffectSpec("unnamed", {"element": "Y", "motion": "dz", "driver": "w_state"})
    table = survey.table.assign(time=30.0 * np.arange(rows), w_state=state)
    shown = showing(replace(survey, table=table), machine, [(truth, [0.03])], 0.002).table.drop(columns="w_state")
    found = diagnose(machine, replace(survey, table=shown.assign(sigma_x=0.002, sigma_y=0.002, sigma_z=0.002)))
    assert 0 < 1e3 * 3**0.5 * found.final.systematic_mm <= 1.001 * found.final.fitted.rms_um
    assert found.diagnosis.unexplained is None or found.diagnosis.unexplained.count("again and again") < 2


@pytest.mark.parametrize("jumps", first_of([1, 2]))
def test_a_hidden_state_is_modelled_where_and_when_it_changes(jumps: int, tmp_path: Path) -> None:
    """A seat that tips once, or there and back: no effect with a name does, and later poses are predicted better."""
    machine, rows = read_machine("vertical_three_axis"), 300
    survey = empty_survey(machine, rows, 4, channels=False, grid=False)
    time = 10.0 * np.arange(rows)
    state = np.where((time > 1203) & ((time < 1804) | (jumps == 1)), 1.0, 0.0)
    truth = EffectSpec("unnamed", {"element": "X", "motion": "ec", "driver": "w_state"})
    moving = replace(survey, table=survey.table.assign(time=time, w_state=state))
    hidden, true = (showing(moving, machine, [(truth, [6e-5])], noise).table for noise in (0.003, 1e-6))
    hidden = hidden.drop(columns="w_state")
    diagnosed = diagnose(machine, replace(survey, table=hidden[:225]))
    (finding,) = diagnosed.diagnosis.findings
    assert (finding.effect, finding.where, finding.driver, finding.motion) == ("unnamed", "X", ["time"], ["ec"])
    assert finding.next_measurement == "measure fixed targets again and again between the positions"
    same = {(a.effect, a.where): a.motion for a in finding.alternatives if not a.separable}
    assert all(f"{motion} of {where}" in finding.statement for (_, where), own in same.items() for motion in own)
    (spec,) = diagnosed.final.chain.machine.effects
    assert 1200 <= spec.options["edge"] <= 1210 if jumps == 1 else spec.options["pieces"]
    errors = []
    for name in ("baseline", "final"):
        store.save(getattr(diagnosed, name), tmp_path / name)
        later = predict(store.load(tmp_path / name), replace(survey, table=hidden[225:]))
        errors.append(np.linalg.norm(later[MEASURED].to_numpy() - true[MEASURED].to_numpy()[225:]))
    # beyond the recording a curve tends to its mean
    assert errors[1] < (0.5 if jumps == 1 else 1.0) * errors[0]


@pytest.mark.long
@pytest.mark.parametrize("timed", first_of([True, False]))
def test_beside_a_hidden_state_what_it_was_noise_to_is_named(timed: bool) -> None:
    """A seat that tips there and back, and a spindle that grows; with times, or with the order of the rows alone."""
    machine, rows = read_machine("vertical_three_axis"), 260
    survey = empty_survey(machine, rows, 4, channels=False, grid=False)
    time = 20.0 * np.arange(rows)
    warm = 20 + 6 * (1 - np.exp(-time / 1200)) + 2 * np.sin(time / 500)
    state = np.searchsorted([700.0, 1500.0, 2600.0, 4300.0], time) % 2
    states = survey.table.assign(time=time, T_spindle=warm, w_state=1.0 * state)
    hidden = EffectSpec("unnamed", {"element": "Z", "motion": "dx", "driver": "w_state"})
    growth = EffectSpec("spindle-growth", {"sensor": "T_spindle"})
    seen = showing(replace(survey, table=states), machine, [(hidden, [0.02]), (growth, [0.003])], 0.004).table
    diagnosed = diagnose(machine, replace(survey, table=seen.drop(columns=["w_state", *(() if timed else ("time",))])))
    found = {f.effect: f for f in diagnosed.diagnosis.findings}
    assert found.keys() == {"unnamed", "spindle-growth"}
    assert found["unnamed"].driver == ["time" if timed else "row"]
    (rate,) = found["spindle-growth"].parameters
    assert rate.value == pytest.approx(0.003, abs=4 * rate.std)


def test_rows_of_two_files_without_times_have_no_order() -> None:
    """Of what wanders from row to row no course is made: nothing says which file was measured first."""
    machine = read_machine("vertical_three_axis")
    survey = empty_survey(machine, 120, 3, channels=False, grid=False)
    table = survey.table.assign(file=np.where(np.arange(120) < 60, "a.csv", "b.csv"))
    linear = set_up(fit_machine(machine, replace(survey, table=table)))
    assert not linear.scene.clock
    assert _course(linear, "X", "dx") is None
