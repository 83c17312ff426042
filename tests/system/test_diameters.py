"""The cross slide of a lathe in diameters: recognised, and understood where it is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel import InputError, read_machine, read_survey, simulate
from errormodel.units import is_unit, to_internal
from identification import check, diagnose, fit, import_survey
from tests.helpers.commands import XYZ, done, run, write

LATHE = """\
errormodel: 1
chain:
  - {joint: C, type: rotary, axis: -z, travel: [0, 360]}
  - {shape: headstock, offset: [0, 0, 0]}
  - {joint: Z, type: prismatic, axis: z, travel: [0, 600]}
  - {shape: saddle, offset: [0, 0, 0]}
  - {joint: X, type: prismatic, axis: x, travel: [-40, 220]}
  - {shape: slide, offset: [0, 0, 0]}
  - {joint: Y, type: prismatic, axis: y, travel: [-50, 50]}
  - {shape: turret, offset: [150, 0, 80]}
tool: [-150, 0, -80]
"""


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    write(tmp_path / "lathe.yaml", LATHE)
    return tmp_path / "lathe.yaml"


def positions(machine: Path, dia: bool, inches: bool = False) -> pd.DataFrame:
    """Eighty poses of a tracker; X in diameters, all in inches."""
    table = simulate(machine, 80, {"X.dx.1": 3e-5}, noise=0.002, seed=5)
    table = table[["C", "X", "Y", "Z", *XYZ]].assign(X=table["X"] * (1 + dia))
    return table.assign(**{n: table[n] / 25.4 for n in ("X", "Y", "Z", *XYZ)}) if inches else table


def touched() -> pd.DataFrame:
    """A ball that is found with C at 12 positions, four times, X in diameters."""
    rng, rows = np.random.default_rng(1), []
    for turn in np.tile(np.arange(0, 360, 30.0), 4):
        x, y = 30 * np.cos(np.radians(turn)), 30 * np.sin(np.radians(turn))
        found = np.round(np.array([2 * x, y, 60.0]) + rng.normal(0, 0.005, 3), 4)
        rows.append((turn, *found, 30.0, 0.0, 60.0))
    return pd.DataFrame(rows, columns=["C", "X", "Y", "Z", *XYZ])


def laser(reach: float) -> str:
    """Deviations of an interferometer along X at 15 targets up to `reach` mm, twice to and fro."""
    lines = ["Axis: X", "Run;Direction;Target [mm];Deviation [um]"]
    for k in (1, 2):
        for side, way in (("+", 1), ("-", -1)):
            lines += [f"{k};{side};{t:.3f};{0.015 * t + 0.1 * k:.2f}" for t in np.linspace(0, reach, 15)[::way]]
    return "\n".join(lines)


def test_a_diameter_is_a_length_of_single_columns_only(tmp_path: Path) -> None:
    assert is_unit("diameter", "length")
    assert is_unit("diameter inch", "length")
    assert not any(is_unit(*c) for c in (("diameter", "angle"), ("diameter deg", "length"), ("diameters", "length")))
    assert to_internal(np.array([10.0]), "diameter", "length") == [5.0]
    assert to_internal(np.array([2.0]), "diameter inch", "length") == [25.4]
    write(tmp_path / "s.yaml", "errormodel: 1\nfiles: [{path: a.csv}]\nunits: {length: diameter}\n")
    with pytest.raises(InputError, match="unit of length"):
        read_survey(tmp_path / "s.yaml", read_machine("vertical_three_axis"))


@pytest.mark.parametrize("inches", [False, True])
def test_what_is_said_is_read_as_radii_everywhere(machine: Path, inches: bool, tmp_path: Path) -> None:
    radii = tmp_path / "radii.csv"
    positions(machine, False).to_csv(radii, index=False)
    positions(machine, True, inches).to_csv(tmp_path / "dia.csv", index=False)
    length = ", length: inch" if inches else ""
    write(tmp_path / "s.yaml", f"errormodel: 1\nfiles: [{{path: dia.csv}}]\nunits: {{X: diameter{length}}}\n")
    expected = fit(machine, radii).parameters["value"]
    units = {"X": "diameter"} | ({"length": "inch"} if inches else {})
    imported = import_survey(tmp_path / "dia.csv", machine, units=units)
    imported.save(tmp_path / "imported")
    for survey in (tmp_path / "s.yaml", tmp_path / "imported"):
        np.testing.assert_allclose(fit(machine, survey).parameters["value"], expected, rtol=1e-5, atol=1e-9)
        check(machine, survey)
    done("fit", machine, radii, "--out", tmp_path / "f", "--quiet")
    for name, points in (("a", radii), ("b", tmp_path / "s.yaml")):
        done("predict", tmp_path / "f", points, "--out", tmp_path / f"{name}.csv", "--quiet")
    a, b = (pd.read_csv(tmp_path / f"{n}.csv")[XYZ].to_numpy() for n in "ab")
    np.testing.assert_allclose(a, b, atol=1e-6)


def test_positions_in_diameters_are_refused_with_what_to_write(machine: Path, tmp_path: Path) -> None:
    table = tmp_path / "dia.csv"
    positions(machine, True).to_csv(table, index=False)
    for command in (check, fit):
        with pytest.raises(InputError, match="has diameters for radii") as error:
            command(machine, table)
        assert "units: {X: diameter}" in error.value.cure
        assert "--units X=diameter" in error.value.cure
    mended = diagnose(machine, table)
    assert "diameters for radii" in mended.findings.iloc[0]["statement"]


def test_a_touched_ball_in_diameters_is_no_copy(machine: Path, tmp_path: Path) -> None:
    table = tmp_path / "ball.csv"
    touched().to_csv(table, index=False)
    result = run("check", machine, table)
    assert result.code == 2
    assert "X looks like diameters" in result.err
    assert "units: {X: diameter}" in result.err
    write(tmp_path / "s.yaml", "errormodel: 1\nfiles: [{path: ball.csv}]\nunits: {X: diameter}\n")
    assert read_survey(tmp_path / "s.yaml", read_machine(machine)).indicated


def test_targets_beyond_the_travel_of_a_cross_slide_are_asked_about(machine: Path, tmp_path: Path) -> None:
    raw = tmp_path / "laser.csv"
    raw.write_text(laser(420.0))
    with pytest.raises(InputError, match="X looks like diameters: positions from 0 to 420 mm") as error:
        import_survey(raw, machine)
    assert "correct its travel" in error.value.cure
    said = import_survey(raw, machine, units={"X": "diameter"}).survey
    assert said.table["X"].max() == 210.0
    raw.write_text(laser(210.0))
    assert import_survey(raw, machine).survey.table["X"].max() == 210.0


def test_a_milling_machine_with_a_rotary_table_is_not_asked(tmp_path: Path) -> None:
    """X of a table turns about the middle of its travel, and zeros of an interferometer lie anywhere."""
    write(tmp_path / "mill.yaml", LATHE.replace("[-40, 220]", "[-250, 250]"))
    raw = tmp_path / "laser.csv"
    raw.write_text(laser(480.0))
    assert import_survey(raw, tmp_path / "mill.yaml").survey.table["X"].max() == 480.0
