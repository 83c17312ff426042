"""The machine library: every file reads, says where its dimensions come from, and draws."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.joint_models import registry
from errormodel.machine_file import library, read_machine
from identification.plots import style
from identification.plots.chain_drawing import draw_chain
from tests.helpers.nightly import first_of

MACHINES = sorted(library())


def texts(svg: Path) -> set[str]:
    return {
        "".join(node.itertext()).strip() for node in ElementTree.parse(svg).iter("{http://www.w3.org/2000/svg}text")
    }


def test_the_library_holds_its_nine_machines() -> None:
    assert set(MACHINES) >= {
        "bridge_cmm",
        "five_axis_table_quill",
        "fork_head_five_axis",
        "gantry_crossbeam_ram",
        "h_gantry_dual_drive",
        "horizontal_three_axis",
        "six_axis_arm",
        "trunnion_five_axis",
        "vertical_three_axis",
    }


@pytest.mark.parametrize("name", MACHINES)
def test_a_machine_names_its_source_and_its_elements(name: str) -> None:
    machine = read_machine(name)
    assert machine.notes.startswith("Source: ")
    assert len(machine.notes) > 300
    for shape in machine.shapes:  # the notes say what each member is
        assert shape.name in machine.notes or "T1 to T5" in machine.notes


@pytest.mark.parametrize("name", first_of(MACHINES, 4))
def test_a_drawing_labels_every_element(name: str, tmp_path: Path) -> None:
    machine, path = read_machine(name), tmp_path / "chain.svg"
    style.save(draw_chain(machine), path)
    labels = texts(path)
    assert {machine.name, "workpiece", "tool point", *(e.name for e in machine.elements)} <= labels
    for parameter in Chain(machine).parameters:
        assert not parameter.symbol or any(parameter.symbol in label.split() for label in labels)


def test_a_drawing_is_the_same_bytes_twice(tmp_path: Path) -> None:
    machine = read_machine("six_axis_arm")
    for suffix in (".svg", ".png"):
        first, second = tmp_path / f"1{suffix}", tmp_path / f"2{suffix}"
        style.save(draw_chain(machine), first)
        style.save(draw_chain(machine), second)
        assert first.read_bytes() == second.read_bytes() != b""


def test_the_library_uses_every_error_model() -> None:
    kinds = {b.kind for name in MACHINES for joint in read_machine(name).joints for b in joint.models.values()}
    assert {"first-order", "polynomial", "harmonic", "spline"} <= kinds <= set(registry())


def test_the_five_axis_paper_has_52_parameters() -> None:
    assert len(Chain(read_machine("five_axis_table_quill")).machine_ids) == 52


@pytest.mark.parametrize("name", ["vertical_three_axis", "trunnion_five_axis", "horizontal_three_axis"])
def test_the_offsets_close(name: str) -> None:
    machine = read_machine(name)
    command = {joint.name: 0.0 if joint.type == "rotary" else 100.0 + 7 * k for k, joint in enumerate(machine.joints)}
    nose = Chain(machine).frames(command)[-1, :3, 3]
    np.testing.assert_allclose(nose, [command["X"], command["Y"], command["Z"]])


def test_the_arm_has_the_published_kinematics() -> None:
    """Against the maker's Denavit-Hartenberg table (d, a in mm, alpha in quarter turns)."""
    table = [(127.3, 0, 1), (0, -612, 0), (0, -572.3, 0), (163.941, 0, 1), (115.7, 0, -1), (92.2, 0, 0)]
    angles = [0.3, -1.1, 0.7, 2.0, -0.4, 1.3]
    pose = np.eye(4)
    for theta, (d, a, quarters) in zip(angles, table, strict=True):
        c, s = math.cos(theta), math.sin(theta)
        turned = np.array([[1, 0, 0], [0, 1 - abs(quarters), -quarters], [0, quarters, 1 - abs(quarters)]])
        step = np.eye(4)
        step[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ turned
        step[:3, 3] = [a * c, a * s, d]
        pose = pose @ step
    chain = Chain(read_machine("six_axis_arm"))
    flange = chain.frames({f"J{k + 1}": angle for k, angle in enumerate(angles)})[-1]
    np.testing.assert_allclose(flange[:3, 3], pose[:3, 3], atol=1e-9)
    np.testing.assert_allclose(-flange[:3, 1], pose[:3, 2], atol=1e-12)  # the flange's axis, J6
