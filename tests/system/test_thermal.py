"""Thermal models of error motions: what is found, how it is judged, and recordings that would mislead."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.channels import lagged
from errormodel.exceptions import InputError
from errormodel.machine import EffectSpec, Machine
from errormodel.machine_file import read_machine
from errormodel.simulation import measured_at
from errormodel.survey import Survey, read_survey
from errormodel.truth import Truth
from identification.diagnosis.data_checks.temperature_sensors import faults
from identification.report.thermal import POOR_TRANSFER_RATIO
from identification.thermal_drift.recordings import recordings
from identification.thermal_drift.selection import centred, choose
from identification.thermal_drift.stepwise import stepwise
from tests.helpers import thermal_cmm as cmm
from tests.helpers.commands import done, run
from tests.helpers.pages import Page

CMM = "bridge_cmm"
FILES = "errormodel: 1\nfiles:\n- {path: drift.csv}\n- {path: other.csv, role: test}\n"


@cache
def bridge() -> Machine:
    return read_machine(CMM)


@cache
def tables() -> tuple[pd.DataFrame, pd.DataFrame]:
    """The bridge's drift at four positions, and another cycle at three others."""
    drift, other = cmm.drift_recordings(11), cmm.other_cycle(11)
    return tuple(t[t["joint"] == "Y"].drop(columns=["X", "Z"]).reset_index(drop=True) for t in (drift, other))  # type: ignore[return-value]


def written(folder: Path, drift: pd.DataFrame, other: pd.DataFrame | None, files: str = FILES) -> Path:
    folder.mkdir(exist_ok=True)
    drift.to_csv(folder / "drift.csv", index=False)
    if other is not None:
        other.to_csv(folder / "other.csv", index=False)
    (folder / "survey.yaml").write_text(files)
    return folder


def survey_of(folder: Path, drift: pd.DataFrame, other: pd.DataFrame) -> Survey:
    return read_survey(written(folder, drift, other), bridge())


@pytest.fixture(scope="module")
def modelled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = written(tmp_path_factory.mktemp("thermal"), *tables())
    printed = done("thermal", CMM, folder, "--out", folder / "out").out
    (folder / "printed.txt").write_text(printed)
    return folder


def test_another_cycle_is_predicted_to_the_noise_and_better_than_by_regression(modelled: Path) -> None:
    result = json.loads((modelled / "out/thermal.json").read_text())
    motions = {m["symbol"]: m for m in result["motions"]}
    assert set(motions) == {"EXY", "EYY", "EZY", "EAY", "EBY", "ECY"}
    left = {k: np.array([m[k] / m["noise"] for m in motions.values()]) for k in ("drift", "stepwise", "lagged")}
    assert left["lagged"].max() < 1.5
    beyond = {k: np.sqrt(np.mean(np.maximum(v**2 - 1, 0))) for k, v in left.items()}
    assert beyond["lagged"] < 0.6 * beyond["stepwise"] < 0.1 * beyond["drift"]
    assert motions["EZY"]["stepwise_r2"] > 0.99  # what the regressions are praised by
    assert motions["EZY"]["stepwise"] > 1.4 * motions["EZY"]["lagged"]
    size = motions["EYY"]["noise"]
    assert size == pytest.approx(cmm.NOISE["positioning"], rel=0.2)
    printed = (modelled / "printed.txt").read_text()
    assert "T_1 = T_2" in printed
    assert (modelled / "out/thermal_drift.png").stat().st_size > 10_000


def test_the_report_shows_what_each_motion_follows(modelled: Path) -> None:
    page = Page((modelled / "out/report.html").read_text())
    head, *rows = page.tables["thermal-motions"]
    assert head[:5] == ["Motion", "drift", "regression", "model", "noise"]
    assert [row[0] for row in rows] == ["EXY", "EYY", "EZY", "EAY", "EBY", "ECY"]
    assert all("T_" in row[-1] for row in rows)


def test_the_headline_of_the_report_says_what_another_cycle_leaves(modelled: Path) -> None:
    text = (modelled / "out/report.html").read_text(encoding="utf-8")
    (headline,) = re.findall(r'<p class="headline">(.*?)</p>', text)
    left = re.fullmatch(
        r"Drift of 6 error motions with temperature: in another thermal cycle the model leaves ([\d.]+) times the "
        r"noise, beyond the noise\.",
        headline,
    )
    assert left is not None
    assert 0 < float(left[1]) < POOR_TRANSFER_RATIO


