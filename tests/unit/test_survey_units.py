"""Names, units, zeros and signs of a survey's columns that look wrong are noted or refused, with the cure."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from errormodel.exceptions import InputError
from errormodel.files import write_csv
from errormodel.machine_file import read_machine
from errormodel.survey import read_survey
from tests.helpers.survey_files import JOINTS, MACHINE, poses, yaml

# ---- names


def test_a_measured_component_whose_name_is_misspelt_is_not_left_out(tmp_path: Path):
    write_csv(poses().rename(columns={"my": "mY"}), tmp_path / "s.csv")
    with pytest.raises(InputError, match=r"'mY' beside mx mz, and no my.*Name it 'my'"):
        read_survey(tmp_path / "s.csv", MACHINE)


@pytest.mark.parametrize(
    "name", ["Mx_meas", "meas_mx", "MX", "x_meas", "mx [mm]", "measX", "mxValue", "pt mx", "mx.act"]
)
@pytest.mark.parametrize("beside", [("my", "mz"), ("mz",)])
def test_a_column_that_has_the_missing_name_in_its_own(tmp_path: Path, name: str, beside: tuple[str, ...]):
    """And by the map, as the message says, it is read."""
    frame = poses()[[*JOINTS, "mx", *beside]].rename(columns={"mx": name})
    write_csv(frame, tmp_path / "s.csv")
    with pytest.raises(InputError) as caught:
        read_survey(tmp_path / "s.csv", MACHINE)
    cure = f'columns: {{mx: "{name}"}}'
    assert f"'{name}' beside {' '.join(beside)}, and no mx" in str(caught.value)
    assert f"Name it 'mx', or write {cure}" in str(caught.value)
    np.testing.assert_allclose(read_survey(yaml(tmp_path, cure), MACHINE).table["mx"], poses()["mx"], rtol=1e-12)


@pytest.mark.parametrize("components", [("mx", "mz"), ("mz",), ("mx", "my", "mz")])
def test_a_component_that_was_not_measured_is_left_out(tmp_path: Path, components: tuple[str, ...]):
    """Where no column may be it: one of remarks, one of numbers, and one for a component that is there."""
    frame = poses()[[*JOINTS, *components]].assign(**{"my remarks": "good", "batch": 7.0, "mz_check": 1.0})
    write_csv(frame, tmp_path / "s.csv")
    survey = read_survey(tmp_path / "s.csv", MACHINE)
    assert [c for c in ("mx", "my", "mz") if survey.table[c].notna().all()] == list(components)
    assert any("columns not used: my remarks, batch, mz_check" in note for note in survey.notes)


# ---- units by size


@pytest.mark.parametrize(("unit", "mm"), [("m", 1000.0), ("inch", 25.4), ("um", 1e-3)])
@pytest.mark.parametrize("components", [("mx", "my", "mz"), ("mx", "mz")])
def test_measured_in_another_unit(tmp_path: Path, unit: str, mm: float, components: tuple[str, ...]):
    frame = poses()
    frame[["mx", "my", "mz"]] /= mm
    write_csv(frame[[*JOINTS, *components]], tmp_path / "s.csv")
    with pytest.raises(InputError, match=rf"columns mx my mz: in {unit}, it seems") as caught:
        read_survey(tmp_path / "s.csv", MACHINE)
    cure = f"units: {{{', '.join(f'{c}: {unit}' for c in components)}}}"
    assert cure in str(caught.value)
    expected = poses()[[*components]].to_numpy()
    np.testing.assert_allclose(read_survey(yaml(tmp_path, cure), MACHINE).table[[*components]], expected, rtol=1e-12)
    arm = read_machine("six_axis_arm")
    frame = poses(60, arm)
    frame[["mx", "my", "mz"]] /= mm
    write_csv(frame[[*(j.name for j in arm.joints), *components]], tmp_path / "arm.csv")
    with pytest.raises(InputError, match=f"in {unit}, it seems"):
        read_survey(tmp_path / "arm.csv", arm)


@pytest.mark.parametrize(("unit", "mm"), [("m", 1000.0), ("inch", 25.4), ("um", 1e-3)])
def test_all_lengths_in_another_unit(tmp_path: Path, unit: str, mm: float):
    frame = poses()
    frame[[*JOINTS[1:], "mx", "my", "mz"]] /= mm
    write_csv(frame, tmp_path / "s.csv")
    with pytest.raises(InputError, match=f"units: {{length: {unit}}}"):
        read_survey(tmp_path / "s.csv", MACHINE)
    survey = read_survey(yaml(tmp_path, f"units: {{length: {unit}}}"), MACHINE)
    expected = poses()
    assert not survey.notes
    np.testing.assert_allclose(survey.measured, expected[["mx", "my", "mz"]], rtol=1e-12)
    np.testing.assert_allclose(survey.commands(JOINTS[1:]), expected[[*JOINTS[1:]]], rtol=1e-12)


@pytest.mark.parametrize(("unit", "mm"), [("m", 1000.0), ("inch", 25.4), ("um", 1e-3)])
def test_commands_in_another_unit(tmp_path: Path, unit: str, mm: float):
    frame = poses()
    frame[[*JOINTS[1:]]] /= mm
    write_csv(frame, tmp_path / "s.csv")
    with pytest.raises(InputError, match=rf"columns X Y Z: .* in {unit}") as caught:
        read_survey(tmp_path / "s.csv", MACHINE)
    cure = f"units: {{{', '.join(f'{joint}: {unit}' for joint in JOINTS[1:])}}}"
    assert cure in str(caught.value)
    cured, expected = read_survey(yaml(tmp_path, cure), MACHINE), poses()
    np.testing.assert_allclose(cured.commands(JOINTS[1:]), expected[[*JOINTS[1:]]], rtol=1e-12)
    np.testing.assert_allclose(cured.measured, expected[["mx", "my", "mz"]], rtol=1e-12)


def test_commands_that_may_be_inches_are_noted(tmp_path: Path):
    machine = read_machine("bridge_cmm")
    frame = poses(60, machine) / 25.4
    write_csv(frame, tmp_path / "s.csv")
    (note,) = read_survey(tmp_path / "s.csv", machine).notes
    assert "units: {length: inch}" in note


def test_units_said_but_not_so(tmp_path: Path):
    write_csv(poses(), tmp_path / "s.csv")
    with pytest.raises(InputError, match="length: mm"):
        read_survey(yaml(tmp_path, "units: {length: m}"), MACHINE)


def test_radians_for_degrees_are_noted(tmp_path: Path):
    frame = poses()
    frame["B"] = np.deg2rad(frame["B"])
    write_csv(frame, tmp_path / "s.csv")
    (note,) = read_survey(tmp_path / "s.csv", MACHINE).notes
    assert "fit B in rad" in note
    assert not read_survey(yaml(tmp_path, "units: {angle: rad}"), MACHINE).notes
    (note,) = read_survey(tmp_path / "s.csv", MACHINE, measured=False).notes
    assert "if that is rad" in note


@pytest.mark.parametrize(
    "blunder", ["sign", "swap", "unit", "small patch", "scale", "two stations", "coordinates lost"]
)
def test_one_wrong_column_is_no_wrong_unit(tmp_path: Path, blunder: str):
    """Blunders of one column are for the diagnosis to find, and odd plans are nobody's business."""
    frame = poses(200)
    if blunder == "sign":
        frame["X"] *= -1
    elif blunder == "swap":
        frame[["mx", "my"]] = frame[["my", "mx"]].to_numpy()
    elif blunder == "unit":
        frame["X"] /= 25.4
    elif blunder == "small patch":
        frame = frame.iloc[:1].loc[np.zeros(50, dtype=int)].reset_index(drop=True)
        for joint, measured, sign in (("X", "my", 1.0), ("Y", "mx", -1.0), ("Z", "mz", 1.0)):
            step = np.random.default_rng(3).uniform(0, 3, 50)
            frame[joint] += step
            frame[measured] += sign * step
    elif blunder == "scale":
        frame["Z"] *= 1.02
    elif blunder == "two stations":
        frame.loc[100:, ["mx", "my"]] = frame.loc[100:, ["my", "mx"]].to_numpy() + 5000
    elif blunder == "coordinates lost":
        frame.loc[::2, "mx"] = np.nan
    write_csv(frame, tmp_path / "s.csv")
    notes = read_survey(tmp_path / "s.csv", MACHINE).notes
    assert not [note for note in notes if "unit" in note or " rad" in note]


