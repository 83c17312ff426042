"""Measurements of real machines: an arm seen by a laser tracker, and a printer's axis homed against a switch."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from errormodel.machine import Machine
from errormodel.machine_file import read_machine
from errormodel.survey import Survey, read_survey
from identification.diagnosis.pipeline import diagnose
from tests.helpers.commands import done
from tests.helpers.nightly import first_of

FIT_KEYS = {"parameters", "frame", "nominal", "fitted", "test", "sigma_um", "dof", "reduced_chi2"}
SPREAD = {"rms_um", "mean_um", "max_um", "n"}


def survey_yaml(folder: Path, data: Path, fit: str, test: str, more: str) -> Path:
    """A survey.yaml beside which the recordings seem to lie."""
    for name in (fit, test):
        (folder / name).symlink_to(data / name)
    path = folder / "survey.yaml"
    path.write_text(
        f"errormodel: 1\nfiles:\n  - {{path: {fit}, role: fit}}\n  - {{path: {test}, role: test}}\n{more}\n"
    )
    return path


@pytest.fixture(scope="module")
def arm(ur10: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """fit.json and the folder of a fit of series A, with series C held out, as the contract's example has it."""
    folder = tmp_path_factory.mktemp("ur10")
    survey = survey_yaml(folder, ur10, "series_a.csv", "series_c.csv", "frame: per-file\nrefit: [frame, tool]")
    done("fit", ur10 / "machine.yaml", survey, "--out", folder / "fit", "--quiet")
    return json.loads((folder / "fit/fit.json").read_text()), folder


def test_the_arm_is_fitted_and_predicts_another_series(arm: tuple[dict[str, Any], Path]) -> None:
    """The maker's dimensions leave 0.85 mm; fitted 0.44; held-out blocks 0.45; another day, elsewhere, 0.57."""
    fit, _ = arm
    assert set(fit) >= FIT_KEYS
    for spread in (fit["nominal"], fit["fitted"], fit["test"][0]["nominal"], fit["test"][0]["fitted"]):
        assert set(spread) >= SPREAD
    assert fit["nominal"]["n"] == 11911
    assert 830 < fit["nominal"]["rms_um"] < 870
    assert 430 < fit["fitted"]["rms_um"] < fit["heldout"]["rms_um"] < 460
    assert len(fit["test"]) == 1
    test = fit["test"][0]
    assert test["fitted"]["n"] == 2773
    assert 550 < test["fitted"]["rms_um"] < 590 < test["nominal"]["rms_um"]
    assert fit["converged"]
    # a 6-D target: of 36 parameters 30 groups, and the target's mount is estimated with them
    assert fit["n_parameters"] == 36
    assert fit["rank"] == 30
    assert len(fit["parameters"]) == 30
    assert {p["unit"] for p in fit["parameters"]} == {"mm", "rad"}


def test_a_test_file_estimates_its_frame_and_tool_only(arm: tuple[dict[str, Any], Path]) -> None:
    fit, _ = arm
    names = {name.rsplit(".", 1)[0] for name in fit["test"][0]["refit"]}
    assert names == {"frame[series_c.csv]", "tool"}
    assert [name for name in fit["test"][0]["refit"] if name.startswith("tool")] == ["tool.dx", "tool.dy", "tool.dz"]


def test_the_residuals_of_both_series_are_written(arm: tuple[dict[str, Any], Path]) -> None:
    fit, folder = arm
    table = pd.read_csv(folder / "fit/residuals.csv")
    assert len(table) == 11911 + 2773
    for role, spread in (("fit", fit["fitted"]), ("test", fit["test"][0]["fitted"])):
        own = table[table["role"] == role][[f"residual_{a}_um" for a in "xyz"]]
        assert (own**2).sum(axis=1).mean() ** 0.5 == pytest.approx(spread["rms_um"], rel=1e-9)


