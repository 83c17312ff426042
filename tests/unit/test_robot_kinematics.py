"""Descriptions of robots against forward kinematics that share no code with the product: to 1e-6 mm, as asked for.

What is really left is rounding: 1e-11 mm for machines of some metres.
"""

from __future__ import annotations

import itertools
import math
import re

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from pytransform3d.urdf import UrdfTransformManager

from errormodel.arrays import Array, rotation_matrix
from errormodel.machine import Joint, Machine, Shape
from errormodel.machine_formats.base import Extras, registry
from errormodel.machine_formats.transforms import rotation_angles, rpy_angles, rpy_matrix
from tests.helpers.nightly import first_of
from tests.helpers.robots import ROBOTS, Table, frames, joint, positions, product, read_text, robot

EXACT_MM = 1e-6
EXACT_RAD = 1e-9  # of the elements of a rotation; a metre of tool then adds 1e-6 mm
POSES = 50


def same(found: Array, expected: Array) -> None:
    assert np.abs(found[:, :3, 3] - expected[:, :3, 3]).max() < EXACT_MM
    assert np.abs(found[:, :3, :3] - expected[:, :3, :3]).max() < EXACT_RAD


def rewritten(machine: Machine, form: str, suffix: str = ".csv") -> tuple[Machine, Array]:
    """The machine as it reads after it was written, and what the file leaves to the last frame."""
    done = registry()[form].write(machine, suffix, Extras("a robot"))
    return read_text(done.text, form), np.eye(4) if done.end is None else done.end


# ---- tables


@pytest.mark.parametrize("name", ROBOTS)
def test_published_tables_give_the_frames_of_their_textbooks(name: str) -> None:
    table = ROBOTS[name]
    machine = read_text(table.csv(), table.form)
    q = positions(machine.joints, POSES)
    same(frames(machine, q), product(table, q))


@pytest.mark.parametrize("suffix", first_of([".csv", ".yaml"]))
@pytest.mark.parametrize(("name", "form"), list(itertools.product(ROBOTS, ["dh", "dh-modified", "urdf"])))
def test_published_robots_survive_every_format(name: str, form: str, suffix: str) -> None:
    table = ROBOTS[name]
    machine = read_text(table.csv(), table.form)
    back, end = rewritten(machine, form, suffix)
    q = positions(machine.joints, POSES, seed=1)
    same(frames(back, q) @ end, product(table, q))
    assert [j.name for j in back.joints] == [j.name for j in machine.joints]
    assert [j.type for j in back.joints] == [j.type for j in machine.joints]
    np.testing.assert_allclose([j.travel for j in back.joints], [j.travel for j in machine.joints], rtol=1e-12)


@pytest.mark.parametrize("name", [n for n, t in ROBOTS.items() if not (t.modified or t.slides)])
def test_a_published_table_is_written_as_it_was_published(name: str) -> None:
    """Where a table is unique: common normals, the direction of x with the smaller theta; a slide has no place."""
    table = ROBOTS[name]
    text = registry()["dh"].write(read_text(table.csv(), "dh"), ".csv", Extras()).text
    rows = [line.split(",") for line in text.splitlines() if re.match(r"J\d", line)]
    assert len(rows) == len(table.a) == len(text.splitlines()) - 3  # two comments and the names: no tool
    found = np.array([[float(v) for v in row[2:6]] for row in rows])
    for k, key in enumerate(("a", "alpha", "d", "theta")):
        np.testing.assert_allclose(found[:, k], getattr(table, key), atol=1e-9, err_msg=key)


def test_the_simulated_arm_of_its_maker_stands_where_the_maker_says() -> None:
    """Positions of the flange that the tests of ur_calibration have from the simulator of Universal Robots (m, rad)."""
    quarter = math.degrees(1.570796327)  # what that simulator takes for 90 degrees
    table = ROBOTS["UR10"]
    table = Table("", table.a, (quarter, 0, 0, quarter, -quarter, 0), table.d, table.theta)
    q = [
        (-1.6007002035724084977, -1.7271001974688928726, -2.2029998938189905289, -0.80799991289247685700,
         1.59510004520416259766, -0.03099996248354131012),
        (1.32645022869110107422, 2.42600774765014648438, 5.95157289505004882812, 1.27409040927886962891,
         -0.54105216662561138825, 0.12217304855585098267),
    ]  # fmt: skip
    places = [
        (-0.179925914147547, -0.606869755162764, 0.230789102067257),
        (0.39922988003280424, 0.59688365069340565, -0.66778190402763750),
    ]
    machine = read_text(table.csv(), "dh")
    found = frames(machine, np.array(q))[:, :3, 3]
    assert np.abs(found - 1e3 * np.array(places)).max() < EXACT_MM
    back, end = rewritten(machine, "ur-calibration")
    assert np.abs((frames(back, np.array(q)) @ end)[:, :3, 3] - 1e3 * np.array(places)).max() < EXACT_MM


