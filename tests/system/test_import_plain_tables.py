"""Tables as laboratories keep them: workbooks, rows of units, angles of one axis, ball bars, copies, probing cycles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError, read_machine, read_survey, simulate
from errormodel.chain import Chain
from errormodel.nominal import Nominal
from identification import import_survey
from tests.helpers.importing import MILL, points, poses, spatialanalyzer
from tests.helpers.workbooks import workbook

COMMANDS = poses(seed=8, rows=30)
HEAD = ["Pose", "Zeit", "X Soll", "Y Soll", "Z Soll", "X gemessen", "Y gemessen", "Z gemessen"]


@pytest.fixture(scope="module")
def cells() -> list[list[str | float]]:
    """A sheet with names, a row of units, and 30 poses."""
    units = ["", "hh:mm:ss", *["mm"] * 6]
    rows = np.column_stack([COMMANDS, points(COMMANDS)]).tolist()
    return [HEAD, units, *([f"P{k}", f"09:{k:02d}:20", *row] for k, row in enumerate(rows))]


def test_a_cover_sheet_is_passed_over(cells: list[list[str | float]], tmp_path: Path) -> None:
    cover: list[list[str | float]] = [["Machine", 7.0], ["Datum", 3.0], ["Temperature", 20.5], ["Feed", 2000.0]]
    path = tmp_path / "book.xlsx"
    path.write_bytes(workbook({"Cover": cover, "Data": cells}))
    result = import_survey(path, MILL)
    assert "sheet Data of the spreadsheet; not read: Cover (--sheet)" in result.summary()
    np.testing.assert_allclose(result.survey.commands(["X", "Y", "Z"]), COMMANDS)


def test_the_sheet_that_is_asked_for_is_read(cells: list[list[str | float]], tmp_path: Path) -> None:
    path = tmp_path / "book.xlsx"
    second = [*cells[:2], *cells[12:]]
    path.write_bytes(workbook({"Monday": cells, "Tuesday": second}))
    assert len(import_survey(path, MILL).survey) == 30
    result = import_survey(path, MILL, sheet="Tuesday")
    assert len(result.survey) == 20
    result.save(tmp_path / "s")
    assert len(read_survey(tmp_path / "s", read_machine(MILL))) == 20
    with pytest.raises(InputError, match="none of the files is a workbook with such a sheet"):
        import_survey(path, MILL, sheet="Wednesday")


def angles(path: Path) -> Path:
    """An autocollimator along Y, there and back, as its program prints it."""
    rows = [(y, side, 0.2 + 0.004 * y) for side in ("vor", "rück") for y in (0.0, 50.0, 100.0, 150.0, 200.0)]
    lines = [f"{k};{y:g};{side};{a:.3f}" for k, (y, side, a) in enumerate(rows, start=1)]
    path.write_text("\n".join(["Achse Y, Nickwinkel", 'Lfd;Position;Richtung;Winkel["]', *lines]), encoding="cp1252")
    return path


def test_angles_along_an_axis(tmp_path: Path) -> None:
    path = angles(tmp_path / "ac.csv")
    with pytest.raises(InputError) as error:
        import_survey(path, MILL, joint="Y", columns={"ea": "Winkel"})
    assert "--units ea=.." in error.value.cure
    assert "arcsec" in error.value.cure
    table = import_survey(path, MILL, joint="Y", columns={"ea": "Winkel"}, units={"ea": "arcsec"}).survey.table
    assert [*table["joint"].unique()] == ["Y"]
    np.testing.assert_allclose(table["ea"], np.radians((0.2 + 0.004 * table["Y"]) / 3600), atol=3e-9)
    assert [*table["dir_Y"]] == [1.0] * 5 + [-1.0] * 5


def test_error_motions_need_the_position_of_their_joint(tmp_path: Path) -> None:
    path = tmp_path / "ac.csv"
    path.write_text(angles(path).read_text(encoding="cp1252").replace("Position", "Spalte"), encoding="cp1252")
    with pytest.raises(InputError, match="no column of its position"):
        import_survey(path, MILL, joint="Y", columns={"ea": "Winkel"}, units={"ea": "arcsec"})


def bars(folder: Path, lengths: np.ndarray | None = None) -> Path:
    """A ball bar between the first 15 poses and the others: calibrated, and as the machine measured it."""
    first, second = COMMANDS.to_numpy()[:15], COMMANDS.to_numpy()[15:]
    off = points(COMMANDS, noise=0.0)
    measured = np.linalg.norm(first - second, axis=1)
    true = np.linalg.norm(off[:15] - off[15:], axis=1)
    names = [f"Ball {k} {a}" for k in (1, 2) for a in "XYZ"]
    table = pd.DataFrame(np.column_stack([first, second]), columns=names).assign(measured=measured.round(4))
    table = table.rename(columns={"measured": "L measured"}).assign(**{"L calibrated": true.round(4)})
    if lengths is not None:
        table = table.rename(columns={"L calibrated": "other"})
    table.to_csv(folder / "bars.csv", index_label="No")
    return folder / "bars.csv"


def test_both_balls_of_a_bar_and_its_calibrated_length_are_found(tmp_path: Path) -> None:
    result = import_survey(bars(tmp_path), MILL, observation="pose-distance, offset: 0")
    table = result.survey.table
    np.testing.assert_allclose(table[["from_X", "from_Y", "from_Z"]], COMMANDS[:15])
    np.testing.assert_allclose(table[["X", "Y", "Z"]], COMMANDS[15:])
    assert "length = L calibrated" in result.summary()
    assert not any("computed" in note for note in result.notes)


def test_lengths_that_were_computed_from_the_commands_are_said(tmp_path: Path) -> None:
    columns = {"length": "L measured"}
    result = import_survey(bars(tmp_path), MILL, observation="pose-distance, offset: 0", columns=columns)
    assert any("seem to be computed from the commanded positions" in note for note in result.notes)


def test_a_copy_is_left_out_by_its_row(tmp_path: Path) -> None:
    seen = points(COMMANDS)
    names = [f"P{k}" for k in range(1, 31)]
    copied = np.vstack([seen[:12], seen[11:]])
    (tmp_path / "t.txt").write_text(spatialanalyzer(copied, [*names[:12], "P12", *names[12:]]))
    COMMANDS.assign(point=names).to_csv(tmp_path / "plan.csv", index=False)
    with pytest.raises(InputError, match=r"copies, or an instrument that had stopped \(row 13\)") as error:
        import_survey(tmp_path / "t.txt", MILL, commands=tmp_path / "plan.csv")
    assert "--leave-out" in error.value.cure
    result = import_survey(tmp_path / "t.txt", MILL, commands=tmp_path / "plan.csv", leave_out=["13"])
    assert "rows 13 left out, as asked" in result.summary()
    assert len(result.survey) == 30
    result.save(tmp_path / "s")
    assert len(read_survey(tmp_path / "s", read_machine(MILL))) == 30


@pytest.mark.parametrize("said", ["0", "5-3", "x", "40", "other.txt:3"])
def test_rows_to_leave_out_are_rows(said: str, tmp_path: Path) -> None:
    (tmp_path / "t.txt").write_text(spatialanalyzer(points(COMMANDS)))
    COMMANDS.to_csv(tmp_path / "plan.csv", index=False)
    with pytest.raises(InputError, match="--leave-out"):
        import_survey(tmp_path / "t.txt", MILL, commands=tmp_path / "plan.csv", leave_out=[said])


def test_positions_of_axes_are_no_measured_points(tmp_path: Path) -> None:
    """A cycle prints where the axes stood when the probe had found the ball: that is no place of the ball."""
    machine = read_machine("trunnion_five_axis")
    turns = pd.DataFrame([(a, c) for a in (-60.0, -30.0, 0.0) for c in range(0, 360, 45)], columns=["A", "C"])
    commands = turns.assign(X=0.0, Y=0.0, Z=0.0)
    nominal = Nominal(Chain(machine), commands)
    turn, origin = nominal.flanges()
    ball = np.array([110.0, 25.0, 80.0])
    tool = np.asarray(machine.tool)
    miss = np.einsum("nji,nj->ni", turn, ball - origin) - tool  # in the axes of the tool, which are X, Y, Z here
    commands[["X", "Y", "Z"]] = miss
    seen = simulate("trunnion_five_axis", commands, {"trunnion.dy": 0.03}, noise=0.001)[["mx", "my", "mz"]].to_numpy()
    found = commands[["X", "Y", "Z"]].to_numpy() + 0.02 * (seen - seen.mean(axis=0))
    both = commands.assign(**{f"{a} Ist": found[:, k] for k, a in enumerate("XYZ")})
    both = both.rename(columns={a: f"{a} Soll" for a in "XYZ"})
    both.to_csv(tmp_path / "probe.csv", index=False)
    with pytest.raises(InputError, match="positions of the axes, as a probing cycle prints them"):
        import_survey(tmp_path / "probe.csv", "trunnion_five_axis")


def test_a_log_on_another_clock_says_what_to_add(tmp_path: Path) -> None:
    seen = pd.DataFrame(points(COMMANDS), columns=["mx", "my", "mz"]).assign(time=np.arange(30) * 20.0)
    pd.concat([COMMANDS, seen], axis=1).to_csv(tmp_path / "t.csv", index=False)
    when = pd.date_range("2026-07-03 12:57:32", periods=30, freq="30s")
    pd.DataFrame({"Zeit": when.strftime("%Y-%m-%d %H:%M:%S"), "T_bed": 20.0 + np.arange(30) / 100}).to_csv(
        tmp_path / "log.csv", index=False
    )
    with pytest.raises(InputError) as error:
        import_survey([tmp_path / "t.csv", tmp_path / "log.csv"], MILL)
    assert "-1783083452 lays its first row on the first measurement" in error.value.cure
    result = import_survey([tmp_path / "t.csv", tmp_path / "log.csv"], MILL, log_offset=-1783083452.0)
    np.testing.assert_allclose(result.survey.table["T_bed"], 20.0 + np.arange(30) * 20 / 30 / 100, atol=1e-9)