def test_the_model_is_a_machine_that_fits_and_predicts(modelled: Path) -> None:
    """Another day in the room, not known to anybody: the drift of the tip between two positions of the bridge."""
    extended = read_machine(modelled / "out/machine.yaml")
    assert {e.effect for e in extended.effects} == {"structure-drift"}
    rng = np.random.default_rng(5)
    day = cmm.cycle(77, (5.0,), 3 * 3600)
    time = np.arange(0, 3 * 3600, 120.0)
    points = pd.DataFrame({"X": 100.0, "Y": np.resize([20.0, 280.0], len(time)), "Z": -100.0, "time": time})
    points.join(pd.DataFrame(day.sensors(time, rng), columns=list(cmm.NAMES))).to_csv(modelled / "p.csv", index=False)
    done("predict", modelled / "out", modelled / "p.csv", "--out", modelled / "predicted.csv")
    said = pd.read_csv(modelled / "predicted.csv")
    truth = cmm.thermal_motions("Y", points["Y"].to_numpy(), day.at(time))[:, 1]
    truth = truth - cmm.thermal_motions("Y", points["Y"].to_numpy(), day.at(time * 0))[:, 1]
    # of the rigid bridge at (100, -200 mm): its own drift and those of its angles with their levers
    ea, ec = (cmm.thermal_motions("Y", points["Y"].to_numpy(), day.at(time))[:, k] for k in (3, 5))
    truth = truth + ec * 40.0 - ea * (560.0 - 100.0 - 200.0)
    gap = 1e3 * (said["ey"].to_numpy() - truth)
    steps = gap[1::2] - gap[::2]
    assert 1e3 * np.ptp(truth) > 8
    assert np.sqrt(np.mean(np.square(steps - steps[0]))) < 0.5
    wanting = pd.read_csv(modelled / "p.csv").drop(columns=[str(extended.effects[0].options["sensor"])])
    wanting.to_csv(modelled / "q.csv", index=False)
    ended = run("predict", modelled / "out", modelled / "q.csv", "--out", modelled / "no.csv")
    assert (ended.code, (modelled / "no.csv").exists()) == (2, False)
    assert f"no column '{extended.effects[0].options['sensor']}'" in ended.err


@pytest.mark.long
def test_a_fit_of_the_extended_machine_takes_the_same_survey(modelled: Path) -> None:
    """A test file of error motions alone is no reason to stop."""
    done("fit", modelled / "out/machine.yaml", modelled, "--out", modelled / "refit")
    assert "other.csv holds error motions only" in json.loads((modelled / "refit/fit.json").read_text())["notes"][-1]
    values = [pd.read_csv(modelled / d / "parameters.csv").set_index("id")["value"] for d in ("out", "refit")]
    pd.testing.assert_series_equal(*values, rtol=1e-6, atol=1e-12)
    ended = run("thermal", modelled / "out/machine.yaml", modelled, "--out", modelled / "twice")
    assert ended.code == 2
    assert "a thermal model already" in ended.err


def test_the_right_sensor_and_lag_are_found() -> None:
    rng = np.random.default_rng(2)
    time = np.arange(0, 24000, 120.0)
    series = np.repeat(np.arange(4), len(time))
    position = np.repeat([-1.0, -0.3, 0.4, 1.0], len(time))
    lags = (0.0, 600.0, 2400.0)
    air = [np.cumsum(rng.normal(0, 0.3, (4, len(time))), axis=1) for _ in range(3)]
    channels = [np.concatenate([lagged(time, w, tau) if tau else w for w in a]) for a in air for tau in lags]
    warm = np.column_stack(channels) + rng.normal(0, 0.02, (len(series), 9))
    shapes = np.column_stack([np.ones(len(series)), position, (3 * position**2 - 1) / 2])
    columns = warm[:, :, None] * shapes[:, None, :]
    values = 2e-3 * channels[5] * position + 1e-3 * channels[0] + rng.normal(0, 3e-4, len(series))
    choice = choose(columns, values + np.array([3.0, -1.0, 0.5, 2.0])[series], series, 2, 3e-4)
    assert choice.picked[:2] in (((5, 1), (0, 0)), ((0, 0), (5, 1)))
    assert choice.error == pytest.approx(3e-4, rel=0.1)
    assert len(choose(columns, rng.normal(0, 3e-4, len(series)), series, 2, 3e-4).picked) <= 2