# as the documentation of ur_calibration prints them of a robot: its maker's own calibration, m and rad
CALIBRATED = Table(
    "Universal_Robots_ROS2_Driver, ur_calibration/doc/algorithm.rst",
    [1e3 * v for v in (2.12234865571206e-05, 0.0193171326277006, -0.569251663611088, -4.61409023720934e-05,
                       -6.39280053471802e-05, 0)],
    [math.degrees(v) for v in (1.57014608044242, 0.0013941666682559, 0.00693818880325995, 1.56998468543761,
                               -1.57038520649543, 0)],
    [1e3 * v for v in (0.180539811714259, 439.140974079901, -446.027059806332, 7.0603368964236, 0.119811341150314,
                       0.115670917257426)],
    [math.degrees(v) for v in (-2.4147806894359e-07, 1.60233952386695, -1.68607190752171, 0.0837331147700119,
                               -1.01260355871158e-07, 3.91986209186124e-08)],
)  # fmt: skip


def test_an_arm_whose_own_calibration_has_members_of_439_m_gets_members_of_its_size() -> None:
    """Common normals of axes that are parallel to a milliradian run away; Hayati's parameters stay where the arm is."""
    machine = read_text(CALIBRATED.csv(), "dh")
    q = positions(machine.joints, POSES)
    expected = product(CALIBRATED, q)
    same(frames(machine, q), expected)
    for form in ("dh", "dh-modified", "ur-calibration"):
        back, end = rewritten(machine, form)
        same(frames(back, q) @ end, expected)
        assert max(abs(v) for s in back.shapes for v in s.offset) < 620, form  # mm; the upper arm of a UR10e: 612.7
    assert "beta [deg]" in registry()["dh"].write(machine, ".csv", Extras()).text


UR30 = """kinematics:
  shoulder: {x: 0, y: 0, z: 0.23630000000000001, roll: -0, pitch: 0, yaw: -0}
  upper_arm: {x: 0, y: 0, z: 0, roll: 1.570796327, pitch: 0, yaw: -0}
  forearm: {x: -0.637, y: 0, z: 0, roll: -0, pitch: 0, yaw: -0}
  wrist_1: {x: -0.5037, y: 0, z: 0.20100000000000001, roll: -0, pitch: 0, yaw: -0}
  wrist_2: {x: 0, y: -0.1593, z: 0, roll: 1.570796327, pitch: 0, yaw: -0}
  wrist_3: {x: 0, y: 0.15429999999999999, z: -3.1647459019915597e-11, roll: 1.5707963265897931,
            pitch: 3.1415926535897931, yaw: 3.1415926535897931}
  hash: calib_4890363823803256388
"""  # config/ur30/default_kinematics.yaml of Universal_Robots_ROS2_Description


def test_a_file_of_the_maker_is_read_and_comes_back_as_it_was() -> None:
    """Against the maker's table of the same arm; its angles have ten digits, which are kept (1e-10 rad)."""
    machine = read_text(UR30)
    quarter = math.degrees(1.570796327)
    table = Table("", (0, -637, -503.7, 0, 0, 0), (quarter, 0, 0, quarter, -quarter, 0),
                  (236.3, 0, 0, 201, 159.3, 154.3), (0,) * 6)  # fmt: skip
    q = positions(machine.joints, POSES)
    same(frames(machine, q), product(table, q))
    text = registry()["ur-calibration"].write(machine, ".yaml", Extras("", "calib_4890363823803256388")).text
    one, two = (yaml.safe_load(t)["kinematics"] for t in (UR30, text))
    assert one.pop("hash") == two.pop("hash")
    for member, own in one.items():
        assert [two[member][k] for k in "xyz"] == pytest.approx([own[k] for k in "xyz"], abs=1e-10), (
            member
        )  # m: its own digits
        before, after = (rpy_matrix([link[member][k] for k in ("roll", "pitch", "yaw")]) for link in (one, two))
        assert np.abs(before - after).max() < 1e-12, member


@pytest.mark.long
@settings(max_examples=60)
@given(st.data())
def test_any_chain_survives_every_format(data: st.DataObject) -> None:
    machine = data.draw(chains())
    q = positions(machine.joints, 5)
    expected = frames(machine, q)
    for form in ("urdf", "dh", "dh-modified"):
        back, end = rewritten(machine, form, data.draw(st.sampled_from([".csv", ".yaml"])))
        same(frames(back, q) @ end, expected)
    if [j.type for j in machine.joints] == ["rotary"] * 6:
        back, end = rewritten(machine, "ur-calibration")
        same(frames(back, q) @ end, expected)


