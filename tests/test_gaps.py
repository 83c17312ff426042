"""Cells that stand for no value are read as empty and said; what lies among the others stays a measurement."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from errormodel.formats.base import NOTHING
from errormodel.machine_file import read_machine
from errormodel.survey import Survey, read_survey
from errormodel.survey_missing_values import NINES, without_nines, zeros
from tests.commands import MILL, XYZ, done, run, write

AWAY = "errormodel: 1\nparameters: {}\nframe: {translation: [2500, -1800, 400], rotation: [2, -3, 40]}\n"


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    """A survey by a tracker that stands away from the machine."""
    folder = tmp_path_factory.mktemp("gaps")
    write(folder / "t.yaml", AWAY.partition("\n")[2])
    done("simulate", MILL, 60, "--noise", 0.002, "--parameters", folder / "t.yaml", "--out", folder / "s.csv")
    return pd.read_csv(folder / "s.csv")


def read(table: pd.DataFrame, folder: Path, name: str = "s.csv") -> Survey:
    path = folder / name
    if path.suffix == ".parquet":
        table.to_parquet(path)
    else:
        table.to_csv(path, index=False, sep=";" if name.startswith("semi") else ",")
    return read_survey(path, read_machine(MILL))


@pytest.mark.parametrize("name", ["s.csv", "semi.csv", "s.parquet"])
@pytest.mark.parametrize("word", sorted(NOTHING - {""}))
def test_a_word_for_no_value(word: str, name: str, table: pd.DataFrame, tmp_path: Path) -> None:
    column = table["mx"].astype(str)
    column[[4, 50]] = word.upper()
    survey = read(table.assign(mx=column), tmp_path, name)
    assert np.flatnonzero(survey.table["mx"].isna()).tolist() == [4, 50]
    (note,) = (n for n in survey.notes if "no value" in n)
    assert note.endswith(f"'{word.upper()}' in column mx of 2 rows (5, 51) read as no value")


def test_several_words_are_one_note_a_column(table: pd.DataFrame, tmp_path: Path) -> None:
    table = table.astype(object)
    table.loc[[1, 2], "my"] = ["---", "n/a"]
    survey = read(table, tmp_path)
    assert "s.csv: '---' and 'n/a' in column my of 2 rows (2, 3) read as no value" in str(survey.notes)


def test_empty_cells_are_no_note(table: pd.DataFrame, tmp_path: Path) -> None:
    table = table.copy()
    table.loc[[1, 2], "my"] = np.nan
    assert not read(table, tmp_path).notes


@pytest.mark.parametrize("value", [-9999, 9999, -999.9, -99999, 9999.99, -9999999])
def test_a_placeholder_is_not_measured(value: float, table: pd.DataFrame, tmp_path: Path) -> None:
    rows = [4, 30, 50]
    spoilt = table.copy()
    spoilt.loc[rows, XYZ] = value
    spoilt.to_csv(tmp_path / "s.csv", index=False)
    empty = table.copy()
    empty.loc[rows, XYZ] = np.nan
    empty.to_csv(tmp_path / "e.csv", index=False)
    result = done("fit", MILL, tmp_path / "s.csv", "--out", tmp_path / "s")
    done("fit", MILL, tmp_path / "e.csv", "--out", tmp_path / "e")
    assert f"{value:.10g} in mx my mz of 3 rows (5, 31, 51) read as not measured" in result.err
    assert (tmp_path / "s" / "parameters.csv").read_bytes() == (tmp_path / "e" / "parameters.csv").read_bytes()


def test_a_placeholder_in_one_component_and_one_row(table: pd.DataFrame, tmp_path: Path) -> None:
    spoilt = table.copy()
    spoilt.loc[[4, 9], "mz"] = -9999
    spoilt.loc[20, XYZ] = -9999
    survey = read(spoilt, tmp_path)
    assert np.flatnonzero(survey.table["mz"].isna()).tolist() == [4, 9, 20]
    assert np.flatnonzero(survey.table["mx"].isna()).tolist() == [20]


@pytest.mark.parametrize("rows", [[4], [4, 9, 20]])
def test_a_target_that_was_not_seen(rows: list[int], table: pd.DataFrame, tmp_path: Path) -> None:
    spoilt = table.copy()
    spoilt.loc[rows, XYZ] = 0.0
    survey = read(spoilt, tmp_path)
    assert np.flatnonzero(survey.table["mx"].isna()).tolist() == rows
    assert any("0 in mx my mz of" in note for note in survey.notes)


def test_a_machine_that_measures_its_own_origin(tmp_path: Path) -> None:
    """Without noise and in the machine's own frame, 0, 0, 0 and 999 are measurements like any other."""
    points = pd.DataFrame([(x, y, z) for x in (0, 500, 999) for y in (0, 400) for z in (0, -200)], columns=[*"XYZ"])
    write(
        tmp_path / "m.yaml",
        "errormodel: 1\nchain:\n  - {joint: X, type: prismatic, axis: x, travel: [0, 1000]}\n"
        "  - {joint: Y, type: prismatic, axis: y, travel: [0, 500]}\n"
        "  - {joint: Z, type: prismatic, axis: z, travel: [-400, 0]}\n",
    )
    points.to_csv(tmp_path / "p.csv", index=False)
    done("simulate", tmp_path / "m.yaml", tmp_path / "p.csv", "--out", tmp_path / "s.csv")
    survey = read_survey(tmp_path / "s.csv", read_machine(tmp_path / "m.yaml"))
    np.testing.assert_array_equal(survey.measured, points.to_numpy(dtype=float))
    assert not survey.notes


