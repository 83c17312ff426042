"""Readings that failed: signs and words are not measured, other text is refused, rows left out are not judged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from errormodel import InputError, read_machine, read_survey
from identification import import_survey
from tests.helpers.importing import MILL, points, poses

COMMANDS = poses(seed=8, rows=20)
PLACES = points(COMMANDS)


def files(folder: Path, row: str, at: int = 8, scale: float = 1.0, unit: str = "mm") -> tuple[Path, Path]:
    """A tracker's file whose row `at` (from 1) is `row`, and the commands."""
    rows = [f"P{k + 1};{x:.7f};{y:.7f};{z:.7f}" for k, (x, y, z) in enumerate(PLACES * scale)]
    rows[at - 1] = row
    (folder / "t.csv").write_text("\n".join([f"Point ID;X [{unit}];Y [{unit}];Z [{unit}]", *rows]) + "\n")
    COMMANDS.assign(point=[f"P{k + 1}" for k in range(20)]).to_csv(folder / "plan.csv", index=False)
    return folder / "t.csv", folder / "plan.csv"


@pytest.mark.parametrize("at", [1, 8, 20])
@pytest.mark.parametrize("columns", [{}, {"mx": "X", "my": "Y", "mz": "Z"}])
def test_signs_and_words_are_not_measured_and_said(at: int, columns: dict[str, str], tmp_path: Path) -> None:
    raw, plan = files(tmp_path, f"P{at};#####;?;No signal" if at < 20 else "P20;***;1.5;laser off", at)
    result = import_survey(raw, MILL, commands=plan, columns=columns)
    words = "#####, ?, No signal" if at < 20 else "***, laser off"
    assert f"no value where it says {words}: row {at}" in result.summary()
    assert {"mx", "my", "mz"} <= {*result.survey.table}
    assert np.isfinite(result.survey.table[["mx", "my", "mz"]].to_numpy()).all(axis=1).sum() == 19


@pytest.mark.parametrize("cell", ["1O.5", "12.3mm", "kaputt", "1.5#", "?1.5", "12:30", "# 1"])
@pytest.mark.parametrize("columns", [{}, {"mx": "X", "my": "-Y", "mz": "Z"}])
def test_other_text_is_refused_with_its_row(cell: str, columns: dict[str, str], tmp_path: Path) -> None:
    raw, plan = files(tmp_path, f"P8;1.5;{cell};lost")
    with pytest.raises(InputError, match=r"t\.csv, row 8 \(line 9\), column Y") as error:
        import_survey(raw, MILL, commands=plan, columns=columns)
    assert f"'{cell}'" in error.value.found
    assert "as it was written" not in error.value.cure


def test_a_row_left_out_is_not_judged_and_others_are(tmp_path: Path) -> None:
    """In inches: a column of text would be read without its unit."""
    raw, plan = files(tmp_path, "P8;kaputt;12.3 mm;1O.5", scale=1 / 25.4, unit="inch")
    with pytest.raises(InputError, match="row 8"):
        import_survey(raw, MILL, commands=plan, leave_out=["7"])
    result = import_survey(raw, MILL, commands=plan, leave_out=["8"])
    result.save(tmp_path / "s")
    survey = read_survey(tmp_path / "s", read_machine(MILL))
    np.testing.assert_allclose(survey.table[["mx", "my", "mz"]], np.delete(PLACES, 7, axis=0), atol=1e-5)


def test_a_text_in_the_commands_is_refused_with_its_row(tmp_path: Path) -> None:
    raw, plan = files(tmp_path, "P8;;;")
    lines = plan.read_text().splitlines()
    lines[5] = "kaputt," + lines[5].split(",", 1)[1]
    plan.write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"plan\.csv, row 5 \(line 6\), column X: 'kaputt'") as error:
        import_survey(raw, MILL, commands=plan)
    assert "--leave-out" not in error.value.cure


@pytest.mark.parametrize("name", ["mz", "T_air", "load", "time", "sigma"])
def test_a_column_that_is_empty_in_all_rows_holds_nothing(name: str, tmp_path: Path) -> None:
    raw, plan = files(tmp_path, "P8;lost;lost;lost")
    lines = raw.read_text().splitlines()
    if name == "mz":
        lines = [line.rsplit(";", 1)[0] for line in lines]
    raw.write_text("\n".join([f"{lines[0]};{name}", *(f"{line};" for line in lines[1:])]))
    given = {"mx": "X", "my": "Y"}
    result = import_survey(raw, MILL, commands=plan, columns=given if name == "mz" else {})
    assert len(result.survey) == 19
