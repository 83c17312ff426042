"""A ball on a rotary table that a probe centres: commands are the indicated axes, measured is always its place."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from errormodel.survey import read_survey
from identification import fit
from identification.diagnosis.data_checks.checks import find_blunders
from identification.diagnosis.data_checks.duplicates_and_clock import copied_rows
from identification.importing.exchanged_rows import FEWEST_PROVED
from identification.importing.text import _places
from tests.helpers.commands import XYZ, run
from tests.system.test_r_test import MILL, r_test, shifted

# errors of the linear axes too: a machine that does not move at all fits the place of one ball
WITH_SCALES = MILL.replace("joints: none", "joints: {Y: first-order, X: first-order, Z: first-order}")
BALL = (50.0, 20.0, 100.0)


def probed(balls: Sequence[tuple[float, float, float]] = (BALL,)) -> pd.DataFrame:
    """The R-test's rows as a probe gives them: the axes move by what the tip stood off, to first order in errors."""
    table = r_test([*balls], rows=90)
    places = np.array([balls[k % len(balls)] for k in range(90)])
    for k, (c, a) in enumerate(np.radians(table[["C", "A"]].to_numpy())):
        about_z = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
        about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
        off = table.loc[k, XYZ].to_numpy(dtype=float) - places[k]
        table.loc[k, ["X", "Y", "Z"]] -= (about_z @ about_x).T @ off
    table[XYZ] = places
    return table


def test_a_probed_ball_is_fitted_as_an_r_test_is(tmp_path: Path) -> None:
    (tmp_path / "mill.yaml").write_text(WITH_SCALES)
    found = {}
    for name, table in (("r-test", r_test([BALL], rows=90)), ("probed", probed())):
        table.to_csv(tmp_path / "data.csv", index=False)
        result = run("fit", tmp_path / "mill.yaml", tmp_path / "data.csv", "--out", tmp_path / name)
        assert result.code == 0, result.err
        assert "ran away" not in result.err
        assert "invalid value" not in result.err
        fit = json.loads((tmp_path / name / "fit.json").read_text())
        found[name] = {p["id"]: (p["value"], p["std"]) for p in fit["parameters"]}
        assert abs(fit["sigma_um"] - 1) < 0.25
    assert {*found["probed"]} == {*found["r-test"]}
    for identity, (value, std) in found["probed"].items():
        assert abs(value - found["r-test"][identity][0]) < std, identity


def test_tables_of_readings_without_a_proved_sign_say_so_first(tmp_path: Path) -> None:
    """Commands are nominal, and the deviation of the indicated axes was added to the ball's place: the wrong sign."""
    table = r_test([BALL], rows=90)
    table[XYZ] = 2 * np.array(BALL) - table[XYZ]
    (tmp_path / "mill.yaml").write_text(WITH_SCALES)
    table.to_csv(tmp_path / "data.csv", index=False)
    run("fit", tmp_path / "mill.yaml", tmp_path / "data.csv", "--out", tmp_path / "fit")
    assert json.loads((tmp_path / "fit" / "fit.json").read_text())["open_signs"]
    result = run("compensate", tmp_path / "fit", "--controller", "csv", "--out", tmp_path / "tables")
    assert result.code == 0, result.err
    first = (tmp_path / "tables" / "checklist.txt").read_text().split("FIRST: ")[1]
    assert first.startswith("the sign of all corrections is that of the readings, which nothing proves")


def test_a_place_that_does_not_change_has_no_sign(tmp_path: Path) -> None:
    (tmp_path / "mill.yaml").write_text(WITH_SCALES)
    probed().to_csv(tmp_path / "data.csv", index=False)
    result = run("fit", tmp_path / "mill.yaml", tmp_path / "data.csv", "--out", tmp_path / "fit")
    assert "signs" not in result.err
    assert "open_signs" not in json.loads((tmp_path / "fit" / "fit.json").read_text())


@pytest.mark.parametrize("turned", [False, True])
def test_indicated_positions_are_read_as_deviations_from_nominal_commands(turned: bool) -> None:
    """The rows of the R-test again, but for its commands' rounding, 0.5 um an axis; also in a frame that is turned."""
    machine = read_machine(yaml.safe_load(WITH_SCALES))
    balls = [BALL, (-40.0, 60.0, 80.0), (10.0, -70.0, 120.0)] if turned else [BALL]
    frame = shifted((3.0, -7.0, 5.0), (0.1, -0.2, 2.0)) if turned else np.eye(4)
    straight = r_test(balls, rows=90)
    table = probed(balls)
    table[XYZ] = table[XYZ].to_numpy() @ frame[:3, :3].T + frame[:3, 3]
    survey = read_survey(table, machine)
    assert survey.indicated
    assert any("indicated positions" in note for note in survey.notes)
    beside = straight[XYZ].to_numpy() - np.array([balls[k % len(balls)] for k in range(90)])
    seen = survey.measured - table[XYZ].to_numpy()
    apart = (seen @ frame[:3, :3] - beside).reshape(-1, len(balls), 3)  # by a constant of each ball
    assert np.ptp(apart, axis=0).max() < 2e-3 < 0.02 < np.ptp(beside, axis=0).max()
    assert np.abs(survey.commands(["X", "Y", "Z"]) - straight[["X", "Y", "Z"]].to_numpy()).max() < 0.05


