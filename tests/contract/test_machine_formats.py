"""Descriptions that cannot be read are refused in one sentence: where, what was found, what to write instead."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from errormodel import library
from errormodel.exceptions import InputError
from errormodel.machine_file import read_machine
from errormodel.machine_formats.base import Extras, nominal, registry
from errormodel.machine_formats.transforms import inverse, links_of
from tests.helpers.commands import run, tree, write
from tests.helpers.robots import ROBOTS, frames, joint, positions, read_text, robot

BOMB = (
    '<?xml version="1.0"?><!DOCTYPE robot [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
    '<robot name="&b;"/>'
)
FETCH = '<!DOCTYPE robot SYSTEM "file:///etc/passwd"><robot name="x"/>'
ONE = joint("J1", "base", "arm", "revolute", '<axis xyz="0 0 1"/>')
UR = "kinematics:\n" + "".join(
    f"  {name}: {{x: 0, y: 0, z: 0.1, roll: 0, pitch: 0, yaw: 0}}\n"
    for name in ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
)
TABLE = "convention: standard\nrows:\n  - {joint: J1, a: 1, alpha: 90, d: 2, theta: 0}\n"

WRONG: dict[str, tuple[str, str, tuple[str, ...]]] = {
    # name: format asked for, content, what the message says
    "prose": ("", "an arm of six joints\n", ("no description of a machine", "an arm of six", "--format urdf")),
    "a survey": ("", "X,Y,mx,my,mz\n1,2,3,4,5\n", ("no description of a machine", "Give a")),
    "no such format": ("udrf", "<robot/>", ("'udrf'", "Did you mean 'urdf'")),
    "entities": ("", BOMB, ("line 1", "a document type or an entity", "Remove it")),
    "a file to fetch": ("", FETCH, ("a document type or an entity",)),
    "broken XML": ("", robot(ONE).replace("</robot>", "</robt>"), ("line 5", "no XML", "mismatched tag")),
    "deep XML": ("", "<robot>" + "<a>" * 200, ("more than 100 levels",)),
    "xacro": (
        "", '<robot xmlns:xacro="x"><xacro:include filename="a"/></robot>', ("line 1", "not expanded", "xacro FILE >")
    ),
    "an expression": ("", robot(ONE).replace('"0 0 1"', '"0 0 ${one}"'), ("not expanded here",)),
    "another XML": ("urdf", "<svg/>", ("<svg>", "Give a URDF")),
    "no joints": ("", robot(links=["a"]), ("no <joint>",)),
    "no child": ("", robot(ONE).replace('<child link="arm"/>', ""), ("line 4, joint J1", "no <child>", "Write <child")),
    "no name": ("", robot(ONE).replace('name="J1" ', ""), ("<joint> without name",)),
    "a type": ("", robot(ONE).replace("revolute", "revolut"), ("'revolut'", "Did you mean 'revolute'")),
    "ends": (
        "", robot(ONE, joint("J2", "arm", "left"), joint("J3", "arm", "right")), ("2 ends: left, right", "--tip")
    ),
    "roots": ("", robot(ONE, joint("J2", "floor", "other")), ("2 links that no joint carries: base, floor", "--base")),
    "two parents": ("", robot(ONE, joint("J2", "floor", "arm")), ("'arm' hangs on two joints", "loop")),
    "a circle": (
        "", robot(joint("A", "x", "y"), joint("B", "y", "x")), ("joints in a loop",)
    ),
    "mimic": (
        "", robot(ONE.replace("<axis", '<mimic joint="J0" multiplier="2"/><axis')), ("it mimics 'J0'", "--base")
    ),
    "floating": ("", robot(joint("J0", "world", "base", "floating"), ONE), ("a floating joint", "--base behind it")),
    "planar": ("", robot(joint("J0", "world", "base", "planar"), ONE), ("a planar joint",)),
    "only fixed": ("", robot(joint("J0", "world", "base", "fixed")), ("no joint that moves from 'world'",)),
    "an axis": ("", robot(ONE).replace('"0 0 1"', '"0 0 2"'), ("an axis of length 2", 'here xyz="0 0 1"')),
    "one name for two joints": (
        "", robot(ONE, joint("J1", "arm", "hand", "revolute", '<axis xyz="0 0 1"/>')), ("two joints", "called 'J1'")
    ),
    "no axis": ("", robot(ONE).replace('"0 0 1"', '"0 0 0"'), ("an axis of length 0",)),
    "two numbers": ("", robot(ONE).replace('"0 0 1"', '"0 1"'), ('xyz="0 1"', "three numbers")),
    "no number": ("", robot(joint("J1", "a", "b", "revolute", '<origin rpy="0 nan 0"/>')), ('rpy="0 nan 0"',)),
    "no limits": ("", robot(joint("J1", "a", "b", "endless").replace("endless", "revolute")), ("without limits",)),
    "limits": ("", robot(ONE).replace('"-1.5"', '"3"'), ("limits from 3 to 2.5", "lower below upper")),
    "an origin in degrees": (
        "", robot(joint("J1", "a", "b", "revolute", '<origin rpy_deg="0 0 90"/>')), ('rpy_deg="0 0 90"', 'rpy="..."')
    ),
    "degrees as rad": ("", robot(joint("J1", "a", "b", "revolute", '<origin rpy="0 0 90"/>')), ("two turns", "in rad")),
    "two origins": ("", robot(ONE.replace("<axis", '<origin/><origin xyz="0 0 1"/><axis')), ("<origin> more than",)),
    "thousands of joints": (
        "", robot(*(joint(f"J{k}", f"l{k}", f"l{k + 1}", "continuous") for k in range(3000))), ("more than 150 joints",)
    ),
    "thousands of ends": (
        "", robot(*(joint(f"J{k}", f"l{k}", f"l{k + 1}", "fixed") for k in range(4000)),
                  *(joint(f"E{k}", f"l{k}", f"e{k}", "fixed") for k in range(4000))), ("4001 ends", "--tip")
    ),
    "either table": ("", ROBOTS["UR10"].csv(), ("may be read as", "--format dh")),
    "the other convention": ("dh-modified", TABLE, ("'standard', read as modified",)),
    "no alpha": ("dh", "a,d,theta\n1,2,3\n1,2,3\n", ("no column 'alpha'", "a, alpha, d and theta")),
    "a symbol": ("dh", "a,alpha,d,theta\n1,90,2,q1\n1,90,2,q2\n", ("column theta", "'q1'", "constant part")),
    "a column": (
        "dh", "a,alpha,d,theta,gamma\n1,90,2,0,0\n1,90,2,0,0\n", ("column gamma", "no parameter", "a, alpha, beta, d")
    ),
    "a short row": (
        "dh", "joint,a,alpha,d,theta\nA,1,90,20,0\nB,1,90,20,0\nC,1,90\n", ("line 4", "'C,1,90' below the table")
    ),
    "no value": ("dh", "a,alpha,d,theta\n1,90,nan,0\n1,90,20,0\n", ("line 2, column d", "'nan'", "the number")),
    "lengths in m": ("dh", "a,alpha,d,theta\n0.6,90,0.1,0\n0,90,0,0\n", ("up to 0.6 without a unit", "a [m]")),
    "angles in rad": ("dh", "a,alpha,d,theta\n600,1.57,100,0\n0,0,0,0\n", ("up to 1.57 without a unit", "[rad]")),
    "angles in rad in YAML": ("", TABLE.replace("90", "1.57").replace("2,", "20,"), ("1.57", "units: {length: m")),
    "degrees in rad": ("dh", "a,alpha [rad],d,theta\n600,90,100,0\n0,0,0,0\n", ("line 2, alpha", "14.3 turns")),
    "300 rows": ("dh", "a,alpha,d,theta\n" + 300 * "1,90,20,0\n", ("300 rows", "at most 100")),
    "mm as m": ("", UR.replace("z: 0.1", "z: 100"), ("key kinematics.shoulder", "100 m", "less than 1 m")),
    "infinite": ("dh", "a,alpha,d,theta\n1,90,inf,0\n1,90,2,0\n", ("line 2, d", "inf", "robot's size")),
    "huge": ("", TABLE.replace("d: 2", "d: 1e12"), ("line 3, d", "1e+12", "robot's size")),
    "a unit": ("dh", "a [deg],alpha,d,theta\n1,90,2,0\n1,90,2,0\n", ("column a", "the unit 'deg'", "length")),
    "radians without a unit": (
        "dh", "a,alpha,d,theta\n100,1.570796,2,0\n1,0,2,0\n", ("up to 1.5708 without a unit", "alpha [rad]")
    ),
    "metres without a unit": ("dh", "a,alpha,d,theta\n0.4,90,0.2,0\n1,0,2,0\n", ("up to 2 without a unit", "a [m]")),
    "the unit of a travel": (
        "dh", "a,alpha,d,theta,low [mm],high [mm]\n400,90,2,0,-1,1\n1,0,2,0,-1,1\n", ("column low", "is an angle")
    ),
    "a joint type": ("dh", "type,a,alpha,d,theta\nscrew,1,90,2,0\nrotary,1,90,2,0\n", ("line 2, type", "'screw'")),
    "twice": ("dh", "joint,a,alpha,d,theta\nA,1,90,2,0\nA,1,90,2,0\n", ("two joints 'A'",)),
    "a slide": ("dh", "type,a,alpha,d,theta\nprismatic,1,90,2,0\nrotary,1,90,2,0\n", ("no travel of the slide J1",)),
    "nothing moves": ("dh", "type,a,alpha,d,theta\nfixed,1,90,2,0\nfixed,1,90,2,0\n", ("no joint",)),
    "an unknown key": ("", TABLE.replace("theta", "thete"), ("line 3", "unknown key 'thete'", "theta")),
    "a word": ("", TABLE.replace("90", "right"), ("line 3", "rows[1].alpha", "an angle")),
    "travel": ("", TABLE.replace("theta: 0", "travel: [5, 5]"), ("line 3", "a travel from", "lowest first")),
    "half an arm": ("", UR.replace("  wrist_3", "  wrist_4"), ("wrist_4", "wrist_3")),
    "no roll": ("", UR.replace("roll: 0, ", "", 1), ("shoulder", "'roll' is missing", "an angle in rad")),
    "not text": ("", "\x00\x01\x02", ("bytes that are no text", "Give a text file")),
    "empty": ("", " \n", ("an empty file",)),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_with_a_description_is_said(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    form, text, words = WRONG[name]
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "robot.txt", text)
    before = tree(tmp_path)
    asked = ("--format", form) if form else ()
    result = run("machine", "robot.txt", *asked, "--out", "m.yaml")
    assert (result.code, result.out) == (2, ""), result.out
    assert result.err.count("\n") == 1, result.err
    assert all(w.lower() in result.err.lower() for w in words), result.err
    assert tree(tmp_path) == before


@pytest.mark.parametrize("identity", ["a #b", "1e5", "true", "x: [1", "b\nkinematics2: 1", "calib_12345", "'"])
def test_an_identifier_is_read_back_as_it_was_given(identity: str, tmp_path: Path) -> None:
    arm = write(tmp_path / "arm.yaml", UR)
    assert run("machine", arm, "--out", tmp_path / "m.yaml").code == 0
    words = ("export", tmp_path / "m.yaml", "--hash", identity)
    assert run(*words, "--format", "ur-calibration", "--out", tmp_path / "c.yaml").code == 0
    assert yaml.safe_load((tmp_path / "c.yaml").read_text())["kinematics"]["hash"] == identity
    result = run(*words, "--format", "urdf", "--out", tmp_path / "c.urdf")
    assert result.code == 2
    assert "a URDF holds no identifier" in result.err
    assert not (tmp_path / "c.urdf").exists()


OPTIONS = {
    "no such link": (("--tip", "arn"), ("--tip", "no link 'arn'", "Did you mean 'arm'")),
    "a base beside the way": (("--base", "left", "--tip", "right"), ("'left' is not on the way from 'right'",)),
    "the base as tip": (("--base", "arm", "--tip", "arm"), ("'arm' is not on the way",)),
    "too few names": (("--tip", "left", "--joints", "A"), ("1 names (A) for 2 joints (J1, J2)",)),
    "a name twice": (("--tip", "left", "--joints", "A,A"), ("2 names", "of its own")),
    "a name that no joint has": (("--tip", "left", "--joints", "feed,B"), ("the name 'feed'", "--joints")),
    "an infinite tool": (("--tip", "left", "--tool", "inf", "0", "0"), ("--tool", "finite")),
}


@pytest.mark.parametrize("name", OPTIONS)
def test_what_is_wrong_with_an_option_is_said(name: str, tmp_path: Path) -> None:
    options, words = OPTIONS[name]
    path = write(tmp_path / "a.urdf", robot(ONE, joint("J2", "arm", "left"), joint("J3", "arm", "right")))
    result = run("machine", path, *options)
    assert (result.code, result.out) == (2, "")
    assert all(w in result.err for w in words), result.err


@pytest.mark.parametrize("form", registry())
@pytest.mark.parametrize("name", library())
def test_every_machine_of_the_library_survives_every_format(name: str, form: str) -> None:
    """All that a format holds; a format that cannot hold a machine says so."""
    machine = nominal(read_machine(name))
    try:
        done = registry()[form].write(machine, ".csv", Extras("heading", "calib_1"))
    except InputError as error:
        assert "six rotary joints" in str(error)  # noqa: PT017
        assert len(machine.joints) != 6
        return
    back = read_text(done.text, form)
    q = positions(machine.joints, 20)
    found = frames(back, q) if done.end is None else frames(back, q) @ done.end
    expected = frames(machine, q)
    assert abs(found[:, :3] - expected[:, :3]).max() < 1e-9  # mm: rounding of machines of some metres
    assert registry()[form].write(machine, ".csv", Extras("heading", "calib_1")).text == done.text


def test_a_member_before_the_first_joint_is_left_out_where_it_is_nothing() -> None:
    plain = read_text(robot(ONE))
    moved = read_text(robot(ONE.replace("<axis", '<origin xyz="0 0 1"/><axis')))
    assert [e.name for e in plain.elements] == ["J1", "arm"]
    assert [e.name for e in moved.elements] == ["base", "J1", "arm"]
    fixed = links_of(moved).fixed[0]
    assert (inverse(fixed) @ fixed == frames(plain, positions(plain.joints, 1) * 0)[0]).all()


def test_numbers_of_another_unit_are_said(tmp_path: Path) -> None:
    """A URDF has no units: a limit of 170 rad, and a member of 350 m, can be meant, and hardly are."""
    text = robot(ONE.replace('"2.5"', '"170"'), joint("J2", "arm", "hand", "revolute", '<origin xyz="350 0 0"/>'))
    result = run("machine", write(tmp_path / "a.urdf", text), "--out", tmp_path / "m.yaml")
    assert result.code == 0
    assert "J1 turns up to 27.1 times around by its limits" in result.err
    assert "the member arm is 350 m long" in result.err
    plain = run("machine", write(tmp_path / "b.urdf", robot(ONE)), "--out", tmp_path / "b.yaml")
    assert "in a URDF" not in plain.err


@pytest.mark.parametrize("form", registry())
def test_every_format_says_what_it_is(form: str) -> None:
    kind = registry()[form]
    assert kind.title[:2] == "a "
    assert kind.source
    assert (kind.__doc__ or "").strip()


def test_what_was_read_with_a_doubt_is_noted(tmp_path: Path) -> None:
    """Names that a machine's file cannot have, joints without end, axes whose digits were cut, missing travels."""
    turning = joint("J-1", "base link", "arm", "continuous", '<axis xyz="0.577 0.577 0.577"/>')
    result = run("machine", write(tmp_path / "a.urdf", robot(turning)), "--out", tmp_path / "m.yaml")
    assert result.code == 0
    for words in ("'J-1' is called J_1 here", "-180 to 180 degrees", "the axis of J-1 has length 0.999"):
        assert words in result.err
    table = write(
        tmp_path / "t.csv", "joint,a [m],alpha [rad],d [m],theta\n1,0.1,1.5707963267948966,0.2,0\n2,0,0,0,0\n"
    )
    result = run("machine", table, "--format", "dh", "--out", tmp_path / "t.yaml")
    assert "J1: no travel stated" in result.err
    machine = read_machine(tmp_path / "t.yaml")
    assert machine.shapes[0].offset == (100.0, 0.0, 200.0)
    assert [j.name for j in machine.joints] == ["J1", "J2"]