def test_a_stepwise_regression_is_exact_where_it_should_be() -> None:
    rng = np.random.default_rng(1)
    position, warm = np.repeat([0.0, 75.0, 200.0, 300.0], 50), rng.normal(0, 2, (200, 5))
    cubic: Callable[[Array], Array] = lambda p: 1 + 0.01 * p - 2e-4 * p**2 + 4e-7 * p**3  # noqa: E731
    values = cubic(position) * (3 * warm[:, 1] - warm[:, 4]) + 0.5
    found = stepwise(position, values + rng.normal(0, 1e-9, 200), warm)
    assert np.flatnonzero(np.abs(found.coefficients).max(axis=0) > 1e-6).tolist() == [0, 2, 5]
    assert found.r2 == pytest.approx(1.0)
    other, there = rng.normal(0, 2, (20, 5)), rng.uniform(0, 300, 20)
    said = found.predict(there, other)
    np.testing.assert_allclose(said, cubic(there) * (3 * other[:, 1] - other[:, 4]) + 0.5, atol=1e-6)


def test_means_are_taken_off_each_series() -> None:
    values = np.array([1.0, 3.0, 10.0, 14.0, 12.0])
    np.testing.assert_allclose(centred(values, np.array([0, 0, 1, 1, 1])), [-1, 1, -2, 2, 0])


def test_a_drift_along_the_travel_has_legendre_polynomials() -> None:
    options = {"element": "Y", "motion": "dx", "sensor": "T_a", "order": 2, "std": 0.002}
    machine = replace(bridge(), effects=(EffectSpec("structure-drift", options),))
    chain = Chain(machine)
    ids = chain.effect_ids[0]
    assert ids == tuple(f"Y.dx.structure-drift-T_a-{n}" for n in range(3))
    assert {chain.parameters[chain.index[i]].prior for i in ids} == {0.002}
    y = np.array([0.0, 100.0, 400.0])
    points = pd.DataFrame({"X": 0.0, "Y": y, "Z": 0.0, "T_a": 22.5, "joint": "Y"})
    points[["tool_x", "tool_y", "tool_z"]] = bridge().tool
    said = measured_at(machine, points, Truth(dict(zip(ids, (1e-3, 2e-3, 4e-3), strict=True))))["dx"]
    u = y / 200 - 1
    np.testing.assert_allclose(said, 2.5e-3 * (1 + 2 * u + 4 * (3 * u**2 - 1) / 2), atol=1e-12)
    shape = EffectSpec("structure-drift", {**options, "element": "bridge"})
    with pytest.raises(InputError, match="no joint of this name"):
        Chain(replace(bridge(), effects=(shape,)))


# --- recordings that would mislead


def test_a_thermocouple_that_died_half_way_is_left_out_and_named(tmp_path: Path) -> None:
    drift, other = (t.copy() for t in tables())
    rows = np.flatnonzero(drift["run"] == "Y200")
    drift.loc[rows[60:], "T_9"] = drift["T_9"].iloc[rows[60]]  # while it was warming up: 25 C, for ever
    drift.loc[rows[150:], "T_5"] = np.nan  # a recorder that says so
    other.loc[120:, "T_17"] = 1372.0  # what a broken wire reads; only in the cycle that judges
    taken = recordings(bridge(), survey_of(tmp_path, drift, other))
    assert set(taken.left_out) == {"T_9", "T_5", "T_17"}
    assert taken.left_out["T_9"].startswith(f"stuck at {drift['T_9'].iloc[rows[60]]:.4g} degC")
    assert "(drift.csv, run Y200)" in taken.left_out["T_9"]
    assert taken.left_out["T_5"].startswith("no value in 40 of 190 rows")
    assert "1372 degC" in taken.left_out["T_17"]
    assert not {"T_9", "T_5", "T_17"} & {s for g in taken.groups for s in g}


def test_living_thermocouples_stay() -> None:
    for table in tables():
        for _, part in table.groupby("run"):
            assert faults(part) == {}