def test_poses_outside_the_travel_are_noted(tmp_path: Path):
    frame = poses()
    frame.loc[7, "X"] += 1000
    frame.loc[9, "B"] = 361.0
    write_csv(frame, tmp_path / "s.csv")
    notes = read_survey(tmp_path / "s.csv", MACHINE, measured=False).notes
    assert len(notes) == 2
    assert "1 pose is outside the travel of B, 0 to 360 deg; the farthest at 361 deg" in notes[0]
    assert "travel of X, -500 to 500 mm" in notes[1]
    assert notes[1].endswith("row 8)")


def x_note(tmp_path: Path, positions: np.ndarray) -> str:
    """The note of a survey's positions of X, whose travel is -500 to 500 mm."""
    write_csv(poses(len(positions)).assign(X=positions), tmp_path / "s.csv")
    (note,) = read_survey(tmp_path / "s.csv", MACHINE, measured=False).notes
    return note


def test_another_zero_is_advised_only_where_it_is_clear(tmp_path: Path):
    few = np.linspace(-400, 520, 40)
    note = x_note(tmp_path, few)
    assert note.startswith("1 pose is outside")
    assert "another zero" not in note
    assert "another zero" not in x_note(tmp_path, np.where(np.arange(40) % 4 == 0, 510.0, np.linspace(-300, 400, 40)))
    assert "another zero" not in x_note(tmp_path, np.full(40, 600.0) + np.linspace(0, 1, 40))
    assert "another zero" not in x_note(tmp_path, np.linspace(600, 1700, 40))  # wider than the travel
    wrong = "Levers and scales are wrong until this is mended"
    every = x_note(tmp_path, np.linspace(600, 1400, 40))
    assert "40 poses are outside" in every
    assert "add -1000 mm" in every
    assert wrong in every
    most = x_note(tmp_path, np.linspace(400, 1300, 40))
    assert "it may be that X counts from another zero" in most
    assert wrong not in most


