"""Runs of an interferometer that do not repeat each other: a zero lost half-way, another sign or unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.helpers.commands import run
from tests.helpers.interferometer import MILL, Array, positioning, record, screw, targets, written


@pytest.fixture
def mill(tmp_path: Path) -> Path:
    path = tmp_path / "mill.yaml"
    path.write_text(MILL)
    return path


@pytest.mark.parametrize("command", ["fit", "diagnose"])
def test_a_zero_lost_half_way_is_refused(tmp_path: Path, mill: Path, command: str):
    table = positioning(4, runs=3)
    table.loc[30:43, "dx"] += 12.0  # to the end of the second run of 22 readings
    result = run(command, mill, written(tmp_path, table), "--out", tmp_path / "out")
    assert result.code == 2
    assert "run 2 about X changes by 1" in result.err
    assert "between rows 30 and 31 beside the other runs" in result.err


@pytest.mark.parametrize(("factor", "words"), [(-1, "the opposite sign"), (1e-3, "a thousandth"), (1e3, "1000 times")])
def test_a_run_of_another_sign_or_unit_is_refused(tmp_path: Path, mill: Path, factor: float, words: str):
    table = positioning(0, runs=3)
    table.loc[22:43, "dx"] *= factor
    result = run("fit", mill, written(tmp_path, table, dx="um"), "--out", tmp_path / "out")
    assert result.code == 2
    assert "run 2 about X" in result.err
    assert words in result.err


@pytest.mark.parametrize("seed", range(8))
def test_runs_that_warm_up_or_have_play_are_not_refused(tmp_path: Path, mill: Path, seed: int):
    """A drift in every run, larger in the first, no step: 60 um in two hours, with 6 um of backlash."""
    rng = np.random.default_rng(seed)

    def motion(q: Array, side: Array, time: Array, bed: Array) -> Array:
        return screw(q, side, time, bed) + 3 * side + 60 * (1 - np.exp(-time / 1500))

    table = record("X", {"dx": motion}, targets(20, 580, 11, rng), rng, runs=4)
    assert run("fit", mill, written(tmp_path, table), "--out", tmp_path / "out").code == 0