@st.composite
def chains(draw: st.DrawFn) -> Machine:
    """Chains with right angles, parallel axes, axes that are so but for an error, and any others."""
    small = st.floats(-2e-3, 2e-3)
    angle = st.one_of(st.sampled_from([0.0, math.pi / 2, -math.pi / 2, math.pi]), small, st.floats(-3.1, 3.1))
    length = st.one_of(st.just(0.0), small, st.floats(-900, 900))
    elements: list[Shape | Joint] = []
    for k in range(draw(st.integers(1, 7))):
        elements.append(Shape(f"L{k}", draw(st.tuples(length, length, length)), draw(st.tuples(angle, angle, angle))))
        kind = draw(st.sampled_from(["rotary", "rotary", "prismatic"]))
        axis = draw(st.sampled_from([(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.0, -0.8)]))
        elements.append(Joint(f"J{k}", kind, axis, (-300.0, 500.0) if kind == "prismatic" else (-3.0, 3.0)))
    elements.append(Shape("end", draw(st.tuples(length, length, length)), draw(st.tuples(angle, angle, angle))))
    return Machine("a robot", tuple(elements))


# ---- URDF

ORIGINS = (
    '<origin xyz="0 0 0.4" rpy="0.3 -0.2 0.1"/><axis xyz="0 0 1"/>',
    '<origin xyz="0.1 -0.05 0.3" rpy="1.5707963267948966 0 -1.5707963267948966"/><axis xyz="0 -1 0"/>',
    '<origin xyz="0.025 0 0" rpy="0 1.5707963267948966 0.7"/>',  # no axis: x
    '<origin rpy="-2.5 0.4 3.0"/><axis xyz="0.57735026919 0.57735026919 -0.57735026919"/>',
)


def serial() -> str:
    return robot(
        joint("mount", "world", "base", "fixed", '<origin xyz="1 2 3" rpy="0 0 3.141592653589793"/>'),
        joint("pan", "base", "shoulder", "revolute", ORIGINS[0]),
        joint("lift-joint", "shoulder", "upper arm", "continuous", ORIGINS[1]),
        joint("sleeve", "upper arm", "inner", "fixed", ORIGINS[3]),
        joint("slide", "inner", "carriage", "prismatic", ORIGINS[2]),
        joint("roll", "carriage", "wrist", "revolute", ORIGINS[3]),
        joint("flange", "wrist", "tool0", "fixed", '<origin xyz="0 0 0.1" rpy="0 -1.5707963267948966 0.5"/>'),
    )


def by_pytransform3d(text: str, joints: list[str], tip: str, base: str, q: Array) -> Array:
    """Frames of the tip by pytransform3d, which reads a URDF with code of its own; mm."""
    manager = UrdfTransformManager()
    manager.load_urdf(text)
    out = []
    for row in q:
        for name, value in zip(joints, row, strict=True):
            manager.set_joint(name, value)
        frame = np.array(manager.get_transform(tip, base))
        frame[:3, 3] *= 1e3
        out.append(frame)
    return np.array(out)


def test_a_urdf_has_the_frames_that_another_reader_gives_it() -> None:
    machine = read_text(serial())
    q = positions(machine.joints, POSES)
    metres = q * [1, 1, 1e-3, 1]
    names = ["pan", "lift-joint", "slide", "roll"]
    same(frames(machine, q), by_pytransform3d(serial(), names, "tool0", "world", metres))
    part = read_text(serial(), base="shoulder", tip="wrist")
    same(frames(part, q[:, 1:]), by_pytransform3d(serial(), names, "wrist", "shoulder", metres))


def test_what_is_written_has_the_frames_that_another_reader_gives_it() -> None:
    machine = read_text(serial())
    text = registry()["urdf"].write(machine, ".urdf", Extras("<a> -- robot")).text
    q = positions(machine.joints, POSES, seed=2)
    names = [j.name for j in machine.joints]
    found = by_pytransform3d(text, names, "flange", "world", q * [1, 1, 1e-3, 1])
    same(frames(machine, q), found)


def test_names_types_and_limits_of_a_urdf_are_kept() -> None:
    machine = read_text(serial())
    assert [j.name for j in machine.joints] == ["pan", "lift_joint", "slide", "roll"]
    assert [s.name for s in machine.shapes] == ["world", "shoulder", "upper_arm", "carriage", "wrist"]
    assert [j.type for j in machine.joints] == ["rotary", "rotary", "prismatic", "rotary"]
    assert [j.travel for j in machine.joints] == [
        (-1.5, 2.5), (-math.pi, math.pi), (-1500.0, 2500.0), (-1.5, 2.5)
    ]  # fmt: skip


@given(st.tuples(*[st.floats(-math.pi, math.pi)] * 3), st.sampled_from([None, math.pi / 2, -math.pi / 2]))
def test_angles_give_the_rotation_that_they_are_of(angles: tuple[float, ...], pitch: float | None) -> None:
    """At a pitch of 90 degrees too, where usual formulas lose half of the digits."""
    roll, middle, yaw = angles
    for near in (0.0, 1e-9, 1e-7, 1e-5):
        turned = rpy_matrix((roll, middle if pitch is None else pitch + near, yaw))
        assert np.abs(rpy_matrix(rpy_angles(turned)) - turned).max() < 1e-14
        assert np.abs(rotation_matrix(rotation_angles(turned)) - turned).max() < 1e-14
