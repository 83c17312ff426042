"""Cells that stand for no value are read as empty and said; what lies among the others stays a measurement."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from errormodel.exceptions import InputError
from errormodel.formats.base import NO_VALUE_WORDS
from errormodel.machine_file import read_machine
from errormodel.survey import Survey, read_survey
from errormodel.surveys.missing_values import PLACEHOLDER_NINES, without_nines, zeros
from tests.helpers.commands import MILL, XYZ, done, run, write

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
@pytest.mark.parametrize("word", sorted(NO_VALUE_WORDS - {""}))
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


@pytest.mark.long
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
    value=st.sampled_from([*PLACEHOLDER_NINES, *-PLACEHOLDER_NINES]),
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


def warm(table: pd.DataFrame, rate: float = 0.05) -> pd.DataFrame:
    """The survey with a clock and a sensor that warms by `rate` K a row."""
    n = np.arange(len(table))
    return table.assign(time=45.0 * n, T_x=20 + rate * n + 0.01 * (n % 2), feed=1000.0, load=0.0, w_a=0.1 * n)


@pytest.mark.parametrize("value", [-9999, 9999, -999.9, -99999])
@pytest.mark.parametrize("name", ["T_x", "load", "w_a"])
def test_one_placeholder_in_a_recorded_column(name: str, value: float, table: pd.DataFrame, tmp_path: Path) -> None:
    spoilt = warm(table).astype({name: float})
    spoilt.loc[7, name] = value
    survey = read(spoilt, tmp_path)
    assert any(f"s.csv: {value:.10g} in {name} of row 8 read as not measured" in note for note in survey.notes)
    assert abs(survey.table[name][7]) < 30 or np.isnan(survey.table[name][7])


def test_a_feed_of_nines_is_one_and_a_negative_one_is_none(table: pd.DataFrame, tmp_path: Path) -> None:
    spoilt = warm(table)
    spoilt.loc[[7, 8], "feed"] = [9999, -9999]
    survey = read(spoilt, tmp_path)
    assert survey.table["feed"][7] == 9999
    assert np.flatnonzero(survey.table["feed"].isna()).tolist() == [8]


@pytest.mark.parametrize("value", [-9999, 9999, 99999])
def test_a_placeholder_for_a_time_is_refused(value: float, table: pd.DataFrame, tmp_path: Path) -> None:
    spoilt = warm(table)
    spoilt.loc[7, "time"] = value
    spoilt.to_csv(tmp_path / "s.csv", index=False)
    result = run("fit", MILL, tmp_path / "s.csv", "--out", tmp_path / "out", "--quiet")
    assert result.code == 2
    assert f"row 8 (line 9), column time: {value}, which stands for no time" in result.err


@given(last=st.sampled_from([float(v) for v in PLACEHOLDER_NINES if v > 999]), count=st.integers(10, 40))
def test_a_clock_that_runs_on_to_nines_is_a_clock(last: float, count: int) -> None:
    time = np.append(np.arange(float(count)), last)
    out, notes = without_nines({"time": time}, ["X"], np.arange(1, count + 2))
    np.testing.assert_array_equal(out["time"], time)
    assert not notes


@pytest.mark.parametrize(("unit", "value"), [("degC", -300), ("degC", -1e5), ("K", -1), ("degF", -500)])
def test_less_than_absolute_zero_is_no_temperature(
    unit: str, value: float, table: pd.DataFrame, tmp_path: Path
) -> None:
    """Whatever is written: one cell, among two rows, in every unit; and nothing is made up in a prediction."""
    few = warm(table).head(2).copy()
    few["T_x"] = {"degC": 20.0, "K": 293.15, "degF": 68.0}[unit]
    few.loc[1, "T_x"] = value
    few.to_csv(tmp_path / "s.csv", index=False)
    write(tmp_path / "s.yaml", f"errormodel: 1\nfiles: [{{path: s.csv}}]\nunits: {{temperature: {unit}}}\n")
    survey = read_survey(tmp_path / "s.yaml", read_machine(MILL), measured=False)
    assert survey.table["T_x"][0] == pytest.approx(20.0)
    assert np.isnan(survey.table["T_x"][1])
    assert any("absolute zero, in T_x of row 2 read as not measured" in note for note in survey.notes)


@pytest.mark.parametrize("timed", [True, False])
def test_a_short_gap_of_a_sensor_is_interpolated(timed: bool, table: pd.DataFrame, tmp_path: Path) -> None:
    full = warm(table, 0.1)
    if timed:
        full.loc[20:, "time"] += 20  # the line is one over time, not over rows
    spoilt = full.copy()
    spoilt.loc[[7, 19, 20], "T_x"] = np.nan
    if not timed:
        full, spoilt = full.drop(columns="time"), spoilt.drop(columns="time")
    survey = read(spoilt, tmp_path)
    note = "s.csv: T_x has no value in 3 rows (8, 20, 21): 3 cells interpolated between the readings before and after"
    assert any(note in said for said in survey.notes)
    at = full["time"] if timed else np.arange(len(full))
    known = spoilt["T_x"].notna()
    np.testing.assert_allclose(survey.table["T_x"], np.interp(at, at[known], spoilt["T_x"][known]), atol=1e-9)


@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_a_long_gap_of_a_smooth_sensor_is_interpolated(
    timed: bool, seed: int, table: pd.DataFrame, tmp_path: Path
) -> None:
    """Six minutes of three hours, beside a twin that says what was there: as far off as the note says, or less."""
    rng, n = np.random.default_rng(seed), np.arange(180)
    true = 20 + 3 * np.sin(n / 40 + seed)
    full = pd.concat([table] * 3, ignore_index=True).assign(time=60.0 * n, T_x=true + rng.normal(0, 0.03, len(n)))
    spoilt = full if timed else full.drop(columns="time")
    rows = np.arange(50, 56)
    spoilt = spoilt.assign(T_x=full["T_x"].where(~np.isin(n, rows)))
    survey = read(spoilt, tmp_path)
    (note,) = (said for said in survey.notes if "T_x" in said)
    assert ("420 s apart" if timed else "7 rows apart") in note
    assert "6 rows (51, 52, 53, 54, 55, 56): 6 cells interpolated" in note
    stated = float(note.split(" K (rms)")[0].split()[-1])
    off = survey.table["T_x"].to_numpy()[rows] - true[rows]
    assert np.sqrt(np.mean(off**2)) < 1.5 * stated  # stated of one reading, with noise; two of them make the line
    assert stated < 0.1 * true.std()


def test_noise_does_not_make_a_long_gap_unknown(table: pd.DataFrame, tmp_path: Path) -> None:
    """A coarse sensor is off lines by its noise, as it is off its neighbours: the course is known all the same."""
    spoilt = warm(table)
    spoilt["T_x"] += np.random.default_rng(3).normal(0, 0.15, len(table))
    spoilt.loc[30:33, "T_x"] = np.nan
    assert read(spoilt, tmp_path).table["T_x"].notna().all()


def with_load(table: pd.DataFrame) -> pd.DataFrame:
    """First without a load, then with 20 kg."""
    load = np.where(np.arange(len(table)) < 30, 0.0, 20.0)
    return table.assign(load=load, run=np.where(load > 0, "loaded", "empty"), time=60.0 * np.arange(len(table)))


@pytest.mark.parametrize("drop", [[], ["time"], ["run"]])
def test_a_load_is_held_over_empty_cells(drop: list[str], table: pd.DataFrame, tmp_path: Path) -> None:
    """They made the whole column drive nothing, and "no load was recorded that changes" was said."""
    full = with_load(table).drop(columns=drop)
    spoilt = full.copy()
    spoilt.loc[[5, 6, 40], "load"] = np.nan
    survey = read(spoilt, tmp_path)
    assert survey.table["load"].tolist() == full["load"].tolist()
    said = " ".join(survey.notes)
    assert "3 rows (6, 7, 41): taken as the 0 and 20 kg before and after" in said or drop == ["time"]
    assert "row 41: taken as the 20 kg" in said or drop != ["time"]


@pytest.mark.parametrize(
    ("rows", "found"),
    [
        ([29], "row 30, column load: no value, between 0 and 20 kg"),
        ([0, 1], "row 1, column load: no value, and none before it"),
        ([59], "row 60, column load: no value, and none after it"),
        (range(5, 15), "row 6, column load: no value, and though it is 0 kg around, 10 of 60 rows have none"),
    ],
)
def test_a_load_that_nothing_tells_is_refused(
    rows: Sequence[int], found: str, table: pd.DataFrame, tmp_path: Path
) -> None:
    spoilt = with_load(table)
    spoilt.loc[[*rows], "load"] = np.nan
    with pytest.raises(InputError, match=re.escape(f"s.csv, {found}")) as raised:
        read(spoilt, tmp_path)
    assert "Write the load of every row, 0 where there was none" in raised.value.cure


def test_a_load_that_changes_from_row_to_row_is_not_held(table: pd.DataFrame, tmp_path: Path) -> None:
    spoilt = with_load(table).assign(load=20.0 * (np.arange(len(table)) % 2), run="1")
    spoilt.loc[7, "load"] = np.nan
    with pytest.raises(InputError, match="a load stands for as few as 1"):
        read(spoilt, tmp_path)


def test_a_file_without_loads_beside_one_with_them_is_said(table: pd.DataFrame, tmp_path: Path) -> None:
    with_load(table[::2]).to_csv(tmp_path / "one.csv", index=False)
    table[1::2].to_csv(tmp_path / "two.csv", index=False)
    source = write(tmp_path / "s.yaml", "errormodel: 1\nfiles: [{path: one.csv}, {path: two.csv}]\nframe: shared\n")
    said = done("check", MILL, source).out
    assert "load: no value in 30 of 60 rows. Write it in every row; `diagnose` lets it drive nothing" in said


def _many(t: pd.DataFrame) -> None:
    t.loc[::8, "T_x"] = np.nan


def _long(t: pd.DataFrame) -> None:
    t["T_x"] = 20 + np.cumsum(np.random.default_rng(0).normal(0, 0.1, len(t)))  # a course that no line follows
    t.loc[10:13, "T_x"] = np.nan


def _third(t: pd.DataFrame) -> None:
    t.loc[20:39, "T_x"] = np.nan


def _end(t: pd.DataFrame) -> None:
    t.loc[len(t) - 1, "T_x"] = np.nan


def _pause(t: pd.DataFrame) -> None:
    t.loc[20:, "time"] += 7200
    t.loc[20, "T_x"] = np.nan


def _step(t: pd.DataFrame) -> None:
    t.loc[20:, "T_x"] += 8
    t.loc[20, "T_x"] = np.nan


def _states(t: pd.DataFrame) -> None:
    t["T_x"] = np.random.default_rng(0).uniform(20, 30, len(t))
    t.loc[20, "T_x"] = np.nan


def _runs(t: pd.DataFrame) -> None:
    t["run"] = np.where(t.index < 20, 1, 2)
    t.loc[20:, "time"] -= t["time"][20]
    t.loc[20, "T_x"] = np.nan


@pytest.mark.parametrize("spoil", [_many, _long, _third, _end, _pause, _step, _states, _runs])
def test_a_gap_that_neighbours_do_not_show_stays_one(spoil: object, table: pd.DataFrame, tmp_path: Path) -> None:
    assert callable(spoil)
    spoilt = warm(table)
    spoil(spoilt)
    survey = read(spoilt, tmp_path)
    np.testing.assert_array_equal(survey.table["T_x"], spoilt["T_x"])
    assert not any("interpolated" in note for note in survey.notes)


@pytest.mark.long
@pytest.mark.parametrize("share", [0.02, 0.3])
def test_diagnose_with_gaps_of_a_sensor(share: float, tmp_path: Path) -> None:
    """Few gaps leave the sensor a cause; with many it is none, and what cannot be seen says why."""
    machine = write(
        tmp_path / "m.yaml",
        "errormodel: 1\nchain:\n  - {joint: X, type: prismatic, axis: x, travel: [0, 800]}\n"
        "  - {joint: Y, type: prismatic, axis: y, travel: [0, 500]}\n"
        "  - {joint: Z, type: prismatic, axis: z, travel: [0, 400]}\n",
    )
    rng, n = np.random.default_rng(1), np.arange(160)
    poses = pd.DataFrame({j: rng.uniform(0, most, 160) for j, most in zip("XYZ", (800, 500, 400), strict=True)})
    warmth = 20 + 3 * np.sin(n / 25)
    points = poses.to_numpy() + rng.normal(0, 0.002, (160, 3))
    points[:, 0] += 11e-6 * (warmth - 20) * poses["X"]
    spoilt = poses.assign(time=45.0 * n, T_x=np.round(warmth, 2), **dict(zip(XYZ, points.T, strict=True)))
    gaps = 3 + np.flatnonzero(np.arange(150) % round(1 / share) == 0)
    spoilt.loc[gaps, "T_x"] = np.nan
    spoilt.to_csv(tmp_path / "s.csv", index=False)
    result = done("diagnose", machine, tmp_path / "s.csv", "--out", tmp_path / "out")
    assert ("Scale-expansion of X, driven by T_x" in result.out) == (share < 0.1)
    assert "no temperature was recorded" not in result.out
    assert (f"T_x cannot be used: no value in {len(gaps)} of 160 rows" in result.out) == (share > 0.1)
    said = f"T_x cannot be used (no value in {len(gaps)} of 160 rows): it was not considered, and may be the cause."
    assert (said in result.out) == (share > 0.1)
