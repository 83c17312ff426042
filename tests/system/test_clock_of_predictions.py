"""Times of points count from the zero of the fitted survey's clock, also where both are dates."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.chain import Chain
from errormodel.machine_file import read_machine
from identification import load
from tests.helpers.commands import MILL, XYZ, done, run, write

BEGIN = pd.Timestamp("2026-03-01 10:02:03")
EFFECTS = "[{effect: tracker-drift, start: 0, duration: 7200, tau: 1800}]"


def _dated(table: pd.DataFrame, begin: pd.Timestamp = BEGIN) -> pd.DataFrame:
    return table.assign(time=(begin + pd.to_timedelta(table["time"], unit="s")).astype(str))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fits of a machine whose frame drifts with time: `dated` of a survey with dates, `seconds` of the same in s."""
    folder = tmp_path_factory.mktemp("clock")
    text = (Path(__file__).resolve().parents[2] / "machines" / f"{MILL}.yaml").read_text(encoding="utf-8")
    machine = write(folder / "machine.yaml", f"{text}\neffects: {EFFECTS}\n")
    done("simulate", MILL, 120, "--out", folder / "p.csv")
    points = pd.read_csv(folder / "p.csv").drop(columns=XYZ).assign(time=np.linspace(0.0, 7140.0, 120))
    points.to_csv(folder / "p.csv", index=False)
    truth = write(folder / "truth.yaml", "parameters: {frame.dx.tracker-drift: 0.2}\n")
    done("simulate", machine, folder / "p.csv", "--parameters", truth, "--noise", 0.001, "--out", folder / "s.csv")
    survey = pd.read_csv(folder / "s.csv")
    _dated(survey).to_csv(folder / "dated.csv", index=False)
    for name, file in (("seconds", "s.csv"), ("dated", "dated.csv")):
        done("fit", machine, folder / file, "--out", folder / name)
    points.iloc[90:].to_csv(folder / "late.csv", index=False)
    _dated(points.iloc[90:]).to_csv(folder / "late_dated.csv", index=False)
    return folder


def _predicted(folder: Path, fit: str, points: str) -> tuple[pd.DataFrame, str]:
    said = done("predict", folder / fit, folder / points, "--out", folder / "out.csv").err
    return pd.read_csv(folder / "out.csv"), said


def test_dates_of_points_go_on_from_those_of_the_survey(folder: Path) -> None:
    wanted, _ = _predicted(folder, "seconds", "late.csv")
    got, said = _predicted(folder, "dated", "late_dated.csv")
    np.testing.assert_allclose(got[XYZ], wanted[XYZ], atol=1e-5)
    np.testing.assert_allclose(got["time"], wanted["time"], atol=1e-3)
    assert said.count("time 0 is 2026-03-01 10:02:03") == 1
    assert json.loads((folder / "dated/fit.json").read_text())["clock_zero"] == "2026-03-01T10:02:03.000000"
    notes = load(folder / "dated").predict(folder / "late_dated.csv").attrs["notes"]
    assert sum("time 0 is" in note for note in notes) == 1
    assert "clock_zero" not in json.loads((folder / "seconds/fit.json").read_text())


def test_seconds_count_from_the_first_date_of_the_survey(folder: Path) -> None:
    wanted, _ = _predicted(folder, "seconds", "late.csv")
    got, said = _predicted(folder, "dated", "late.csv")
    np.testing.assert_allclose(got[XYZ], wanted[XYZ], atol=1e-5)
    assert "time 0 is 2026-03-01 10:02:03" in said


def test_a_day_later_is_beyond_what_was_measured(folder: Path) -> None:
    points = pd.read_csv(folder / "late.csv")
    _dated(points, BEGIN + pd.Timedelta(days=1)).to_csv(folder / "day.csv", index=False)
    got, said = _predicted(folder, "dated", "day.csv")
    np.testing.assert_allclose(got["time"], points["time"] + 86400.0, atol=1e-3)
    assert "beyond what was measured of time" in said