def test_a_sign_that_may_be_wrong_is_no_other_zero_to_add(tmp_path: Path):
    machine = read_machine("bridge_cmm")
    joint = next(j for j in machine.joints if j.travel[0] == 0)
    frame = poses(40, machine)
    write_csv(frame.assign(**{joint.name: -np.linspace(0.1, 0.9, 40) * joint.travel[1]}), tmp_path / "s.csv")
    (note,) = [n for n in read_survey(tmp_path / "s.csv", machine, measured=False).notes if "outside" in n]
    assert f"the sign of {joint.name} is wrong, or its zero" in note
    assert "add" not in note


def test_readings_of_angles_have_a_unit_of_their_own(tmp_path: Path) -> None:
    """The name of their column is that of the unit of rotary joints."""
    frame = poses()[[*JOINTS]].assign(observation="A", angle=np.linspace(-4, 4, len(poses())))
    write_csv(frame, tmp_path / "s.csv")
    entry = "observations: {A: {type: line-angle, axis: [0, 1, 0]}}\n"
    read = read_survey(yaml(tmp_path, f"{entry}units: {{angle: deg, reading: arcsec}}"), MACHINE).table["angle"]
    np.testing.assert_allclose(read, np.deg2rad(frame["angle"] / 3600), rtol=1e-12)
    plain = read_survey(yaml(tmp_path, f"{entry}units: {{angle: deg}}"), MACHINE).table["angle"]
    np.testing.assert_allclose(plain, frame["angle"], rtol=1e-12)
    with pytest.raises(InputError, match="a unit of angle"):
        read_survey(yaml(tmp_path, f"{entry}units: {{reading: mm}}"), MACHINE)
