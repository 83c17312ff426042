"""Times, temperatures and other channels in columns beside the readings of a positioning test."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError, read_machine, read_survey
from identification import diagnose, import_survey
from tests.helpers.importing import MILL

MACHINE = read_machine(MILL)
EXPANSION = 11e-6  # a degree
RUNS = 6


def measured() -> pd.DataFrame:
    """Readings of Y there and back while its screw warms up, deviations in um."""
    way = np.arange(-200.0, 201.0, 40.0)
    target = np.concatenate([way, way[::-1]] * (RUNS // 2))
    rows = np.arange(len(target))
    warm = 4 * (1 - np.exp(-rows / 25))
    noise = np.random.default_rng(8).normal(0, 0.3, len(target))
    return pd.DataFrame({
        "Run": rows // (2 * len(way)) + 1, "Target (mm)": target,
        "Direction": np.where(rows // len(way) % 2 == 0, "+", "-"),
        "Deviation [um]": (1e3 * EXPANSION * warm * target + noise).round(2),
        "Time": [str(t) for t in pd.Timestamp("2026-11-10 07:30:00") + pd.to_timedelta(14 * rows, unit="s")],
        "T screw Y [°C]": (20 + warm).round(2),
    })  # fmt: skip


def written(data: pd.DataFrame, folder: Path) -> Path:
    (folder / "y.csv").write_text("Linear test\nAxis: Y\n" + data.to_csv(index=False, sep=";"), encoding="utf-8")
    return folder / "y.csv"


def test_the_expansion_of_a_screw_is_found_by_its_temperature(tmp_path: Path) -> None:
    data = measured()
    result = import_survey(written(data, tmp_path), MILL)
    assert "T_screw_Y = T screw Y" in result.summary()
    result.save(tmp_path / "s")
    survey = read_survey(tmp_path / "s", MACHINE)
    np.testing.assert_allclose(survey.table["T_screw_Y"], data["T screw Y [°C]"])
    np.testing.assert_allclose(np.diff(survey.table["time"].to_numpy(dtype=float)), 14.0)
    effects = diagnose(MACHINE, tmp_path / "s").findings["effect"].to_list()
    assert effects == ["scale-expansion"]


@pytest.mark.parametrize("head", ["T_screw_Y", "Temp. screw Y [°F]", "Material"])
def test_words_and_units_are_those_of_other_tables(head: str, tmp_path: Path) -> None:
    data = measured().rename(columns={"T screw Y [°C]": head}).assign(**{"Feed [mm/min]": 1200.0, "w_power_W": 3.0})
    said = data[head].copy()
    if "F" in head:
        data[head] = said * 9 / 5 + 32
    result = import_survey(written(data, tmp_path), MILL, columns={"T_screw_Y": head} if head == "Material" else {})
    table = result.survey.table
    np.testing.assert_allclose(table["T_screw_Y"], said)
    assert (table["feed"] == 1200).all()
    assert (table["w_power_W"] == 3).all()


def test_what_is_not_used_is_said(tmp_path: Path) -> None:
    data = measured().assign(Operator="A", dx=0.0)
    data.insert(0, "No", range(1, len(data) + 1))
    result = import_survey(written(data, tmp_path), MILL)
    assert any("columns not used: No, Operator" in note for note in result.notes)
    assert "columns not used: dx" in result.summary()  # of another error motion, in a test of dy
    assert "dx" not in result.survey.table or result.survey.table["dx"].isna().all()


def test_a_temperature_of_several_runs_is_of_none_of_them(tmp_path: Path) -> None:
    rows = "".join(f"{p};1;2;1;2;20.{k}\n" for k, p in enumerate((-100, 0, 100)))
    (tmp_path / "y.csv").write_text(f"Position [mm];1+ [um];1- [um];2+ [um];2- [um];T screw [°C]\n{rows}")
    assert "not used: T screw" in import_survey(tmp_path / "y.csv", MILL, joint="Y").summary()


def test_a_column_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"T_screw_Y: no column 'T bed'.*T screw Y"):
        import_survey(written(measured(), tmp_path), MILL, columns={"T_screw_Y": "T bed"})


def test_a_column_of_another_name_in_the_file_is_left_out(tmp_path: Path) -> None:
    """By the name that it would have in the survey; of several files, of those that have it."""
    data = measured()
    other = data.drop(columns="T screw Y [°C]")
    (tmp_path / "x.csv").write_text("Axis: X\n" + other.to_csv(index=False, sep=";"))
    files = [written(data, tmp_path), tmp_path / "x.csv"]
    for raws in (files[0], files):
        result = import_survey(raws, MILL, columns={"T_screw_Y": "-"})
        assert "T_screw_Y" not in result.survey.table
        assert any("not used: T screw Y" in note for note in result.notes)
    with pytest.raises(InputError, match="T_scrw: no such column to leave out"):
        import_survey(files[0], MILL, columns={"T_scrw": "-"})
    with pytest.raises(InputError, match="none of the files has a column of T_scrw"):
        import_survey(files, MILL, columns={"T_scrw": "-"})


def test_a_line_of_the_map_that_names_a_column_leaves_it_out(tmp_path: Path) -> None:
    import_survey(written(measured(), tmp_path), MILL).save(tmp_path / "s")
    stated = tmp_path / "s/survey.yaml"
    stated.write_text(stated.read_text().replace("T_screw_Y: T screw Y", "T_screw_Y: '-'"))
    assert "T_screw_Y" not in read_survey(tmp_path / "s", MACHINE).table
