"""The robot's own URDF with the origins of its joints replaced: nothing else of it changes."""

from __future__ import annotations

import difflib
import re
from pathlib import Path

import numpy as np
import pytest
from pytransform3d.urdf import UrdfTransformManager

from tests.helpers.commands import done, run, tree, write
from tests.helpers.robots import frames, joint, positions, read_text

TOOL = (30.0, 0.0, 50.0)
OWN = """<?xml version="1.0" encoding="ISO-8859-1"?>
<!-- a robot of the shop: Fräse, "quoted" -->
<robot name="shop arm">
  <link name="world"/><link name="base"><visual><origin xyz="0 0 9" rpy="0 0 0"/><geometry/></visual></link>
  <link name="upper"><inertial><mass value="3.5"/></inertial></link>
  <link name="lower"/> <link name="wrist"/> <link name='tool0'/><link name="camera"/>
  <joint name="mount" type="fixed"><parent link="world"/><child link="base"/>
    <origin xyz="0 0 0.5" rpy="0 0 1.5707963267948966"/></joint>
  <joint name="pan" type="revolute"><parent link="base"/><child link="upper"/>
    <origin   rpy='0 0 0'
       xyz="0 0 0.2" /><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="9" velocity="1"/></joint>
  <joint name="lift" type="revolute"><parent link="upper"/><child link="lower"/>
    <origin xyz="0.05 0 0.3" rpy="1.5707963267948966 0 0"></origin>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="9" velocity="1"/></joint>
  <joint name="roll" type="continuous"><parent link="lower"/><child link="wrist"/><axis xyz="1 0 0"/></joint>
  <joint name="eye" type="fixed"><parent link="wrist"/><child link="camera"/><origin xyz="0.1 0 0"/></joint>
  <joint name="flange" type="fixed"><parent link="wrist"/><child link="tool0"/><origin xyz="0.4 0 0"/></joint>
</robot>
"""
BYTES = OWN.replace("\n", "\r\n").encode("latin-1")
TRUTH = {"upper.dx": -0.6, "upper.ea": 4e-4, "lower.dy": 0.3, "lower.ec": -8e-4, "wrist.dz": 0.4}


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cell")
    write(folder / "own.urdf", BYTES)
    done("machine", folder / "own.urdf", "--tip", "tool0", "--tool", *TOOL, "--out", folder / "m.yaml")
    truth = "".join(f"  {k}: {v}\n" for k, v in TRUTH.items())
    write(folder / "truth.yaml", f"parameters:\n{truth}frame: {{translation: [700, 10, -30], rotation: [3, 9, 70]}}\n")
    words = ["--parameters", folder / "truth.yaml", "--noise", 1e-7, "--out", folder / "s.csv"]
    done("simulate", folder / "m.yaml", 80, *words)
    done("fit", folder / "m.yaml", folder / "s.csv", "--out", folder / "fit", "--quiet")
    return folder


def into(cell: Path, out: Path, source: str = "fit") -> str:
    words = ["--format", "urdf", "--into", cell / "own.urdf", "--tip", "tool0", "--out", out]
    return done("export", cell / source, *words).out


def test_nothing_but_origins_changes(cell: Path, tmp_path: Path) -> None:
    into(cell, tmp_path / "new.urdf")
    text = (tmp_path / "new.urdf").read_bytes().decode("utf-8")
    assert "\r\n" in text
    old, new = OWN.splitlines(), text.splitlines()
    changed = [line for line in difflib.ndiff(old, new) if line[0] in "+-"]
    kept = [line for line in changed if not re.search(r'origin|xyz="0 0 0.2"|encoding|name="roll"', line)]
    assert kept == []
    assert 'encoding="utf-8"' in new[0]
    assert "Fräse" in text
    assert '<joint name="roll" type="continuous"><origin xyz=' in text  # it had none
    assert '<child link="camera"/><origin xyz="0.1 0 0"/>' in text  # beside the chain
    assert '<visual><origin xyz="0 0 9" rpy="0 0 0"/>' in text