def test_ends_of_travels_have_the_unit_of_their_own_column(tmp_path: Path) -> None:
    """Angles in radians beside limits in degrees, and limits without a unit, which are in that of theta."""
    for unit, low in ((" [deg]", -180), (" [rad]", -np.pi), ("", -np.pi)):
        head = f"joint,a [m],alpha [rad],d [m],theta [rad],low{unit},high{unit}\n"
        table = write(tmp_path / "t.csv", f"{head}1,0.1,1.5707963,0.2,0,{low!r},1\n2,0.3,0,0,0,{low!r},1\n")
        assert run("machine", table, "--format", "dh", "--out", tmp_path / "t.yaml").code == 0
        assert read_machine(tmp_path / "t.yaml").joints[0].travel[0] == pytest.approx(-np.pi, rel=1e-12)
        (tmp_path / "t.yaml").unlink()


WHOLE = [
    robot(ONE, joint("J2", "arm", "left", "prismatic", '<origin xyz="0 1 2" rpy="1 2 3"/><axis xyz="0 1 0"/>')),
    UR,
    TABLE,
    "# convention: modified\n" + ROBOTS["UR10"].csv(),
    "# convention: standard\n" + ROBOTS["Stanford arm"].csv(),
]
SCRAPS = ["", "0", "-1", "1e400", "nan", "inf", '"', "<", ">", "&", "{", "[", "]", "}", ":", ",", ";", "\n", "\t", "é"]


@settings(max_examples=60)
@given(st.data())
def test_a_damaged_description_is_read_or_refused(data: st.DataObject) -> None:
    """Whatever a file has become: a machine of finite numbers, or a sentence; never an error of a library."""
    text = data.draw(st.sampled_from(WHOLE))
    for _ in range(data.draw(st.integers(1, 3))):
        first = data.draw(st.integers(0, len(text)))
        last = first + data.draw(st.sampled_from([0, 1, 2, 5, 20]))
        text = text[:first] + data.draw(st.sampled_from(SCRAPS)) + text[last:]
    try:
        machine = read_text(text)
    except InputError:  # a sentence
        return
    assert all(np.isfinite([*s.offset, *s.rotation]).all() for s in machine.shapes)
    assert all(np.isfinite([*j.axis, *j.travel]).all() for j in machine.joints)
