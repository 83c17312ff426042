"""A set-up that was displaced from a row on: by centimetres it is refused, and a run of its own mends it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError
from identification import check, diagnose, fit, import_survey
from tests.helpers.importing import MILL, points, poses


def displaced(by_mm: float, runs: bool = False) -> pd.DataFrame:
    """Sixty poses of the mill; the probe was exchanged in the middle."""
    commands = poses(3, 60)
    table = commands.copy()
    behind = (np.arange(60) >= 30)[:, None] * np.array([0.0, 0.0, by_mm])
    table[["mx", "my", "mz"]] = points(commands, 3, 0.002) + behind
    return table.assign(run=np.where(np.arange(60) < 30, "a", "b")) if runs else table


def saved(table: pd.DataFrame, folder: Path) -> Path:
    path = folder / "points.csv"
    table.round(4).to_csv(path, index=False)
    return path


@pytest.mark.parametrize("command", [check, fit, diagnose])
def test_a_jump_of_centimetres_is_no_effect_and_no_parameter(command, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match="15 mm") as error:
        command(MILL, saved(displaced(15.0), tmp_path))
    assert "column run" in error.value.cure
    assert "frame: per-run" in error.value.cure


def test_a_small_jump_is_fitted_and_said(tmp_path: Path) -> None:
    result = fit(MILL, saved(displaced(0.5), tmp_path))
    assert any("from row 31 on the points lie 500 um" in note for note in result.notes)


def test_a_run_of_its_own_gives_an_import_frames_a_run(tmp_path: Path) -> None:
    """The advice can be followed: a column run, and the import finds that each run has a frame."""
    with pytest.raises(InputError, match="15 mm"):
        import_survey(saved(displaced(15.0), tmp_path), MILL)
    path = saved(displaced(15.0, runs=True), tmp_path)
    result = import_survey(path, MILL)
    assert result.survey.frame == "per-run"
    assert "each run or station has a measuring frame of its own" in result.summary()
    assert import_survey(path, MILL, frame="per-run").survey.frame == "per-run"
    with pytest.raises(InputError, match="15 mm"):
        import_survey(path, MILL, frame="shared")
    assert import_survey(saved(displaced(0.5, runs=True), tmp_path), MILL).survey.frame == "shared"


def test_frames_of_runs_ask_for_runs(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no file has a column of runs"):
        import_survey(saved(displaced(0.0), tmp_path), MILL, frame="per-run")
