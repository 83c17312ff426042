"""Runs of an interferometer that do not repeat each other: a zero lost half-way, another sign or unit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.helpers.commands import done, run
from tests.helpers.interferometer import MILL, Array, positioning, record, screw, targets, written


@pytest.fixture
def mill(tmp_path: Path) -> Path:
    path = tmp_path / "mill.yaml"
    path.write_text(MILL)
    return path


@pytest.mark.long
def test_a_zero_lost_half_way_is_found(tmp_path: Path, mill: Path) -> None:
    table = positioning(6, runs=3)
    table.loc[30:43, "dx"] += 12.0  # to the end of the second run of 22 readings
    survey = written(tmp_path, table)
    refused = run("fit", mill, survey, "--out", tmp_path / "fit")
    assert refused.code == 2
    assert "run 2 about X changes by 1" in refused.err
    assert "between rows 30 and 31 beside the other runs" in refused.err
    done("diagnose", mill, survey, "--out", tmp_path / "out")
    found = json.loads((tmp_path / "out/diagnosis.json").read_text())
    first, *others = found["findings"]
    assert (first["effect"], first["where"], first["rows"]) == ("station-shift", "frame", list(range(31, 45)))
    assert [f["effect"] for f in others] == ["backlash"]  # which is there
    assert found["verdict"] == "explained"
    assert found["noise_um"] < 1


def test_rows_of_a_test_file_keep_their_run(tmp_path: Path, mill: Path) -> None:
    """They stand before the others in the survey, with the same labels of runs."""
    positioning(6, seed=2, runs=2).to_csv(tmp_path / "check.csv", index=False)
    table = positioning(6, runs=3)
    table.loc[30:43, "dx"] += 12.0
    survey = written(tmp_path, table)
    files = "files: [{path: check.csv, role: test}, {path: data.csv}]"
    survey.write_text(survey.read_text().replace("files: [{path: data.csv}]", files))
    done("diagnose", mill, survey, "--out", tmp_path / "out")
    first, *others = json.loads((tmp_path / "out/diagnosis.json").read_text())["findings"]
    assert (first["effect"], first["rows"]) == ("station-shift", list(range(31, 45)))
    assert [f["effect"] for f in others] == ["backlash"]


@pytest.mark.parametrize(("factor", "words"), [(-1, "the opposite sign"), (1e-3, "a thousandth"), (1e3, "1000 times")])
def test_a_run_of_another_sign_or_unit_is_refused(tmp_path: Path, mill: Path, factor: float, words: str) -> None:
    table = positioning(0, runs=3)
    table.loc[22:43, "dx"] *= factor
    survey = written(tmp_path, table, dx="um")
    result = run("fit", mill, survey, "--out", tmp_path / "out")
    assert result.code == 2
    assert "run 2 about X" in result.err
    assert words in result.err
    diagnosed = run("diagnose", mill, survey, "--out", tmp_path / "out")
    assert diagnosed.code == (0 if factor < 0 else 2)  # the sign may be a compensation's
    assert words in diagnosed.err


@pytest.mark.long
@pytest.mark.parametrize("seed", range(8))
def test_runs_that_warm_up_or_have_play_are_not_refused(tmp_path: Path, mill: Path, seed: int):
    """A drift in every run, larger in the first, no step: 60 um in two hours, with 6 um of backlash."""
    rng = np.random.default_rng(seed)

    def motion(q: Array, side: Array, time: Array, bed: Array) -> Array:
        return screw(q, side, time, bed) + 3 * side + 60 * (1 - np.exp(-time / 1500))

    table = record("X", {"dx": motion}, targets(20, 580, 11, rng), rng, runs=4)
    assert run("fit", mill, written(tmp_path, table), "--out", tmp_path / "out").code == 0


def test_positions_of_one_axis_in_metres_are_refused(tmp_path: Path, mill: Path) -> None:
    table = positioning(4)
    table["X"] /= 1000
    refused = run("fit", mill, written(tmp_path, table), "--out", tmp_path / "out")
    assert refused.code == 2
    assert "Write units: {X: m} in a survey.yaml; if they are right, units: {X: mm}" in refused.err
    assert run("fit", mill, written(tmp_path, table, X="m"), "--out", tmp_path / "out").code == 0
    assert run("fit", mill, written(tmp_path, table, X="mm"), "--out", tmp_path / "short").code == 0  # 0.6 mm of it
