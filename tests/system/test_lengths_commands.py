"""Lengths through the commands: described before anything is measured, simulated, fitted, predicted, refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.machine_file import read_machine
from tests.helpers.commands import done, run
from tests.helpers.lengths import commands

SURVEY = """errormodel: 1
files: [{path: data.csv}]
observations:
  A: {type: station-distance, near: [900, -700, 200], dead_path: unknown, sigma: [0.5e-3, 0]}
  B: {type: station-distance, near: [-900, -600, 300], dead_path: unknown, sigma: [0.5e-3, 0]}
  C: {type: station-distance, near: [100, 1100, 100], sigma: [0.5e-3, 0]}
"""
TRUTH = "parameters: {saddle.ec: 5.0e-5, X.dx.1: 0.02}\nobservations: {A: {x: 905, y: -702, z: 190, dead_path: 31}}\n"
MACHINE = "vertical_three_axis"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Commands, and readings simulated at them, each with the survey.yaml."""
    path = tmp_path_factory.mktemp("lengths")
    rows = commands(read_machine(MACHINE), 90, np.random.default_rng(0))
    for name in ("planned", "measured"):
        (path / name).mkdir()
        (path / name / "survey.yaml").write_text(SURVEY)
    pd.concat([rows.assign(observation=k) for k in "ABC"]).to_csv(path / "planned/data.csv", index=False)
    (path / "truth.yaml").write_text(TRUTH)
    words = ["--parameters", str(path / "truth.yaml"), "--noise", "instrument"]
    done("simulate", MACHINE, str(path / "planned"), *words, "--out", str(path / "measured/data.csv"))
    done("fit", MACHINE, str(path / "measured"), "--out", str(path / "fitted"))
    return path


def test_a_planned_survey_is_described_before_it_is_measured(folder: Path) -> None:
    done("describe", MACHINE, str(folder / "planned"), "--json", str(folder / "planned.json"))
    done("describe", MACHINE, str(folder / "measured"), "--json", str(folder / "measured.json"))
    planned, measured = (json.loads((folder / f"{n}.json").read_text()) for n in ("planned", "measured"))
    assert planned["with_frame"]["rank"] == measured["with_frame"]["rank"] == 24 + 11  # three stations, two dead paths


def test_the_files_of_a_fit_hold_set_ups_and_residuals(folder: Path) -> None:
    fit = json.loads((folder / "fitted/fit.json").read_text())
    at = {v["id"]: v for v in fit["observations"]}
    assert len(at) == 11
    # the rigid motion between machine and stations is not known: distances between stations are
    places = [np.array([at[f"observation[{k}].{a}"]["value"] for a in "xyz"]) for k in "ABC"]
    true = [np.array(p) for p in ([905, -702, 190], [-900, -600, 300], [100, 1100, 100])]
    for k in range(3):
        one, other = (np.linalg.norm(p[k] - p[k - 1]) for p in (places, true))
        assert one == pytest.approx(other, abs=0.1)
    assert at["observation[A].dead_path"]["value"] == pytest.approx(31, abs=5 * at["observation[A].dead_path"]["std"])
    assert [r["observation"] for r in fit["readings"]] == ["A", "B", "C"]
    assert fit["noise"]["station-distance"]["declared"]
    table = pd.read_csv(folder / "fitted/residuals.csv")
    own = table.loc[table["observation"] == "A", "residual_length_um"]
    assert np.sqrt(np.mean(own**2)) == pytest.approx(fit["readings"][0]["fitted"])
    report = (folder / "fitted/report.html").read_text()
    assert "observation[A].dead_path" in report
    assert "Readings fitted: A" in report


def test_readings_are_predicted_with_their_uncertainty(folder: Path) -> None:
    done("predict", str(folder / "fitted"), str(folder / "measured"), "--out", str(folder / "p.csv"))
    predicted, measured = pd.read_csv(folder / "p.csv"), pd.read_csv(folder / "measured/data.csv")
    gap = predicted["length"] - measured["length"]
    assert np.sqrt(np.mean(gap**2)) < 0.6e-3  # the noise
    assert (predicted["u_length"] < 0.5e-3).all()  # known better than one reading
    assert {"ex", "ux"} <= {*predicted.columns}
    other = (folder / "measured/survey.yaml").read_text().replace("A:", "D:")
    (folder / "other").mkdir()
    measured.assign(observation=measured["observation"].replace("A", "D")).to_csv(
        folder / "other/data.csv", index=False
    )
    (folder / "other/survey.yaml").write_text(other)
    refused = run("predict", folder / "fitted", folder / "other", "--out", folder / "q.csv")
    assert refused.code == 2
    assert "the fit has no observation[D].x" in refused.err
    assert not (folder / "q.csv").exists()


def test_the_same_lengths_give_the_same_bytes(folder: Path) -> None:
    done("fit", MACHINE, str(folder / "measured"), "--out", str(folder / "again"))
    for name in ("fit.json", "parameters.csv", "residuals.csv", "covariance.csv"):
        assert (folder / "again" / name).read_bytes() == (folder / "fitted" / name).read_bytes()