def test_the_arm_predicts_what_was_measured(arm: tuple[dict[str, Any], Path], real_data: Path) -> None:
    """Of series A the file itself: predictions are its measured positions but for the residuals."""
    fit, folder = arm
    done("predict", folder / "fit", folder / "series_a.csv", "--out", folder / "a.csv", "--quiet")
    predicted, measured = pd.read_csv(folder / "a.csv"), pd.read_csv(real_data / "ur10/series_a.csv")
    gap = (predicted[["mx", "my", "mz"]] - measured[["mx", "my", "mz"]]) ** 2
    assert 1e3 * gap.sum(axis=1).mean() ** 0.5 == pytest.approx(fit["fitted"]["rms_um"], rel=1e-6)
    errors = predicted[["ex", "ey", "ez"]]
    assert 0.3 < (errors**2).sum(axis=1).mean() ** 0.5 < 1.0
    assert (predicted[["ux", "uy", "uz"]] > 0).all(axis=None)
    assert predicted[["ux", "uy", "uz"]].median().max() < 0.05
    angles = [f"J{k}" for k in range(1, 7)]
    pd.testing.assert_frame_equal(predicted[angles], measured[angles], rtol=1e-12)  # degrees in, degrees out


@pytest.mark.parametrize("frame", first_of(["shared", "fixed", "per-file"]))
def test_a_switch_measures_one_component(printers: Path, tmp_path: Path, frame: str) -> None:
    """Only mz is measured: what stays of the frame is a height, the rest is neither estimated nor missed."""
    survey = survey_yaml(tmp_path, printers, "homing_a.csv", "homing_b.csv", f"frame: {frame}")
    result = done("fit", printers / "machine.yaml", survey, "--out", tmp_path / "fit", "--quiet")
    assert result.out == ""
    assert all(line.startswith("note: ") for line in result.err.splitlines())
    fit = json.loads((tmp_path / "fit/fit.json").read_text())
    assert set(fit) >= FIT_KEYS
    assert [p["id"] for p in fit["parameters"]] == ["frame.dz"]
    assert fit["dof"] == fit["fitted"]["n"] - 1 == 1082
    commands = pd.read_csv(printers / "homing_a.csv")
    spread = 1e3 * commands["Z"].std(ddof=0)  # nothing but the frame's height is fitted
    assert fit["fitted"]["rms_um"] == pytest.approx(spread, rel=1e-6)
    assert fit["sigma_um"] == pytest.approx(1e3 * commands["Z"].std(ddof=1), rel=1e-6)
    done("predict", tmp_path / "fit", tmp_path / "homing_a.csv", "--out", tmp_path / "p.csv", "--quiet")
    predicted = pd.read_csv(tmp_path / "p.csv")
    assert len(predicted) == 1083
    assert predicted["mz"].mean() == pytest.approx(0.0, abs=1e-9)  # the switch, in the mean
    # the height wanders while the machine heats: a thousand rows say hardly more than a dozen independent ones
    assert any("correlated over" in note for note in fit["notes"])
    independent = 1e-3 * fit["sigma_um"] / 1083**0.5
    assert (predicted["uz"] > 5 * independent).all()
    assert (predicted["uz"] < 1e-3 * fit["sigma_um"]).all()


# ---- diagnosis, on thinned rows: the whole series takes minutes

CURVES = {"J1": "ec", "J2": "eb", "J3": "eb", "J4": "eb", "J5": "ec"}


def thinned(ur10: Path, every: int) -> tuple[Machine, Survey]:
    """The arm, and each so-many-th pose of series C."""
    machine = read_machine(ur10)
    survey = read_survey(ur10 / "series_c.csv", machine)
    return machine, replace(survey, table=survey.table.iloc[::every].reset_index(drop=True))


@pytest.mark.long
def test_what_is_left_over_is_a_curve_of_each_joints_own_angle(ur10: Path) -> None:
    found = diagnose(*thinned(ur10, 10))
    curves = {f.where: f for f in found.diagnosis.findings if f.effect == "higher-order-geometry"}
    seen = {joint: (f.motion[0], f.driver) for joint, f in curves.items() if joint in CURVES}  # the wrist may have one
    assert seen == {joint: (motion, [joint]) for joint, motion in CURVES.items()}
    assert found.baseline.heldout.rms_um > 440
    assert found.final.heldout.rms_um < 150  # of 278 poses; of all 2773, below 100