def test_the_new_file_is_the_calibrated_robot_in_another_reader(cell: Path, tmp_path: Path) -> None:
    said = into(cell, tmp_path / "new.urdf")
    figure = re.search(r"at most (\S+) mm", said)
    assert figure
    assert float(figure[1]) < 1e-9
    done("export", cell / "fit", "--format", "dh", "--out", tmp_path / "t.csv")
    table = read_text((tmp_path / "t.csv").read_text())
    manager = UrdfTransformManager()
    manager.load_urdf((tmp_path / "new.urdf").read_text(encoding="utf-8").partition("?>")[2])
    q = positions(table.joints, 20)
    for row, expected in zip(q, frames(table, q), strict=True):
        for own, value in zip(("pan", "lift", "roll"), row, strict=True):
            manager.set_joint(own, value)
        found = np.array(manager.get_transform("tool0", "world"))
        assert np.abs(1e3 * found[:3, 3] - expected[:3, 3]).max() < 1e-6
        assert np.abs(found[:3, :3] - expected[:3, :3]).max() < 1e-9


def test_the_nominal_machine_leaves_the_file_the_same_robot(cell: Path, tmp_path: Path) -> None:
    into(cell, tmp_path / "same.urdf", "m.yaml")
    own, same = (read_text(t, tip="tool0") for t in (OWN, (tmp_path / "same.urdf").read_text(encoding="utf-8")))
    q = positions(own.joints, 20)
    np.testing.assert_allclose(frames(same, q), frames(own, q), atol=1e-12, rtol=0)


def test_what_has_no_place_behind_the_last_joint_is_said(cell: Path, tmp_path: Path) -> None:
    """A chain that ends at the link of its last joint: there is no origin behind it."""
    done("machine", cell / "own.urdf", "--tip", "wrist", "--tool", *TOOL, "--out", tmp_path / "m.yaml")
    done("simulate", tmp_path / "m.yaml", 80, "--parameters", cell / "truth.yaml", "--out", tmp_path / "s.csv")
    done("fit", tmp_path / "m.yaml", tmp_path / "s.csv", "--out", tmp_path / "fit", "--quiet")
    words = ["--format", "urdf", "--into", cell / "own.urdf", "--tip", "wrist", "--out", tmp_path / "new.urdf"]
    result = done("export", tmp_path / "fit", *words)
    note = re.search(r"behind 'roll' hangs no fixed joint: xyz (.*?), rpy", result.err)
    assert note
    assert max(map(abs, map(float, note[1].split(",")))) < 2e-3  # m: errors


def test_a_file_of_another_robot_is_refused(cell: Path, tmp_path: Path) -> None:
    one = f'<robot name="a">{joint("A", "b", "tool0")}</robot>'
    cases = {
        "longer": (OWN.replace("0.05 0 0.3", "0.05 0 0.31"), ("what lies behind pan", "by 10")),
        "turned": (OWN.replace('<axis xyz="1 0 0"/>', '<axis xyz="0 1 0"/>'), ("another axis of roll",)),
        "slide": (OWN.replace('"lift" type="revolute"', '"lift" type="prismatic"'), ("rotary, prismatic, rotary",)),
        "one": (one, ("a chain of rotary joints",)),
        "broken": ("<robot>", ("no XML",)),
    }
    for name, (text, words) in cases.items():
        path = write(tmp_path / f"{name}.urdf", text)
        before = tree(tmp_path)
        options = ["--into", path, "--tip", "tool0", "--out", tmp_path / "new.urdf"]
        result = run("export", cell / "fit", "--format", "urdf", *options)
        assert result.code == 2, name
        assert all(w in result.err for w in words), result.err
        assert tree(tmp_path) == before


def test_options_without_use_are_refused(cell: Path, tmp_path: Path) -> None:
    for words, said in (
        (["--format", "dh", "--into", cell / "own.urdf"], "holds nothing that is to be kept"),
        (["--format", "urdf", "--tip", "tool0"], "no --into"),
        (["--format", "urdf", "--into", tmp_path / "none.urdf"], "no such file"),
    ):
        result = run("export", cell / "fit", *words, "--out", tmp_path / "a")
        assert result.code == 2
        assert said in result.err
    over = ["--format", "urdf", "--into", cell / "own.urdf", "--tip", "tool0", "--out", cell / "own.urdf"]
    assert run("export", cell / "fit", *over).code == 2
    assert (cell / "own.urdf").read_bytes() == BYTES
