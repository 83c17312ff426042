"""A slip in a cell of a survey's own table is to be corrected there: it makes no file of another format of it."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from errormodel.exceptions import InputError
from errormodel.survey import read_survey
from identification import check
from tests.helpers.survey_files import MACHINE, poses

JOINT, POINT = "Y", "my"


def written(folder: Path, column: str, rows: list[int], text: str) -> Path:
    table = poses(40).round(4).astype(object)
    table.loc[rows, column] = text
    table.to_csv(folder / "s.csv", index=False)
    return folder / "s.csv"


@pytest.mark.parametrize(
    ("column", "rows", "text", "said", "cure"),
    [
        (POINT, [7], "-2O1.5", "row 8 (line 9), column my: '-2O1.5' is not a number.", "or leave the cell empty"),
        (JOINT, [7], "1O0", "row 8 (line 9), column Y: '1O0' is not a number.", "or leave the row out"),
        (JOINT, [7], "", "row 8 (line 9), column Y: no commanded position.", "of Y in every row, or leave the row out"),
        (JOINT, [7, 9, 11], "", "row 8 (line 9), column Y: no commanded position (as in 2 more rows).", "in every row"),
    ],
)
def test_a_slip_is_named_and_no_import_advised(
    tmp_path: Path, column: str, rows: list[int], text: str, said: str, cure: str
) -> None:
    with pytest.raises(InputError) as refused:
        check(MACHINE, written(tmp_path, column, rows, text))
    assert said in str(refused.value)
    assert cure in str(refused.value)
    assert "errormodel import" not in str(refused.value)


def test_a_table_that_an_import_would_read_keeps_its_own_cure(tmp_path: Path) -> None:
    """Commas for decimal points in quotes, in all rows; its commands are in it, so that none are asked for."""
    table = poses(40).round(4)
    table.map(lambda x: str(x).replace(".", ",")).to_csv(tmp_path / "s.csv", index=False)
    with pytest.raises(
        InputError, match=r"write a number, .*; or take it in with: errormodel import s\.csv"
    ) as refused:
        check(MACHINE, tmp_path / "s.csv")
    assert "--commands" not in str(refused.value)


def test_empty_lines_between_rows_are_said(tmp_path: Path) -> None:
    table = poses(40)
    table.loc[[3, 20]] = float("nan")
    pd.concat([table, table.loc[[3, 3]]]).to_csv(tmp_path / "s.csv", index=False)  # spreadsheets add some at the end
    survey = read_survey(tmp_path / "s.csv", MACHINE)
    assert len(survey.table) == 38
    assert [n for n in survey.notes if "nothing in" in n] == ["s.csv: nothing in 2 rows (4, 21): left out"]