@given(
    value=st.sampled_from([*NINES, *-NINES]),
    low=st.floats(-2e4, 2e4),
    size=st.floats(1.0, 1e4),
    seed=st.integers(0, 99),
)
def test_a_number_in_the_range_of_the_others_is_one(value: float, low: float, size: float, seed: int) -> None:
    """Repeated or not: of what lies among the others nothing is lost, of what was not a placeholder never."""
    rng = np.random.default_rng(seed)
    column = rng.uniform(low, low + size, 40)
    column[[3, 17]] = value
    others = np.delete(column, [3, 17])
    out, notes = without_nines({"mx": column}, ["X"], np.arange(1, 41))
    kept = np.delete(out["mx"], [3, 17])
    np.testing.assert_array_equal(kept, others)
    inside = others.min() <= value <= others.max()
    far = np.abs(others - value).min() > np.ptp(others)
    assert bool(np.isnan(out["mx"][3])) == bool(notes) == bool(far)
    assert not (inside and notes)


@given(away=st.floats(0.0, 1e4), size=st.floats(0.01, 2e3), seed=st.integers(0, 99))
def test_zero_is_a_place_where_others_are_near(away: float, size: float, seed: int) -> None:
    points = np.random.default_rng(seed).uniform(-size, size, (30, 3)) + np.array([away, 0.0, 0.0])
    points[5] = 0.0
    frame = pd.DataFrame(points, columns=XYZ).assign(row=np.arange(1, 31), X=np.arange(30.0))
    found = list(zeros(frame, ["X"]))
    others = np.delete(points, 5, axis=0)
    assert bool(found) == bool(np.linalg.norm(others, axis=1).min() > np.linalg.norm(np.ptp(others, axis=0)))


def test_a_command_that_is_a_placeholder_is_still_missing(table: pd.DataFrame, tmp_path: Path) -> None:
    spoilt = table.astype(object)
    spoilt.loc[3, "X"] = "---"
    spoilt.to_csv(tmp_path / "s.csv", index=False)
    result = run("fit", MILL, tmp_path / "s.csv", "--out", tmp_path / "out", "--quiet")
    assert result.code == 2
    assert "row 4 (line 5), column X: no commanded position" in result.err
