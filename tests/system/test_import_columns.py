"""Columns and units that the user names where a file does not, for readings that are no points; what a bar is long."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError, read_machine, read_survey
from identification import import_survey
from identification.importing.text import import_lines
from tests.helpers.circles import RADIUS, circles, trace
from tests.helpers.commands import run
from tests.helpers.importing import points, poses

MILL = "vertical_three_axis"
MACHINE = read_machine(MILL)
CENTRE = {"X": 0.0, "Y": 0.0, "Z": 375.0}
ROWS = [(p, run, side) for run in (1, 2) for side in "+-" for p in (-200.0, 0.0, 150.0, 300.0)]
DEVIATIONS = [round(0.01 * p + run + (side == "-"), 2) for p, run, side in ROWS]  # um


def laser(head: str) -> str:
    rows = zip(ROWS, DEVIATIONS, strict=True)
    return head + "".join(f"{p};{n};{s};{d}\n".replace(".", ",") for (p, n, s), d in rows)


def own(path: Path, **keys: object) -> np.ndarray:
    """Rows of a positioning test of X: position, side and deviation in um."""
    table = import_survey(path, MILL, joint="X", **keys).survey.table  # type: ignore[arg-type]
    return np.column_stack([table["X"], table["dir_X"], 1e3 * table["dx"]])


def test_a_table_of_one_joint_is_read_by_its_own_names_or_those_that_are_said(tmp_path: Path) -> None:
    wanted = [(p, 1.0 if s == "+" else -1.0, d) for (p, _, s), d in zip(ROWS, DEVIATIONS, strict=True)]
    german = tmp_path / "german.csv"
    german.write_text(laser("Position [mm];Lauf;Richtung;Abweichung [µm]\n"))
    np.testing.assert_allclose(own(german), wanted, atol=1e-9)
    other = tmp_path / "other.csv"
    other.write_text(laser("A;B;C;D\n"))
    columns = "target=A,run=B,direction=C,deviation=D"
    np.testing.assert_allclose(own(other, columns=columns, units={"deviation": "um"}), wanted, atol=1e-9)
    with pytest.raises(InputError, match="--units deviation=um"):
        own(other, columns=columns)
    with pytest.raises(InputError, match="the unit 'deg'"):
        own(other, columns=columns, units={"deviation": "deg"})
    with pytest.raises(InputError, match="no column 'E'"):
        own(other, columns="target=A,run=B,direction=C,deviation=E")
    with pytest.raises(InputError, match="a positioning test of one joint by target, actual"):
        own(other)  # says by which words they may be named


def test_the_map_names_them_too_and_a_correction_is_a_line_there(tmp_path: Path) -> None:
    (tmp_path / "raw.csv").write_text(laser("A;B;C;D\n"))
    columns = "target=A,run=B,direction=C,deviation=D"
    import_survey(tmp_path / "raw.csv", MILL, joint="X", columns=columns, units={"deviation": "um"}).save(
        tmp_path / "s"
    )
    again = read_survey(tmp_path / "s", MACHINE).table
    np.testing.assert_allclose(1e3 * again["dx"], DEVIATIONS, atol=1e-9)
    path = tmp_path / "s/survey.yaml"
    path.write_text(path.read_text().replace("deviation: um", "deviation: inch"))
    np.testing.assert_allclose(
        read_survey(tmp_path / "s", MACHINE).table["dx"], 25.4 * np.array(DEVIATIONS), rtol=1e-12
    )


@pytest.fixture
def bar(tmp_path: Path) -> Path:
    table = circles(MACHINE, {}, np.random.default_rng(1), noise=3e-4)
    path = tmp_path / "XY.csv"
    path.write_text(trace(table[table["plane"] == "XY"], "XY"))
    return path


def test_a_trace_without_names_or_units_is_the_same_trace(bar: Path) -> None:
    plain = import_survey(bar, MILL, centre=CENTRE).survey.table
    rows = [line for line in bar.read_text().splitlines() if line[:1].isdigit()]
    said = {"plane": "XY", "radius": RADIUS, "columns": "angle,deviation", "units": {"deviation": "um"}}
    (bar.parent / "bare.csv").write_text("\n".join(rows) + "\n")
    bare = import_survey(bar.parent / "bare.csv", MILL, centre=CENTRE, **said).survey.table  # type: ignore[arg-type]
    np.testing.assert_array_equal(bare[["X", "Y", "length"]], plain[["X", "Y", "length"]])
    (bar.parent / "german.csv").write_text(
        f"Ebene: XY\nNennradius: {RADIUS} mm\nWinkel [Grad];Abweichung [µm]\n"
        + "\n".join(row.replace(",", ";").replace(".", ",") for row in rows)
    )
    german = import_survey(bar.parent / "german.csv", MILL, centre=CENTRE).survey.table
    np.testing.assert_allclose(german[["X", "Y", "length"]], plain[["X", "Y", "length"]], atol=1e-9)


def test_deviations_count_from_the_calibrated_length_that_a_file_states(bar: Path) -> None:
    """The commanded circle has the nominal radius all the same; without one it is said what length is taken."""
    plain = import_survey(bar, MILL, centre=CENTRE)
    assert any(
        "no file states a calibrated length: readings count from 150 mm" in s for s in import_lines(plain.imported)
    )
    for words in ("Calibrated length: 150.0123 mm", "Kalibrierte Länge: 150,0123 mm"):
        (bar.parent / "cal.csv").write_text(f"{words}\n{bar.read_text()}")
        found = import_survey(bar.parent / "cal.csv", MILL, centre=CENTRE)
        assert {o.calibrated for o in found.survey.observations.values()} == {150.0123}  # type: ignore[attr-defined]
        np.testing.assert_array_equal(found.survey.table[["X", "length"]], plain.survey.table[["X", "length"]])
        assert not any("no file states" in line for line in import_lines(found.imported))


def test_a_unit_of_deviations_is_asked_for_and_no_file_has_to_be_edited(bar: Path) -> None:
    bar.write_text(bar.read_text().replace(" [um]", ""))
    asked = ("import", bar, "--machine", MILL, "--centre", "X=0,Y=0,Z=375", "--out", bar.parent / "s")
    result = run(*asked)
    assert result.code == 2
    assert "--units deviation=um" in result.err
    assert run(*asked, "--units", "deviation=um").code == 0


def test_columns_that_a_log_does_not_have_are_those_of_the_measured_file(tmp_path: Path) -> None:
    at = poses(rows=20)
    table = at.set_axis(["X soll", "Y soll", "Z soll"], axis=1).assign(time=60.0 * np.arange(20))
    seen = dict(zip(("X ist", "Y ist", "Z ist"), points(at).T, strict=True))
    table.assign(**seen).to_csv(tmp_path / "w.csv", index=False)
    pd.DataFrame({"time": 60.0 * np.arange(20), "T_bed": 20.0}).to_csv(tmp_path / "log.csv", index=False)
    columns = {k: f"{k} soll" for k in "XYZ"} | {f"m{k.lower()}": f"{k} ist" for k in "XYZ"}
    files = [tmp_path / "w.csv", tmp_path / "log.csv"]
    assert "T_bed" in import_survey(files, MILL, columns=columns).survey.table
    with pytest.raises(InputError, match="no column 'X sol'"):
        import_survey(files, MILL, columns=columns | {"X": "X sol"})


def test_a_circle_without_angles_asks_for_them(tmp_path: Path) -> None:
    pd.DataFrame({"point": range(1, 9), "Abweichung [um]": 1.5}).to_csv(tmp_path / "bb.csv", index=False)
    with pytest.raises(InputError, match=r"A trace needs the angle of each reading"):
        import_survey(tmp_path / "bb.csv", MILL, centre={"X": 0, "Y": 0, "Z": 300})