@pytest.mark.parametrize("share", [0.35, 0.6, 0.85])
def test_death_is_seen_early_and_late(share: float) -> None:
    drift = tables()[0]
    part = drift[drift["run"] == "Y75"].reset_index(drop=True)
    at = int(share * len(part))
    part.loc[at:, "T_8"] = part.loc[at, "T_8"]
    assert list(faults(part)) == ["T_8"]
    assert "stuck" in faults(part)["T_8"]


def test_a_sensor_that_the_other_cycle_lacks_is_not_used(tmp_path: Path) -> None:
    drift, other = tables()
    taken = recordings(bridge(), survey_of(tmp_path, drift, other.drop(columns=["T_5"])))
    assert list(taken.left_out) == ["T_5"]
    assert "other.csv" in taken.left_out["T_5"]


def test_a_jump_in_time_leaves_its_shorter_side_out(tmp_path: Path) -> None:
    drift, other = (t.copy() for t in tables())
    rows = np.flatnonzero(drift["run"] == "Y75")
    gap = drift.drop(index=rows[30:60]).reset_index(drop=True)  # an hour is missing while it warms up
    taken = recordings(bridge(), survey_of(tmp_path, gap, other))
    (note,) = taken.notes
    assert "time jumps by 3720 s" in note
    assert f"rows {rows[0] + 1} to {rows[30]} of run Y75 (Y at 75) are left out" in note
    assert len(taken.survey) == len(gap) + len(other) - 30
    still = drift.drop(index=rows[-8:-3]).reset_index(drop=True)  # a pause when little happens
    assert recordings(bridge(), survey_of(tmp_path, still, other)).notes == ()


def test_rows_may_come_in_any_order_of_recordings(tmp_path: Path) -> None:
    """By position first, without labels of runs: what counts is the time of each recording."""
    drift, other = tables()
    mixed = other.sort_values(["Y", "time"], kind="stable").drop(columns="run")
    taken = recordings(bridge(), survey_of(tmp_path, drift.assign(run="1"), mixed.assign(run="1")))
    assert taken.notes == ()
    assert len({s for d in taken.test for s in d.series}) == 3


def _back(drift: pd.DataFrame) -> None:
    rows = np.flatnonzero(drift["run"] == "Y200")
    drift.loc[rows[80:], "time"] -= 3600.0


def _all_from_zero(drift: pd.DataFrame) -> None:
    drift["time"] -= drift.groupby("run")["time"].transform("min")


def _constant(drift: pd.DataFrame) -> None:
    drift[list(cmm.NAMES)] = 20 + 0.1 * (drift[list(cmm.NAMES)] - 20)


def _few(drift: pd.DataFrame) -> None:
    drift["Y"] = np.linspace(0, 400, len(drift))


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (_back, ["drift.csv, row 461, column time", "goes back by 3480 s within run Y200"]),
        (
            _all_from_zero,
            [
                "drift.csv, column time",
                "run Y0 (Y at 0) and run Y75 (Y at 75) claim the same hours",
                "a file of its own",
            ],
        ),
        (_constant, ["hardly change in the files to fit", "Record a warm-up"]),
        (_few, ["no error motion with 12 readings at one position"]),
    ],
)
def test_recordings_that_cannot_show_it_are_refused(
    tmp_path: Path, spoil: Callable[[pd.DataFrame], None], words: list[str]
) -> None:
    drift, other = (t.copy() for t in tables())
    spoil(drift)
    ended = run("thermal", CMM, written(tmp_path, drift, other), "--out", tmp_path / "out")
    assert (ended.code, (tmp_path / "out").exists()) == (2, False)
    for word in words:
        assert word in ended.err, ended.err


@pytest.mark.parametrize(
    ("drop", "word"),
    [(["time"], "no column time"), (list(cmm.NAMES), "no column T_<sensor>"), ([], "no file has role: test")],
)
def test_what_is_missing_is_named(tmp_path: Path, drop: list[str], word: str) -> None:
    drift, other = (t.drop(columns=drop) for t in tables())
    files = FILES if drop else "errormodel: 1\nfiles:\n- {path: drift.csv}\n"
    ended = run("thermal", CMM, written(tmp_path, drift, other, files), "--out", tmp_path / "out")
    assert ended.code == 2
    assert word in ended.err
