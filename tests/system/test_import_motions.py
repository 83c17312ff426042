"""Tables of one joint's error motions under their usual names, and slopes as angles (um/m), as levels write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError
from errormodel.raw_formats.unit_words import bracketed, stated_length, unit_word
from errormodel.units import factor, is_unit
from identification import import_survey
from identification.results.import_result import ImportResult
from tests.helpers.importing import MILL

POSITIONS = np.arange(-200.0, 201.0, 50.0)
SIZE = np.round(20 * np.sin(POSITIONS / 90) + 3, 2)


def imported(folder: Path, head: str, unit_size: float = 1.0, **asked: object) -> ImportResult:
    table = pd.DataFrame({"Position [mm]": POSITIONS, "Run": 1, head: SIZE * unit_size})
    table.to_csv(folder / "t.csv", index=False)
    return import_survey(folder / "t.csv", MILL, **asked)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "bare", "unit"),
    [
        ("Pegel (um/m)", "Pegel", "um/m"), ("EBX [\u00b5m/m]", "EBX", "um/m"), ("Neigung / mm/m", "Neigung", "mm/m"),
        ("EBX um/m", "EBX", "um/m"), ("Winkel, mm/Meter", "Winkel", "mm/m"), ("Feed (mm/min)", "Feed", "mm/min"),
        ("X act/mm", "X act", "mm"), ("Force (N/mm)", "Force (N/mm)", ""), ("X / mm", "X", "mm"),
    ],
)  # fmt: skip
def test_a_slash_belongs_to_its_unit(name: str, bare: str, unit: str) -> None:
    assert bracketed(name) == (bare, unit)


def test_a_slope_is_an_angle() -> None:
    assert unit_word("\u03bcm/m") == "um/m"
    assert factor("um/m", "angle") == pytest.approx(1e-6)
    assert factor("mm/m", "angle") == pytest.approx(1e-3)
    assert not is_unit("m/mm", "angle")
    assert not is_unit("mm/min", "angle")
    assert not is_unit("um/m", "length")
    assert stated_length(["Units: um/m"]) == ""


@pytest.mark.parametrize("joint", ["", "X"])
@pytest.mark.parametrize(
    ("head", "motion", "unit"),
    [("EBX [um/m]", "eb", 1e-6), ("EAX [arcsec]", "ea", np.pi / 648000), ("EYX (um)", "dy", 1e-3), ("EXX", "dx", 1.0)],
)
def test_names_of_iso_230_1_are_known(tmp_path: Path, joint: str, head: str, motion: str, unit: float) -> None:
    size = 1e-3 if head == "EXX" else 1.0  # without a unit a translation is in mm
    table = imported(tmp_path, head, size, joint=joint).survey.table
    assert {*table["joint"]} == {"X"}
    np.testing.assert_allclose(table["X"], POSITIONS)
    np.testing.assert_allclose(table[motion], SIZE * size * unit, rtol=1e-12)


def test_an_angle_without_a_unit_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"column EBX: angles without a unit.*--units eb=arcsec"):
        imported(tmp_path, "EBX")
    found = imported(tmp_path, "EBX", units={"eb": "um/m"}).survey.table["eb"]
    np.testing.assert_allclose(found, SIZE * 1e-6, rtol=1e-12)


@pytest.mark.parametrize(
    ("joint", "word", "motion"),
    [("X", "Pitch", "eb"), ("X", "Gierwinkel", "ec"), ("X", "roll", "ea"), ("Y", "Nicken", "ea"), ("Y", "Roll", "eb")],
)
def test_pitch_yaw_and_roll_follow_from_the_axis_of_a_joint(tmp_path: Path, joint: str, word: str, motion: str) -> None:
    result = imported(tmp_path, f"{word} [um/m]", joint=joint)
    np.testing.assert_allclose(result.survey.table[motion], SIZE * 1e-6, rtol=1e-12)
    assert f"--columns {motion}=-{word}" in result.summary()  # nobody says which way it counts


def test_pitch_of_what_travels_vertically_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"pitch of Z, which travels vertically.*ea=Pitch or --columns eb=Pitch"):
        imported(tmp_path, "Pitch [um/m]", joint="Z")
    with pytest.raises(InputError, match=r"--joint X --columns X=Position,eb=\.\."):
        imported(tmp_path, "Pitch [um/m]")


def test_a_level_in_um_a_metre(tmp_path: Path) -> None:
    places = pd.DataFrame({"X": POSITIONS, "Y": 0.0, "Z": 200.0})
    places.to_csv(tmp_path / "places.csv", index=False)
    pd.DataFrame({"X": POSITIONS, "Pegel (um/m)": SIZE}).to_csv(tmp_path / "l.csv", index=False)
    result = import_survey(
        tmp_path / "l.csv", MILL, commands=tmp_path / "places.csv", observation="precision-level, axis: [0, 1, 0]"
    )
    np.testing.assert_allclose(result.survey.table["angle"], SIZE * 1e-6, rtol=1e-12)
