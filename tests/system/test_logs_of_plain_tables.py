"""Logs of a survey.yaml are joined to a survey's own tables as to raw files, and nothing of the file is passed over."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.exceptions import InputError
from errormodel.survey import read_survey
from errormodel.survey_rows import open_rows
from tests.helpers.survey_files import MACHINE, poses, write, yaml

LOG = "logs: [{path: log.csv, format: temperature-log}]"
ROWS = 40


def survey(folder: Path, extra: str = LOG, **columns: float) -> Path:
    """A table with times 60 s apart, and a log of 20 degC and 1 degC more in 1000 s."""
    poses(ROWS).assign(time=60.0 * np.arange(ROWS), **columns).to_csv(folder / "s.csv", index=False)
    clock = np.arange(0.0, 3001.0, 100.0)
    pd.DataFrame({"time": clock, "T_bed": 20.0 + clock / 1000}).to_csv(folder / "log.csv", index=False)
    return yaml(folder, extra)


@pytest.mark.parametrize("form", ["", ", format: delimited-table"])
def test_a_log_is_joined_to_a_table_with_and_without_format(tmp_path: Path, form: str) -> None:
    survey(tmp_path)
    table = read_survey(yaml(tmp_path, LOG, f"[{{path: s.csv{form}}}]"), MACHINE).table
    np.testing.assert_allclose(table["T_bed"], 20.0 + 60.0 * np.arange(ROWS) / 1000, atol=1e-9)


def test_times_as_dates_and_in_minutes_are_those_of_the_log(tmp_path: Path) -> None:
    path = survey(tmp_path, f"{LOG}\nunits: {{time: min}}")
    table = pd.read_csv(tmp_path / "s.csv").assign(time=np.arange(ROWS))
    table.to_csv(tmp_path / "s.csv", index=False)
    assert read_survey(path, MACHINE).table["T_bed"].iloc[-1] == pytest.approx(20.0 + 0.06 * (ROWS - 1))
    dates = pd.Timestamp("2026-03-02T08:00:00") + pd.to_timedelta(60 * np.arange(ROWS), unit="s")
    table.assign(time=dates.strftime("%Y-%m-%dT%H:%M:%S")).to_csv(tmp_path / "s.csv", index=False)
    with pytest.raises(InputError, match=r"s\.csv has dates, log\.csv seconds.*offset:"):
        read_survey(path, MACHINE)


def test_a_log_that_is_not_there_or_cannot_be_joined_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nosuchfile\.csv: no such file"):
        read_survey(survey(tmp_path, "logs: [{path: nosuchfile.csv, format: temperature-log}]"), MACHINE)
    path = survey(tmp_path)
    pd.read_csv(tmp_path / "s.csv").drop(columns="time").to_csv(tmp_path / "s.csv", index=False)
    with pytest.raises(InputError, match=r"s\.csv: no time, by which a log is joined"):
        read_survey(path, MACHINE)


def test_rows_read_in_ranges_have_no_logs(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"line 3, key logs: .*[Ll]eave out --stream"):
        open_rows(survey(tmp_path), MACHINE)


def test_a_column_that_the_log_has_too_is_said(tmp_path: Path) -> None:
    read = read_survey(survey(tmp_path, T_bed=25.0), MACHINE)
    assert read.table["T_bed"].max() < 23
    assert any("T_bed: as log.csv has it, in place of the file's own column" in note for note in read.notes)


def test_temperatures_of_a_log_are_checked(tmp_path: Path) -> None:
    path = survey(tmp_path)
    write(tmp_path, "time,T_bed\n0,20\n1000,-400\n1200,20\n3000,20\n", "log.csv")
    read = read_survey(path, MACHINE)
    assert any("absolute zero, in T_bed" in note for note in read.notes)
    assert read.table["T_bed"].min() > -273.16


@pytest.mark.parametrize(("key", "value"), [("units", "{length: m}"), ("columns", "{mx: East}")])
def test_settings_that_no_file_reads_are_refused(tmp_path: Path, key: str, value: str) -> None:
    """Columns and units of the whole survey are those of files without format."""
    survey(tmp_path)
    path = yaml(tmp_path, f"{key}: {value}", "[{path: s.csv, format: delimited-table}]")
    with pytest.raises(InputError, match=rf"line 3, key {key}: which no file reads: .*beside path:"):
        read_survey(path, MACHINE)