def test_a_pose_that_is_probed_again_and_again_is_one_pose() -> None:
    rows = pd.concat([probed()[:3]] * 30, ignore_index=True)
    drift = np.repeat(np.arange(30), 3) * 1e-3
    rows["Z"] += drift
    survey = read_survey(rows, read_machine(yaml.safe_load(WITH_SCALES)))
    assert len(survey.table[["C", "A", "X", "Y", "Z"]].drop_duplicates()) == 3
    lengths = np.linalg.norm(np.diff(survey.measured.reshape(30, 3, 3), axis=0), axis=2)
    assert np.abs(lengths - 1e-3).max() < 1e-5


def test_a_stopped_instrument_and_readings_of_an_r_test_stay_as_they_are() -> None:
    machine = read_machine(yaml.safe_load(WITH_SCALES))
    straight, stopped = r_test([BALL], rows=40), r_test([BALL], rows=40)
    stopped.loc[10:20, XYZ] = stopped.loc[10, XYZ].to_numpy()
    for table in (straight, stopped):
        survey = read_survey(table, machine)
        assert not survey.indicated
        assert (survey.measured == table[XYZ].to_numpy()).all()


def test_balls_whose_place_is_zero_in_frames_of_their_own_are_no_copies(tmp_path: Path) -> None:
    balls = [BALL, (-40.0, 60.0, 80.0), (10.0, -70.0, 120.0)]
    table = probed(balls)
    table["run"] = np.arange(90) % 3
    table[XYZ] = 0.0
    table.sort_values("run").to_csv(tmp_path / "data.csv", index=False)
    (tmp_path / "mill.yaml").write_text(WITH_SCALES)
    (tmp_path / "survey.yaml").write_text("errormodel: 1\nfiles: [{path: data.csv}]\nframe: per-run\n")
    result = run("check", tmp_path / "mill.yaml", tmp_path / "survey.yaml")
    assert result.code == 0, result.err


def test_the_same_reading_in_another_frame_is_no_copy() -> None:
    """As the place of a ball is that each run has as its zero."""
    machine = read_machine(yaml.safe_load(WITH_SCALES))
    survey = read_survey(r_test([BALL, (-40.0, 60.0, 80.0), (10.0, -70.0, 120.0)], rows=90), machine)
    again = np.arange(90) // 3  # each reading stands in every run
    table = survey.table.assign(mx=1.0 * again, my=0.0, mz=0.0, run=np.arange(90) % 3)
    table = table.sort_values("run", ignore_index=True)
    copies = copied_rows(Chain(machine), replace(survey, table=table, frame="shared"))
    assert copies is not None
    assert copies.rows is not None
    assert len(copies.rows) > 50
    assert copied_rows(Chain(machine), replace(survey, table=table, frame="per-run")) is None


BALLS = [BALL, (-40.0, 60.0, 80.0), (10.0, -70.0, 120.0)]
MISTAKES = {
    "the sign of column A is wrong": lambda t: t.assign(A=-t["A"]),
    "column A is in another unit: it must be multiplied by 57.2958": lambda t: t.assign(A=np.radians(t["A"])),
    "columns Y and X are swapped": lambda t: t.assign(X=t["Y"], Y=t["X"]),
    "column Z has another zero": lambda t: t.assign(Z=t["Z"] + 2.0),
    "column A stands 1 row too late beside the other columns": lambda t: t.assign(A=t["A"].shift(1, fill_value=0)),
    "column C stands 2 rows too early beside the other columns": lambda t: t.assign(C=t["C"].shift(-2, fill_value=0)),
}


@pytest.mark.parametrize("said", MISTAKES)
def test_a_mistake_in_commands_makes_no_copies_of_balls(said: str) -> None:
    """The same values are measured in many rows by design; with the mistake put right the rows are known as such."""
    machine = read_machine(yaml.safe_load(WITH_SCALES))
    survey = read_survey(MISTAKES[said](probed(BALLS)), machine)
    assert not survey.indicated
    (found,) = find_blunders(machine, survey)
    assert found.text.startswith(said)
    assert found.survey.indicated
    with pytest.raises(InputError, match=re.escape(said)):
        fit(machine, survey)


def test_balls_of_other_commands_are_no_copies_either() -> None:
    machine = read_machine(yaml.safe_load(WITH_SCALES))
    table = probed(BALLS)
    rng = np.random.default_rng(0)
    survey = read_survey(table.assign(A=rng.permutation(table["A"]), C=rng.permutation(table["C"])), machine)
    with pytest.raises(InputError, match=r"are 3 places, read in 90 rows, and the nominal points .* If balls were"):
        find_blunders(machine, survey)


def test_an_instrument_that_stopped_made_copies() -> None:
    machine = read_machine(yaml.safe_load(WITH_SCALES))
    table = r_test(BALLS, rows=90)
    table.loc[20:, XYZ] = table.loc[20, XYZ].to_numpy()
    copies = copied_rows(Chain(machine), read_survey(table, machine))
    assert copies is not None
    assert copies.rows is not None
    assert len(copies.rows) == 69


def test_places_are_counted_as_places() -> None:
    """Three balls whose nominal places differ by the rounding of commands, at 3 decimals on either side of a half."""
    points = np.repeat([[140.0005, 20.0, 60.0], [-90.0, 70.0005, 160.0], [60.0, -110.0, 230.0]], 9, axis=0)
    rounded = points + np.random.default_rng(0).uniform(-1e-4, 1e-4, points.shape)
    assert _places(rounded) == 3
    assert _places(np.arange(300.0).reshape(-1, 3)) == FEWEST_PROVED
