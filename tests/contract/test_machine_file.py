"""machine.yaml: what it means, and what is said when it is wrong."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from errormodel import machine_file as schema
from errormodel.conventions import MOTIONS
from errormodel.exceptions import InputError
from errormodel.machine import Basis, EffectSpec, Machine
from tests.helpers.machine_files import EXAMPLE, PLAIN, read


def refusal(text: str) -> InputError:
    with pytest.raises(InputError) as caught:
        read(text)
    return caught.value


def element(machine: Machine, name: str):
    return next(e for e in machine.elements if e.name == name)


def poly(n: int) -> Basis:
    return Basis("polynomial", n)


# What a file means


def test_example():
    machine = read(EXAMPLE)
    assert [e.name for e in machine.elements] == ["B", "T1", "X", "T2", "Z", "T3", "W"]
    assert element(machine, "B").travel == pytest.approx((0, 2 * math.pi))
    assert element(machine, "X").travel == (-1250, 1250)
    assert element(machine, "Z").axis == (0, 0, -1)
    assert element(machine, "W").axis == pytest.approx((0, 0.6, 0.8))
    assert element(machine, "T2").rotation == pytest.approx((0, 0, math.pi / 2))
    assert machine.tool == (0, 0, -312.035)
    assert [s.motions for s in machine.shapes] == [("dx", "ea"), MOTIONS, ()]
    assert element(machine, "B").models == dict.fromkeys(MOTIONS, Basis("harmonic", 2))
    assert element(machine, "X").models == dict.fromkeys(["dx", "ea", "eb", "ec"], Basis("first-order"))
    z = {"dx": poly(3), "dy": poly(3), "dz": poly(5), "eb": poly(3), "ec": poly(3)}
    assert element(machine, "Z").models == z
    assert list(element(machine, "Z").models) == list(z)
    first = Basis("first-order")
    assert element(machine, "W").models == {
        "dx": Basis("spline", 4),
        "dz": first,
        "ea": first,
        "eb": first,
        "ec": first,
    }
    assert machine.effects == (EffectSpec("ram-sag", {"joint": "W", "exponent": 2.5}),)
    assert machine.notes == "A note."


def test_without_errors_everything_is_first_order():
    machine = read(PLAIN)
    assert element(machine, "T1").motions == MOTIONS
    assert set(element(machine, "X").models) == {"dx", "ea", "eb", "ec"}
    assert set(element(machine, "C").models) == set(MOTIONS)
    assert machine.name == ""  # a file in no folder has no better name


def test_an_errors_block_holds_what_it_lists():
    machine = read(PLAIN + "errors: {joints: {C: {harmonic: 1}}}\n")
    assert element(machine, "T1").motions == ()
    assert element(machine, "X").models == {}
    assert len(element(machine, "C").models) == 6


def test_one_model_for_all_joints():
    assert element(read(PLAIN + "errors: {joints: {polynomial: 2}}\n"), "C").models["dx"] == poly(2)
    assert element(read(PLAIN + "errors: {joints: first-order}\n"), "C").models["dx"] == Basis("first-order")


@pytest.mark.parametrize(
    ("units", "length", "angle"),
    [
        ("{length: m, angle: rad}", 1000, 1),
        ("{length: inch}", 25.4, math.pi / 180),
        ("{angle: mrad}", 1, 1e-3),
    ],
)
def test_units_are_converted_once(units: str, length: float, angle: float):
    machine = read(PLAIN.replace("100]", "100], rotation: [1, 0, 0]") + f"units: {units}\n")
    assert element(machine, "X").travel == pytest.approx((0, 500 * length))
    assert element(machine, "C").travel == pytest.approx((0, 360 * angle))
    assert element(machine, "T1").offset == pytest.approx((0, 0, 100 * length))
    assert element(machine, "T1").rotation == pytest.approx((angle, 0, 0))
    assert machine.tool == pytest.approx((0, 0, 50 * length))


def test_a_nearly_unit_axis_is_normalised():
    axis = element(read(PLAIN.replace("axis: x", "axis: [0, 0.6, 0.8000001]")), "X").axis
    assert math.hypot(*axis) == pytest.approx(1, abs=1e-15)


def test_aliases_are_read():
    text = PLAIN.replace("[0, 500]", "&t [0, 500]").replace("[0, 360]", "*t")
    assert element(read(text), "X").travel == (0, 500)


# What is said when it is wrong: (what is replaced, by what, line, key, words of the message)

BAD = [
    ("errormodel: 1", "errormodel: 2", 1, "errormodel", ["2", "errormodel: 1"]),
    ("errormodel: 1", "errormodel: true", 1, "errormodel", ["true", "errormodel: 1"]),
    ("errormodel: 1\n", "", 1, "errormodel", ["missing", "Write errormodel: 1"]),
    ("errormodel: 1", "errormodle: 1", 1, "errormodle", ["unknown key", "'errormodel'"]),
    ("tool:", "toll:", 12, "toll", ["unknown key 'toll'", "Did you mean 'tool'"]),
    ("[0, 0, -312.035]", "[0, 0]", 12, "tool", ["[0, 0]", "three numbers"]),
    ("-312.035", "abc", 12, "tool[3]", ["'abc'", "three numbers"]),
    ("-312.035", ".nan", 12, "tool[3]", ["NaN", "three numbers"]),
    ("-312.035", ".inf", 12, "tool[3]", ["Infinity", "three numbers"]),
    ("-312.035", "true", 12, "tool[3]", ["true", "three numbers"]),
    ("-312.035", "1" * 400, 12, "tool[3]", ["111", "three numbers"]),
    ("length: mm", "length: kg", 3, "units.length", ["'kg'", "mm"]),
    ("length: mm", "length: 10**10**10", 3, "units.length", ["a unit of length"]),
    ("angle: deg", "angle: percent", 3, "units.angle", ["'percent'", "deg"]),
    ("angle: deg", "angel: deg", 3, "units.angel", ["Did you mean 'angle'"]),
    ("joint: B,", "jiont: B,", 5, "chain[1]", ["neither", "joint: NAME"]),
    ("joint: B,", "joint: B, shape: S,", 5, "chain[1]", ["both", "Write either"]),
    ("joint: B,", "joint: 1,", 5, "chain[1].joint", ["1", "a name of letters"]),
    ("joint: B,", "joint: B-1,", 5, "chain[1].joint", ["'B-1'", "a name of letters"]),
    ("joint: B,", "joint: T1,", 6, "chain[2].shape", ["already taken in line 5", "another name"]),
    ("joint: B,", "joint: frame,", 5, "chain[1].joint", ["'frame'", "another name"]),
    ("joint: B,", "joint: time,", 5, "chain[1].joint", ["a column of a survey", "another name"]),
    ("joint: B,", "joint: dir_B,", 5, "chain[1].joint", ["a column of a survey", "another name"]),
    ("shape: T1,", "shape: tool,", 6, "chain[2].shape", ["'tool'", "another name"]),
    ("type: rotary,  ", "", 5, "chain[1].type", ["missing", "prismatic or rotary"]),
    ("type: rotary", "type: rotry", 5, "chain[1].type", ["'rotry'", "Did you mean 'rotary'"]),
    ("  travel: [-1250, 1250]", "", 7, "chain[3].travel", ["missing", "[-400, 400]"]),
    ("[-1250, 1250]", "[1250, -1250]", 7, "chain[3].travel", ["[1250, -1250]", "Write travel: [-1250, 1250]"]),
    ("[-1250, 1250]", "[0, 0]", 7, "chain[3].travel", ["does not rise", "lowest"]),
    ("[-1250, 1250]", "[0, .inf]", 7, "chain[3].travel[2]", ["Infinity", "[-400, 400]"]),
    ("[-1250, 1250]", "[0, 1, 2]", 7, "chain[3].travel", ["[0, 1, 2]", "[-400, 400]"]),
    ("axis: x", "axis: X", 7, "chain[3].axis", ["'X'", "Did you mean 'x'"]),
    ("axis: x", "axis: [0, 3, 4]", 7, "chain[3].axis", ["of length 5", "[0, 0.6, 0.8]"]),
    ("axis: x", "axis: [0, 0, 0]", 7, "chain[3].axis", ["[0, 0, 0]", "length 1"]),
    ("axis: x", "axis: [0, true, 0]", 7, "chain[3].axis", ["true", "unit vector"]),
    ("axis: x", "axis: 1", 7, "chain[3].axis", ["1", "unit vector"]),
    ("axis: x", "axis: null", 7, "chain[3].axis", ["nothing", "unit vector"]),
    ("offset: [1, 2, 3]", "ofset: [1, 2, 3]", 10, "chain[6].ofset", ["Did you mean 'offset'"]),
    ("offset: [1, 2, 3]", "offset: 5", 10, "chain[6].offset", ["5", "[0, 0, 150]"]),
    ("shapes: {T1", "shape: {T1", 14, "errors.shape", ["Did you mean 'shapes'"]),
    ("shapes: {T1: [ea, dx], T2: all}", "shapes: some", 14, "errors.shapes", ["'some'", "all, none"]),
    ("T2: all}", "T9: all}", 14, "errors.shapes.T9", ["no shape 'T9'", "Valid: T1, T2, T3"]),
    ("T2: all}", "T2: dx}", 14, "errors.shapes.T2", ["'dx'", "[dx, ea]"]),
    ("[ea, dx]", "[ea, dxx]", 14, "errors.shapes.T1[2]", ["'dxx'", "Did you mean 'dx'"]),
    ("    X: first-order", "    Q: first-order", 17, "errors.joints.Q", ["no joint 'Q'", "Valid: B, W, X, Z"]),
    ("X: first-order", "X: first order", 17, "errors.joints.X", ["'first order'", "Did you mean 'first-order'"]),
    ("X: first-order", "X: polynomial", 17, "errors.joints.X", ["without a number", "{polynomial: 3}"]),
    ("X: first-order", "X:", 17, "errors.joints.X", ["nothing", "first-order"]),
    ("X: first-order", "X: {polynom: 2}", 17, "errors.joints.X.polynom", ["Did you mean 'polynomial'"]),
    ("X: first-order", "X: {harmonic: 2}", 17, "errors.joints.X.harmonic", ["prismatic", "polynomial or spline"]),
    ("X: first-order", "X: {polynomial: 0}", 17, "errors.joints.X.polynomial", ["0", "from 1 to 50"]),
    ("X: first-order", "X: {polynomial: 51}", 17, "errors.joints.X.polynomial", ["51", "from 1 to 50"]),
    ("X: first-order", "X: {polynomial: 2.5}", 17, "errors.joints.X.polynomial", ["2.5", "whole number"]),
    ("X: first-order", "X: {polynomial: true}", 17, "errors.joints.X.polynomial", ["true", "whole number"]),
    ("X: first-order", "X: {exx: 3}", 17, "errors.joints.X.exx", ["3", "first-order"]),
    ("X: first-order", "X: {eyx: first-order}", 17, "errors.joints.X.eyx", ["straightness", "angular rates", "EXX"]),
    ("X: first-order", "X: {exz: none}", 17, "errors.joints.X.exz", ["'exz'", "Did you mean 'ezx'"]),
    ("X: first-order", "X: {exx: none, dx: none}", 17, "errors.joints.X.dx", ["after 'exx'", "one of the two"]),
    ("X: first-order", "X: {spline: 3, polynomial: 2}", 17, "errors.joints.X.polynomial", ["after 'spline'", "one"]),
    ("effect: ram-sag", "effect: ramsag", 21, "effects[1].effect", ["'ramsag'", "Did you mean 'ram-sag'"]),
    ("effect: ram-sag", "effect: [1]", 21, "effects[1].effect", ["[1]", "Valid:"]),
    ("effect: ram-sag, ", "", 21, "effects[1].effect", ["missing", "Write effect"]),
    ("joint: W, exp", "joint: V, exp", 21, "effects[1].joint", ["'V'", "Valid: B, W, X, Z"]),
    ("joint: W, exp", "where: T4, exp", 21, "effects[1].where", ["'T4'", "instrument"]),
    ("notes: A note.", "notes: 3", 22, "notes", ["3", "quotes"]),
    ("notes: A note.", "name: B", 22, "name", ["already given in line 2", "Remove"]),
    ("notes: A note.", "notes: !!python/name:os.system ''", 22, "notes", ["!!python/name:os.system", "Remove"]),
    ("notes: A note.", "notes: !mine x", 22, "notes", ["!mine", "Remove"]),
]


@pytest.mark.parametrize(("old", "new", "line", "key", "words"), BAD, ids=[f"{b[3]}: {b[1][:20]}" for b in BAD])
def test_refusals_name_file_line_key_and_cure(old: str, new: str, line: int, key: str, words: list[str]):
    assert EXAMPLE.count(old) == 1 or new == "errormodel: 1"
    error = refusal(EXAMPLE.replace(old, new))
    assert error.where == f"machine.yaml, line {line}, key {key}"
    for word in words:
        assert word in f"{error.found}. {error.cure}"
    assert error.cure


@pytest.mark.parametrize(
    ("text", "key", "words"),
    [
        ("errormodel: 1\nchain: []\n", "chain", ["[]", "workpiece to the tool"]),
        ("errormodel: 1\n", "chain", ["missing", "workpiece to the tool"]),
        ("errormodel: 1\nchain: [5]\n", "chain[1]", ["5", "workpiece to the tool"]),
        ("errormodel: 1\nchain: [{shape: A}]\n", "chain", ["no joint", "Add"]),
        (PLAIN + "errors:\n", "errors", ["nothing", "shapes: all"]),
        (PLAIN + "errors: {joints: {harmonic: 1}}\n", "errors.joints.harmonic", ["prismatic", "Write"]),
        (PLAIN.replace("500", "1e306") + "units: {length: m}\n", "chain[1].travel[2]", ["1e+306", "Write travel"]),
    ],
)
def test_more_refusals(text: str, key: str, words: list[str]):
    error = refusal(text)
    assert error.where.endswith(f"key {key}")
    for word in words:
        assert word in f"{error.found}. {error.cure}"


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("errormodel: 1\n\tname: x\n", 2, "spaces"),
        ("errormodel: 1\nchain: [1, 2\n", 2, "Close the bracket"),
        ("errormodel: 1\nname: a: b\n", 2, "space after each colon"),
        ("- 1\n", 1, "key: value"),
        ("just text\n", 1, "key: value"),
        ("errormodel: 1\n---\nerrormodel: 1\n", 2, "---"),
        ("errormodel: 1\n1: 2\n", 2, "as text"),
        ("errormodel: 1\nname: *x\n", 2, "Write the value out"),
        ("errormodel: 1\nname: \x07\n", 2, "control character"),
        ("errormodel: 1\nname: !!int x\n", 2, "whole number"),
        ("errormodel: 1\nname: &a [*a]\n", 2, "nested too deep"),
    ],
)
def test_broken_yaml_is_refused_with_its_line(text: str, line: int, words: str):
    error = refusal(text)
    assert re.match(rf"machine\.yaml, line {line}\b", error.where)
    assert words in str(error)


def test_bombs_are_refused():
    levels = "".join(f"{b}: &{b} [{', '.join(['*' + a] * 9)}]\n" for a, b in zip("abcdefg", "bcdefgh", strict=True))
    assert "more than" in str(refusal(f"a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]\n{levels}"))
    assert "nested too deep" in str(refusal("a: " + "[" * 20000))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "an empty file"),
        (b"# nothing but a comment\n", "an empty file"),
        (b"errormodel: 1\nname: M\xfcller\n", "line 2: the byte 0xfc, which is not UTF-8. Save"),
        (b"errormodel: 1\n" + b"#" * 1_000_001, "longer than"),
    ],
)
def test_unreadable_files_are_refused(tmp_path: Path, content: bytes, words: str):
    file = tmp_path / "machine.yaml"
    file.write_bytes(content)
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        schema.read_machine(file)
    assert caught.value.where.startswith(str(file))


def test_nothing_is_executed(tmp_path: Path):
    trap = tmp_path / "trap"
    for tag in ("!!python/object/apply:pathlib.Path.touch", "!!python/object/new:os.system", "!!python/name:os.x"):
        file = tmp_path / "machine.yaml"
        file.write_text(f"errormodel: 1\nname: {tag} [!!python/object/apply:pathlib.Path ['{trap}']]\n")
        with pytest.raises(InputError, match="line 2, key name: the tag !!python"):
            schema.read_machine(file)
    assert not trap.exists()


# Where machines are found


def test_library():
    machines = schema.library()
    assert "five_axis_table_quill" in machines
    for name, file in machines.items():
        machine = schema.read_machine(name)
        assert machine.source == file
        assert machine.joints


def test_a_folder_stands_for_its_machine(tmp_path: Path):
    (tmp_path / "machine.yaml").write_text(PLAIN)
    assert schema.read_machine(tmp_path).name == tmp_path.name


@pytest.mark.parametrize("name", ["five_axis_table_quil", "five_axis_table_quill.yaml", "x" * 5000, "a\0b"])
def test_an_unknown_machine_names_the_library(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        schema.read_machine(name)
    assert "five_axis_table_quill" in str(caught.value)


def test_no_name_is_the_folder_one_stands_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"a folder without machine\.yaml"):
        schema.read_machine("")


def test_an_empty_folder_is_no_machine(tmp_path: Path):
    with pytest.raises(InputError, match=r"without machine\.yaml"):
        schema.read_machine(tmp_path)
