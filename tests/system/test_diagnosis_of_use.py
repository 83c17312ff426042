"""What depends on how a machine was used: in motion, after a rest, and in which order without a clock."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from errormodel.survey import Survey
from identification.diagnosis.decisions.log import DecisionLog
from identification.diagnosis.extension import explained
from identification.diagnosis.pipeline import diagnose
from identification.estimation.fit import fit_machine
from identification.results import store
from identification.results.predictions import predicted
from identification.runtime.progress import silent
from identification.uncertainty.prediction import notes
from tests.helpers.commands import XYZ
from tests.helpers.diagnosed import empty_survey, showing
from tests.helpers.nightly import first_of


@pytest.fixture(scope="module")
def machine() -> Machine:
    return read_machine("vertical_three_axis")


def found(machine: Machine, survey: Survey):
    """Main effects of what explains a survey, and the fit with them."""
    explanation = explained(fit_machine(machine, survey), survey, [], silent, DecisionLog())
    return [g[0].effect for g in explanation.model.findings], explanation.final


def on_lines(machine: Machine, survey: Survey, clock: bool) -> Survey:
    """The rows on lines of 12, along one, two or three joints at one of four feeds."""
    rng, table = np.random.default_rng(8), survey.table.copy()
    low, high = np.array([j.travel for j in machine.joints]).T
    names, start = [j.name for j in machine.joints], 0.0
    for first in range(0, len(table), 12):
        rows = table.index[first : first + 12]
        ends = low + (high - low) * rng.uniform(0.05, 0.95, (2, len(names)))
        ends[1] = np.where(rng.permutation(3) < rng.integers(1, 4), ends[1], ends[0])
        share = np.sort(rng.uniform(0, 1, len(rows)))
        feed = rng.choice([1000.0, 3000.0, 6000.0, 12000.0])
        table.loc[rows, names] = ends[0] + np.outer(share, ends[1] - ends[0])
        table.loc[rows, "feed"] = feed
        table.loc[rows, "time"] = start + share * np.linalg.norm(ends[1] - ends[0]) / feed * 60
        table.loc[rows, [f"dir_{n}" for n in names]] = np.where(ends[1] < ends[0], -1.0, 1.0)
        start = table.loc[rows[-1], "time"] + 20
    return replace(survey, table=table if clock else table.drop(columns="time"))


@pytest.mark.parametrize("clock", first_of([False, True]))
def test_a_lag_has_the_share_of_its_joint_in_the_feed(machine: Machine, clock: bool) -> None:
    survey = on_lines(machine, empty_survey(machine, 240, 5, channels=False, grid=False), clock)
    spec = EffectSpec("servo-lag", {"joint": "X", "speed": "path"})
    (lag,), final = found(machine, showing(survey, machine, [(spec, [3e-4])], 0.003))
    assert (lag.effect, lag.where, lag.speed) == ("servo-lag", "X", "path")
    assert final.solution.named()["X.dx.servo-lag"] == pytest.approx(3e-4, rel=0.1)


def test_a_machine_that_cooled_while_it_rested_is_cold_after_the_next_rest(machine: Machine, tmp_path) -> None:
    survey = empty_survey(machine, 160, 5, channels=False, grid=False)
    time = 40.0 * np.arange(160) + np.repeat([0.0, 15000.0], 80)
    survey = replace(survey, table=survey.table.assign(time=time))
    rest = [[float(time[79]), float(time[80])]]
    spec = EffectSpec("warm-up", {"joint": "X", "tau": 1200.0, "rests": rest})
    (warm,), final = found(machine, showing(survey, machine, [(spec, [1e-4, 0.0])], 0.003))
    assert (warm.effect, warm.where, [list(r) for r in warm.rests]) == ("warm-up", "X", rest)
    store.save(final, tmp_path)
    later = replace(survey, table=survey.table.head(80).assign(time=1e5 + time[:80]))
    truth = showing(survey, machine, [(spec, [1e-4, 0.0])], 1e-9).table.head(80)  # as in the first hour
    gap = predicted(store.load(tmp_path), later)[["mx", "my", "mz"]] - truth[["mx", "my", "mz"]].to_numpy()
    assert np.sqrt(np.mean(np.sum(np.square(gap.to_numpy()), axis=1))) < 0.004  # mm; 0.02 of a machine that stays warm


def test_without_a_clock_the_row_says_when_the_station_moved(machine: Machine, tmp_path) -> None:
    survey = empty_survey(machine, 120, 5, channels=False, grid=False)
    spec = EffectSpec("station-shift", {"row": 70.5, "turned": False})
    shown = showing(survey, machine, [(spec, [0.02, 0.01, -0.01])], 0.003)
    (shift,), final = found(machine, shown)
    assert (shift.effect, shift.where, shift.drivers) == ("station-shift", "frame", ("row",))
    assert abs(shift.row - 70.5) < 3
    store.save(final, tmp_path)
    early = replace(survey, table=survey.table.head(40))  # its rows count from 1 again
    moved = predicted(store.load(tmp_path), early)[["mx", "my", "mz"]].to_numpy()
    gap = moved - shown.table.head(40)[["mx", "my", "mz"]].to_numpy()
    assert np.linalg.norm(gap.mean(axis=0)) == pytest.approx(np.linalg.norm([0.02, 0.01, -0.01]), rel=0.2)


@pytest.mark.long
def test_what_is_left_and_follows_something_recorded_is_in_the_uncertainty_of_predictions(
    machine: Machine, tmp_path: Path
) -> None:
    """A scale of Y that wanders: nothing has its name, nor its form, and other poses are wrong by it."""
    survey = empty_survey(machine, 240, 5, channels=False, grid=False)
    shown = showing(survey, machine, [], 0.002)
    wander = np.cumsum(np.random.default_rng(3).normal(size=240))
    wander -= wander.mean()
    table = shown.table.assign(my=shown.table["my"] + 4e-5 * wander / wander.std() * shown.table["Y"])
    diagnosis = diagnose(machine, replace(shown, table=table))
    left = diagnosis.diagnosis.dependence
    assert left is not None
    store.save(diagnosis.final, tmp_path)
    fit = store.load(tmp_path)
    known = predicted(replace(fit, systematic=0.0), survey)["uy"].to_numpy()
    whole = predicted(fit, survey)["uy"].to_numpy()
    of_coordinate = 1e-3 * left.size_um / np.sqrt(3)
    assert np.sqrt(whole**2 - known**2) == pytest.approx(of_coordinate)
    assert fit.data["systematic_by"] == "recorded"
    assert any("depends on what was recorded" in note for note in notes(fit, survey))
    lines = {i["name"]: i["std"] for i in fit.data["budget"]["prediction"]["inputs"]}
    assert max(v for name, v in lines.items() if name.startswith("form of the model")) >= of_coordinate


def test_what_exceeds_the_declared_uncertainty_is_in_that_of_predictions(machine: Machine, tmp_path: Path) -> None:
    """Two micrometres that nothing recorded predicts, beside two of declared noise: scatter of each row, it may be."""
    survey = empty_survey(machine, 240, 5, channels=False, grid=False)
    table = showing(survey, machine, [], 0.002).table
    jumps = np.random.default_rng(4).normal(0, 0.002, (240, 3))
    noisy = replace(
        survey,
        table=table.assign(
            sigma_x=0.002,
            sigma_y=0.002,
            sigma_z=0.002,
            **dict(zip(XYZ, (table[XYZ] + jumps).to_numpy().T, strict=True)),
        ),
    )
    diagnosis = diagnose(machine, noisy)
    assert diagnosis.diagnosis.verdict == "unexplained"
    assert diagnosis.final.systematic_mm == pytest.approx(0.002, rel=0.1)
    store.save(diagnosis.final, tmp_path)
    (note,) = [n for n in notes(store.load(tmp_path), survey) if n.startswith("the diagnosis left")]
    assert "um of a coordinate beyond the declared uncertainty, which nothing recorded predicts: each row may" in note
    assert "no noise" not in note