def test_dates_are_refused_where_the_survey_had_seconds(folder: Path) -> None:
    refused = run("predict", folder / "seconds", folder / "late_dated.csv", "--out", folder / "no.csv")
    assert refused.code == 2
    assert "late_dated.csv, column time: dates, where the fitted survey has seconds" in refused.err
    assert not (folder / "no.csv").exists()


@pytest.fixture(scope="module", params=["", ", tau: 900"])
def growing(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fit of a machine whose X grows with a temperature, at once or late."""
    folder = tmp_path_factory.mktemp("growing")
    text = (Path(__file__).resolve().parents[2] / "machines" / f"{MILL}.yaml").read_text(encoding="utf-8")
    effect = f"{{effect: scale-expansion, joint: X, sensor: T_bed{request.param}}}"
    machine = write(folder / "machine.yaml", f"{text}\neffects: [{effect}]\n")
    done("simulate", MILL, 80, "--out", folder / "p.csv")
    time = np.linspace(0.0, 7200.0, 80)
    points = pd.read_csv(folder / "p.csv").drop(columns=XYZ).assign(time=time, T_bed=20 + 3e-4 * time)
    points.to_csv(folder / "p.csv", index=False)
    truth = write(folder / "truth.yaml", "parameters: {X.dx.scale-expansion: 1.1e-5}\n")
    done("simulate", machine, folder / "p.csv", "--parameters", truth, "--noise", 1e-5, "--out", folder / "s.csv")
    done("fit", machine, folder / "s.csv", "--out", folder / "fit")
    return folder


def test_one_clock_has_one_temperature_at_a_time(growing: Path) -> None:
    """Two states written at one time were averaged in silence, and both predicted alike."""
    poses = pd.read_csv(growing / "p.csv").drop(columns=["time", "T_bed"]).head(2)
    start, warm, hot = (
        poses.assign(time=t, T_bed=kelvin) for t, kelvin in ((0.0, 20.0), (9000.0, 22.0), (9000.0, 23.0))
    )
    pd.concat([start, warm, hot]).to_csv(growing / "same.csv", index=False)
    got = run("predict", growing / "fit", growing / "same.csv", "--out", growing / "out.csv")
    assert got.code == 2
    assert "same.csv, row 5, column T_bed: 23 degC, where row 3 has 22 degC at the same time, 9000 s" in got.err
    cases = pd.concat([start, warm, hot]).assign(time=9000.0)
    cases.to_csv(growing / "cases.csv", index=False)
    runs = pd.concat([t.assign(run=r) for r, ts in (("a", (start, warm)), ("b", (start, hot))) for t in ts])
    runs.to_csv(growing / "runs.csv", index=False)
    (growing / "noise.csv").write_text(
        pd.concat([start, start.assign(T_bed=20.3), warm]).to_csv(index=False), encoding="utf-8"
    )
    for name in ("cases", "runs", "noise"):
        done("predict", growing / "fit", growing / f"{name}.csv", "--out", growing / "out.csv")
        if name == "cases":
            table = pd.read_csv(growing / "out.csv")
            moved = table[XYZ].iloc[4:].to_numpy() - table[XYZ].iloc[2:4].to_numpy()
            grown = 1.1e-5 * np.abs(poses["X"].to_numpy())
            np.testing.assert_allclose(np.linalg.norm(moved, axis=1), grown, atol=2e-5)


def test_what_acts_at_once_takes_the_temperature_of_its_row(growing: Path) -> None:
    """Three states a second apart were smoothed into one, in silence; what acts late follows them, which is said."""
    late = "tau" in (growing / "machine.yaml").read_text(encoding="utf-8")
    pose = pd.read_csv(growing / "p.csv").drop(columns=["time", "T_bed"]).head(1).assign(X=300.0)
    warm = np.array([20.2, 21.2, 22.1])
    states = pd.concat([pose] * 3).assign(T_bed=warm)
    out = dict[str, np.ndarray]()
    for name, time in (("seconds", [0.0, 1.0, 2.0]), ("one", 0.0), ("days", [86400.0, 172800.0, 259200.0])):
        states.assign(time=time).to_csv(growing / "states.csv", index=False)
        table, said = _predicted(growing, "fit", "states.csv")
        out[name] = table["ex"].to_numpy()
        assert ("T_bed acts up to 900 s late, and changes by 1 K in 1 s" in said) == (late and name == "seconds")
    np.testing.assert_allclose(np.diff(out["one"]), 300 * 1.1e-5 * np.diff(warm), rtol=0.01)
    np.testing.assert_allclose(out["days"], out["one"], atol=1e-4 if late else 1e-12)
    if late:
        assert np.ptp(out["seconds"]) < 0.01 * np.ptp(out["one"])
    else:
        np.testing.assert_allclose(out["seconds"], out["one"], atol=1e-12)


def test_dates_go_on_from_the_recording_where_a_lag_alone_takes_times(growing: Path, tmp_path: Path) -> None:
    """The lag had begun anew, 4 um away, since no channel is the time itself."""
    seen = pd.read_csv(growing / "s.csv")
    _dated(seen.iloc[:50]).to_csv(tmp_path / "s.csv", index=False)
    _dated(seen.iloc[50:].drop(columns=XYZ)).to_csv(tmp_path / "later.csv", index=False)
    done("fit", growing / "machine.yaml", tmp_path / "s.csv", "--out", tmp_path / "fit")
    table, said = _predicted(tmp_path, "fit", "later.csv")
    np.testing.assert_allclose(table[XYZ], seen[XYZ].iloc[50:], atol=1e-4)  # of a noise of 1e-5
    assert "acts late, and what it was before the first row is not known" not in said


def test_noise_of_a_sensor_is_smoothed_as_in_the_fit(tmp_path: Path) -> None:
    """Later rows of the same recording are predicted by the course, and a note says so."""
    text = (Path(__file__).resolve().parents[2] / "machines" / f"{MILL}.yaml").read_text(encoding="utf-8")
    machine = write(tmp_path / "machine.yaml", f"{text}\neffects: [{{effect: spindle-growth, sensor: T_spindle}}]\n")
    done("simulate", MILL, 200, "--out", tmp_path / "p.csv")
    time = 40.0 * np.arange(200)
    points = pd.read_csv(tmp_path / "p.csv").drop(columns=XYZ).assign(time=time)
    warm = 20 + 6 * (1 - np.exp(-time / 3000))
    points.assign(T_spindle=warm).to_csv(tmp_path / "c.csv", index=False)
    (grown,) = (i for i in Chain(read_machine(machine)).ids if "spindle-growth" in i)
    truth = write(tmp_path / "truth.yaml", f"parameters: {{{grown}: 0.02}}\n")
    done("simulate", machine, tmp_path / "c.csv", "--parameters", truth, "--out", tmp_path / "s.csv")
    seen = pd.read_csv(tmp_path / "s.csv")
    noisy = seen.assign(T_spindle=warm + np.random.default_rng(1).normal(0, 0.05, 200))
    noisy.iloc[:120].to_csv(tmp_path / "s.csv", index=False)
    done("fit", machine, tmp_path / "s.csv", "--out", tmp_path / "fit")
    noise = json.loads((tmp_path / "fit/fit.json").read_text())["temperature_noise"]["T_spindle"]
    assert noise == pytest.approx(0.05, rel=0.25)
    noisy.iloc[120:].drop(columns=XYZ).to_csv(tmp_path / "later.csv", index=False)
    table, said = _predicted(tmp_path, "fit", "later.csv")
    off = (table[XYZ] - seen[XYZ].iloc[120:].reset_index(drop=True)).to_numpy()
    assert np.sqrt(np.mean(off[:, 2] ** 2)) < 0.6 * 0.02 * 0.05
    assert "T_spindle (by up to 0." in said
