"""Dwells of a continuous log, found and averaged in one pass: those of the whole log, whatever the ranges."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import simulate
from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from errormodel.survey_rows import open_rows
from identification.importing.dwells import find_dwells
from identification.streaming.dwells import dwell_survey
from tests.helpers.commands import MILL, XYZ, done, run

JOINTS = ["X", "Y", "Z"]
NOISE = 0.002  # mm
LATE = 5  # readings by which the target follows a command


def log(places: int, seed: int = 0, unseen: float = 0.0) -> tuple[pd.DataFrame, pd.DataFrame]:
    """A log of dwells and the ways between them, and the true points; commands change before the target moves."""
    rng = np.random.default_rng(seed)
    true = simulate(MILL, places, {"X.dx.1": 2e-5}, seed=seed)
    at, targets = true[XYZ].to_numpy(), true[JOINTS].to_numpy()
    parts, commands = [], []
    for k in range(places):
        rest, way = int(rng.integers(80, 160)), 40
        share = np.linspace(0, 1, way + 2)[1:-1, None]
        parts.append(np.repeat(at[[k]], rest, axis=0))
        commands.append(np.repeat(targets[[k]], rest, axis=0))
        if k + 1 < places:
            commands[-1][-LATE:] = targets[k + 1]
            parts.append(at[k] + (at[k + 1] - at[k]) * share**2 * (3 - 2 * share))
            commands.append(np.repeat(targets[[k + 1]], way, axis=0))
    points = np.concatenate(parts)
    points += rng.normal(0, NOISE, points.shape)
    points[rng.random(len(points)) < unseen] = np.nan
    return pd.DataFrame(np.hstack([np.concatenate(commands), points]), columns=[*JOINTS, *XYZ]), true


@pytest.mark.long
@pytest.mark.parametrize("unseen", [0.0, 0.05])
@pytest.mark.parametrize("segment", [90, 777, 5000, 1 << 18])
def test_dwells_are_those_of_the_whole_log(segment: int, unseen: float) -> None:
    table, true = log(40, unseen=unseen)
    model = read_machine(MILL)
    found = dwell_survey(open_rows(table, model, every=True), segment=segment)
    whole = find_dwells(table[XYZ].to_numpy())
    assert whole is not None
    assert len(found) == len(whole) == 40
    assert found.table["row"].tolist() == (whole.first + 1).tolist()
    means = [table[XYZ].iloc[a : b + 1].mean() for a, b in zip(whole.first, whole.last, strict=True)]
    np.testing.assert_allclose(found.measured, means, rtol=0, atol=1e-10)  # round-off of sums
    # commands are those of the place, though the last readings have the next one
    np.testing.assert_array_equal(found.commands(JOINTS), true[JOINTS])
    assert np.abs(found.measured - true[XYZ].to_numpy()).max() < 6 * NOISE / np.sqrt(60)


def test_the_command_fits_the_means(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    log(60)[0].to_parquet("log.parquet", index=False)
    result = done("fit", MILL, "log.parquet", "--dwells", "--robust", "--out", "o")
    assert "60 dwells of" in result.err
    assert "60 rows" in result.out
    assert len(pd.read_csv("o/residuals.csv")) == 60
    simulate(MILL, 90, noise=0.002).to_csv("points.csv", index=False)
    other = run("fit", MILL, "points.csv", "--dwells", "--out", "p")
    assert other.code == 2
    assert "no continuous log" in other.err


def test_a_list_of_points_has_no_dwells() -> None:
    model = read_machine(MILL)
    with pytest.raises(InputError, match="no continuous log"):
        dwell_survey(open_rows(simulate(MILL, 300, noise=0.002), model, every=True))
