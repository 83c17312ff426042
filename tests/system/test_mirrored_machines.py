"""Mistakes in the machine file or in all lengths that a mirrored or displaced column would explain as well.

The recordings are of a tilting rotary table, by the closed form of its two axes, which shares no code with the product.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from tests.helpers.commands import XYZ, done, run, write

MACHINE = """\
errormodel: 1
chain:
  - {joint: C, type: rotary, axis: z, travel: [0, 360]}
  - {shape: cradle, offset: [0, 0, -40]}
  - {joint: A, type: rotary, axis: x, travel: [-100, 40]}
  - {shape: yoke, offset: [0, 300, -160]}
  - {joint: Y, type: prismatic, axis: y, travel: [-350, 350]}
  - {shape: bed, offset: [0, -300, 500]}
  - {joint: X, type: prismatic, axis: x, travel: [-300, 300]}
  - {shape: column}
  - {joint: Z, type: prismatic, axis: z, travel: [-500, 0]}
  - {shape: head, offset: [0, 0, 250]}
tool: [0, 0, -150]
errors:
  shapes: all
  joints: {X: first-order, Y: first-order, Z: first-order, A: none, C: none}
"""
TIP = np.array([0.0, 0.0, 400.0])  # of the tool where X, Y and Z are 0, from the table's face
CENTRE = np.array([0.0, 0.0, -40.0])  # where the axes of A and C meet
BALLS = ((140.0, 20.0, 60.0), (-90.0, 70.0, 160.0), (60.0, -110.0, 200.0), (-60.0, -90.0, 90.0))
A_POINT, A_AXIS = np.array([0.0, 0.012, -39.97]), np.array([1.0, -45e-6, -55e-6])
C_POINT, C_AXIS = np.array([0.018, -0.025, 0.0]), np.array([-30e-6, -40e-6, 1.0])
LINEAR = np.array([[1 + 60e-6, -35e-6, -20e-6], [0.0, 1 - 40e-6, -28e-6], [0.0, 0.0, 1 + 25e-6]])
Edit = Callable[[pd.DataFrame], pd.DataFrame]


def about(axis: np.ndarray, degrees: float) -> np.ndarray:
    return np.asarray(Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix())


def recording(balls: Sequence[tuple[float, float, float]], noise: float = 0.001) -> pd.DataFrame:
    """Each ball in all poses of the table, at which the nominal tool meets it, and where the tool is in the table."""
    random, rows = np.random.default_rng(5), []
    for ball in balls:
        for a in (-90, -60, -30, 0, 30):
            for c in range(0, 360, 40):
                nominal = CENTRE + about(np.eye(3)[0], -a) @ (about(np.eye(3)[2], -c) @ ball - CENTRE)
                position = nominal - TIP
                tip = TIP + LINEAR @ position
                tip = A_POINT + about(A_AXIS, -a).T @ (tip - A_POINT)
                tip = C_POINT + about(C_AXIS, -c).T @ (tip - C_POINT)
                rows.append([*position, a, c, *(tip + random.normal(0, noise, 3))])
    return pd.DataFrame(rows, columns=["X", "Y", "Z", "A", "C", *XYZ])


def said(folder: Path, command: str, machine: str, table: pd.DataFrame) -> str:
    """The refusal of a command."""
    write(folder / "m.yaml", machine)
    table.to_csv(folder / "s.csv", index=False)
    out = () if command == "check" else ("--out", folder / "out")
    result = run(command, folder / "m.yaml", folder / "s.csv", *out)
    assert result.code == 2
    assert not (folder / "out").exists()
    return result.err


def changed(*names: str, by: float) -> Edit:
    return lambda table: table.assign(**{name: table[name] * by for name in names})


TURNED = MACHINE.replace("axis: z, travel: [0, 360]", "axis: -z, travel: [0, 360]")


@pytest.mark.parametrize("command", ["check", "fit"])
def test_the_turned_axis_of_a_table_and_not_a_slide_is_named(command: str, tmp_path: Path) -> None:
    """X turned leaves the mirror image of three balls, as near to the nominal machine, but not its errors."""
    text = said(tmp_path, command, TURNED, recording(BALLS[:3]))
    assert "the sign of column C is wrong, or that of the axis of C in the machine file" in text
    assert "column X" not in text


def test_a_diagnosis_takes_the_table_to_turn_the_other_way(tmp_path: Path) -> None:
    write(tmp_path / "m.yaml", TURNED)
    recording(BALLS[:3]).to_csv(tmp_path / "s.csv", index=False)
    done("diagnose", tmp_path / "m.yaml", tmp_path / "s.csv", "--out", tmp_path / "out")
    (finding,) = json.loads((tmp_path / "out/diagnosis.json").read_text())["findings"]
    assert (finding["effect"], finding["where"]) == ("axis-blunder", "C")


@pytest.mark.parametrize("command", ["fit", "diagnose"])
def test_travels_that_a_column_would_leave_tell_the_machine_file(command: str, tmp_path: Path) -> None:
    machine = MACHINE.replace("axis: x, travel: [-100, 40]", "axis: -x, travel: [-100, 40]")
    text = said(tmp_path, command, machine, recording(BALLS[:3]))
    assert "the sign of column A is wrong, or rather that of the axis of A in the machine file" in text
    assert "then correct the machine file, or the table" in text
    assert "puts it right" not in text


def test_of_one_ball_both_ways_to_read_it_are_named(tmp_path: Path) -> None:
    text = said(tmp_path, "fit", TURNED, recording(BALLS[:1]))
    assert "the sign of column C is wrong, or that of the axis of C in the machine file" in text
    assert "or the sign of each of columns X and mx is wrong" in text


def test_travels_tell_a_column_from_the_machine_file(tmp_path: Path) -> None:
    text = said(tmp_path, "fit", MACHINE, changed("C", by=-1.0)(recording(BALLS[:3])))
    assert "the sign of column C is wrong: the nominal machine" in text


@pytest.mark.parametrize("command", ["check", "fit", "diagnose"])
def test_all_lengths_in_another_unit(command: str, tmp_path: Path) -> None:
    """Displaced to where its axes meet, a machine of any size is the same: another zero of Z explains it as well."""
    text = said(tmp_path, command, MACHINE, changed("X", "Y", "Z", *XYZ, by=1 / 25.4)(recording(BALLS[:3])))
    assert "each of columns Y, X, Z, mx, my and mz is in another unit: it must be multiplied by 25.4" in text
    assert "(units: {length: inch} in a survey.yaml), or the lengths of the machine file divided by it" in text
    assert "zero" not in text


def test_all_lengths_in_another_unit_are_no_target_beside_the_tool(tmp_path: Path) -> None:
    write(tmp_path / "m.yaml", MACHINE)
    table = recording(BALLS[:3])
    changed("X", "Y", "Z", *XYZ, by=1 / 25.4)(table).to_csv(tmp_path / "raw.csv", index=False)
    arguments = ("--machine", tmp_path / "m.yaml", "--out", tmp_path / "s")
    result = run("import", tmp_path / "raw.csv", *arguments)
    assert result.code == 2
    assert "it must be multiplied by 25.4" in result.err
    table.to_csv(tmp_path / "raw.csv", index=False)
    done("import", tmp_path / "raw.csv", *arguments)


@pytest.mark.parametrize("balls", [2, 3])
@pytest.mark.parametrize("column", XYZ)
def test_the_hand_of_points_in_a_plane_is_told_by_the_errors(balls: int, column: str, tmp_path: Path) -> None:
    table = changed(column, by=-1.0)(recording(BALLS[:balls]))
    for command in ("check", "fit"):
        text = said(tmp_path, command, MACHINE, table)
        assert "mx my mz are left-handed: one of them has the wrong sign" in text
        assert "times less of the points" in text


@pytest.mark.parametrize("balls", [1, 2, 3, 4])
def test_right_recordings_pass(balls: int, tmp_path: Path) -> None:
    write(tmp_path / "m.yaml", MACHINE)
    recording(BALLS[:balls]).to_csv(tmp_path / "s.csv", index=False)
    done("fit", tmp_path / "m.yaml", tmp_path / "s.csv", "--out", tmp_path / "out")
    done("check", tmp_path / "m.yaml", tmp_path / "s.csv")


def test_a_mirror_image_is_put_right_by_a_diagnosis(tmp_path: Path) -> None:
    write(tmp_path / "m.yaml", MACHINE)
    fits = []
    for name, edit in (("right", lambda t: t), ("mirrored", changed("my", by=-1.0))):
        edit(recording(BALLS[:3])).to_csv(tmp_path / "s.csv", index=False)
        done("diagnose", tmp_path / "m.yaml", tmp_path / "s.csv", "--out", tmp_path / name)
        found = json.loads((tmp_path / name / "diagnosis.json").read_text())
        assert [f["effect"] for f in found["findings"]] == ["axis-blunder"] * (name == "mirrored")
        fits.append(pd.read_csv(tmp_path / name / "parameters.csv", index_col="id"))
    right, mirrored = (fit["value"][[k for k in fit.index if not k.startswith("frame")]] for fit in fits)
    np.testing.assert_allclose(mirrored, right, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("offset: [0, 300, -160]", "offset: [0, 300, -200]", "or along its axis to yoke, bed, column, head or tool"),
        ("tool: [0, 0, -150]\n", "", "or rather along its axis to yoke, bed, column, head or tool"),
    ],
)
def test_entries_of_the_machine_file_are_named_beside_a_zero(old: str, new: str, words: str, tmp_path: Path) -> None:
    assert words in said(tmp_path, "fit", MACHINE.replace(old, new), recording(BALLS[:3]))


def test_joints_in_another_order_are_named(tmp_path: Path) -> None:
    joints = "joint: C, type: rotary, axis: z, travel: [0, 360]", "joint: A, type: rotary, axis: x, travel: [-100, 40]"
    machine = MACHINE.replace(joints[0], "@").replace(joints[1], joints[0]).replace("@", joints[1])
    text = said(tmp_path, "fit", machine, recording(BALLS[:3]))
    assert "beside one whose joints A and C are exchanged in the chain" in text


def test_positions_of_the_spindle_nose_are_no_unit_of_the_tool(tmp_path: Path) -> None:
    table = recording(BALLS[:3])
    text = said(tmp_path, "fit", MACHINE, table.assign(Z=table["Z"] - 150))
    assert re.search(r"column Z has another zero than the machine's dimensions, 1(49\.9|50\.0)", text)
    assert "tool_z" not in text
