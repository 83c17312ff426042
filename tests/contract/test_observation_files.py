"""Mistakes in the entries and rows of single readings: one message with file, row or key, and what to write."""

from __future__ import annotations

from pathlib import Path

import pytest

from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from errormodel.survey import read_survey

ROWS = "X,Y,Z,observation,length\n0,0,300,A,500\n10,0,300,A,501\n"
DISTANCE = "{A: {type: station-distance}}"
MISTAKES = {
    "no entry at all": (ROWS, "{}", "column observation: 'A', no entry. Write observations: {A: {type: ...}}"),
    "another entry": (ROWS, "{B: {type: station-distance}}", "'A', no entry. Valid: B"),
    "an entry without rows": (ROWS, "{A: {type: station-distance}, B: {type: station-distance}}", "'B'"),
    "unknown type": (ROWS, "{A: {type: station-distanc}}", "Did you mean 'station-distance'"),
    "two coordinates": (ROWS, "{A: {type: station-distance, station: [1, 2]}}", "key observations.A.station: [1, 2]"),
    "a word for a number": (
        ROWS,
        "{A: {type: station-distance, dead_path: some}}",
        "Write dead_path: the length in mm",
    ),
    "one pose of two": (ROWS, "{A: {type: pose-distance}}", "there is no column from_X"),
    "an angle for a length": (ROWS.replace("length", "angle"), DISTANCE, "Write what was read in the column length"),
    "a reading of nothing": (ROWS.replace("A,501", ",501"), DISTANCE, "row 2: a reading in column length"),
    "no column of names": ("X,Y,Z,length\n0,0,300,500\n", "{}", "Name its entry of observations:"),
    "a direction along": (
        ROWS,
        "{A: {type: line-straightness, along: [1, 0, 0], across: [1, 0.1, 0]}}",
        "Write across: a direction across the line",
    ),
    "no direction": (ROWS, "{A: {type: line-angle, axis: [0, 0, 0]}}", "Write a direction, such as [0, 0, 1]"),
    "no length of the bar": (ROWS, "{A: {type: ballbar-circle}}", "the key 'calibrated' is missing"),
    "no uncertainty": (ROWS, "{A: {type: station-distance, sigma: [0, 0]}}", "a standard uncertainty above 0"),
    "a negative uncertainty": (
        "X,Y,Z,observation,length,u_length\n0,0,300,A,500,-1\n",
        DISTANCE,
        "column u_length: -1 as a standard uncertainty",
    ),
    "a gap in the first pose": (
        "X,Y,Z,observation,length,from_X,from_Y,from_Z\n0,0,300,A,500,1,2,\n",
        "{A: {type: pose-distance}}",
        "row 1, column from_Z: no commanded position",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_is_named_with_what_to_write(name: str, tmp_path: Path) -> None:
    rows, entries, message = MISTAKES[name]
    (tmp_path / "a.csv").write_text(rows)
    (tmp_path / "s.yaml").write_text(f"errormodel: 1\nfiles: [{{path: a.csv}}]\nobservations: {entries}\n")
    with pytest.raises(InputError) as error:
        read_survey(tmp_path / "s.yaml", read_machine("vertical_three_axis"))
    assert message in str(error.value)


def test_units_of_lengths_and_angles(tmp_path: Path) -> None:
    """Lengths follow the unit of lengths, and their uncertainties theirs; angles are rad unless their column says."""
    (tmp_path / "a.csv").write_text(
        "X,Y,Z,observation,length,u_length,angle\n0,0,0.3,A,0.5,1e-6,\n0.01,0,0.3,A,0.501,1e-6,\n0,0,0.3,L,,,12\n"
    )
    (tmp_path / "s.yaml").write_text(
        "errormodel: 1\nfiles: [{path: a.csv}]\nunits: {length: m}\n"
        "observations: {A: {type: station-distance}, L: {type: precision-level, axis: [1, 0, 0]}}\n"
    )
    table = read_survey(tmp_path / "s.yaml", read_machine("vertical_three_axis")).table
    assert table["length"].tolist()[:2] == [500.0, 501.0]
    assert table["u_length"].tolist()[:2] == [1e-3, 1e-3]
    assert table["angle"].tolist()[2] == 12.0
