"""Axis numbers follow the letters and not the chain; letters that nobody can know are asked for."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from errormodel.chain import Chain
from errormodel.controllers import target
from errormodel.controllers.axes import AXIS_LETTERS, axis_letters, wanted_axes
from errormodel.controllers.base import Controller
from errormodel.controllers.grids import turn_grid
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Table, Tables, Term
from errormodel.exceptions import InputError
from errormodel.machine import Joint
from errormodel.machine_file import read_machine
from identification.compensation.field import Field, movers_of
from identification.compensation.volume import Volume
from tests.helpers.commands import done, run
from tests.helpers.nightly import first_of

STEPS = {"X": 100.0, "Y": 50.0, "Z": 25.0}  # of a table of each axis, by which it is known again
CHAINS = {  # joints in the order of the chain, and the numbers that controls count from 1
    "bridge_cmm": ("YXZ", "X1 Y2 Z3"),
    "trunnion_five_axis": ("CAYXZ", "X1 Y2 Z3 A4 C5"),
    "five_axis_table_quill": ("BXZYW", "X1 Y2 Z3 B4 W5"),
    "fork_head_five_axis": ("XYZCA", "X1 Y2 Z3 A4 C5"),
    "horizontal_three_axis": ("ZXY", "X1 Y2 Z3"),
}


def setup_of(name: str, axes: str | None = None, **names: str) -> Setup:
    """A machine of the library as controllers see it, some joints renamed."""
    machine = read_machine(name)
    machine = replace(
        machine,
        elements=tuple(
            replace(e, name=names.get(e.name, e.name)) if isinstance(e, Joint) else e for e in machine.elements
        ),
    )
    chain = Chain(machine)
    field = Field(chain, np.zeros(len(chain.ids)), movers_of(chain))
    travel = np.array([j.travel for j in machine.joints])
    return Volume(field, travel[:, 0], travel[:, 1], True).setup(None, None, axes)[0]


def tabled(name: str) -> Controller:
    controller = target(name)
    assert isinstance(controller, Controller)
    return controller


def own_tables(zero: bool = False) -> Tables:
    """A table of each linear axis; its step says whose it is."""
    return tuple(
        Table(Term(a, (a,), ((0.0, s, 2 * s),), zero=zero), np.array([0.0, 0.001, 0.002])) for a, s in STEPS.items()
    )


def tables_by_number(name: str, setup: Setup) -> dict[int, float]:
    """Step of the table under each axis number, read from the files by their own grammar."""
    files = tabled(name).write(own_tables(name in ("fanuc-pitch", "pmac")), setup)
    text = "\n".join(files.values())
    if name.startswith("linuxcnc"):
        found = re.findall(r"\[JOINT_(\d+)\]\nCOMP_FILE = (\S+)", files["compensation.ini"])
        return {int(n): float(files[f].splitlines()[1].split()[0]) for n, f in found}
    if name == "fanuc-pitch":
        return {int(n): float(v) for n, v in re.findall(r"N3624A(\d+)P(\d+\.\d+)", text)}
    if name == "aerotech-1d":
        return {int(n): float(v) for n, v in re.findall(r":START (\d+) SAMPLEDIST=(\S+)", text)}
    found = re.findall(r"DEFINE COMP (\d+),#(\d+)D,#\2,(\d+)", text)
    return {int(n): int(length) / int(count) / 1000 for count, n, length in found}


@pytest.mark.parametrize("machine", first_of(CHAINS, 2))
@pytest.mark.parametrize("name", ["linuxcnc-type0", "linuxcnc-type1", "fanuc-pitch", "aerotech-1d", "pmac"])
def test_numbers_follow_the_letters_and_not_the_chain(name: str, machine: str) -> None:
    chain, numbers = CHAINS[machine]
    setup, first = setup_of(machine), 0 if name.startswith("linuxcnc") else 1
    assert "".join(a.joint for a in setup.axes) == chain
    assert " ".join(f"{a.name}{tabled(name).number(setup, a.name) + 1 - first}" for a in setup.ordered) == numbers
    assert tables_by_number(name, setup) == {first: STEPS["X"], first + 1: STEPS["Y"], first + 2: STEPS["Z"]}
    said = setup_of(machine, ",".join(f"{j}={20 + k}" for k, j in enumerate(chain)))
    wanted = {20 + chain.index(a): s for a, s in STEPS.items()}
    assert tables_by_number(name, said) == wanted
    files = tabled(name).write(own_tables(name in ("fanuc-pitch", "pmac")), said)
    back = {t.term.output: t.term.grids[0][1] - t.term.grids[0][0] for t in tabled(name).read(files, said)}
    assert back == pytest.approx(STEPS)  # read by the same numbers


@pytest.mark.parametrize("name", ["aerotech-2d", "fanuc-3d", "isg", "etalon"])
@pytest.mark.parametrize("machine", first_of(CHAINS, 2))
def test_formats_of_several_axes_number_by_letter_too(name: str, machine: str) -> None:
    setup, controller = setup_of(machine), tabled(name)
    terms = controller.structures(setup)[0]
    text = "\n".join(controller.write(tuple(Table(t, np.zeros(t.shape)) for t in terms), setup).values())
    if name == "fanuc-3d":
        numbers = [int(v) for v in re.findall(r"N1080[0-2]P(\d)\n", text)]
        assert numbers == ["XYZ".index(a) + 1 for a in terms[0].inputs]
    elif name == "aerotech-2d":
        order = [a.name for a in setup.ordered]
        rows = [tuple(map(int, m)) for m in re.findall(r":START2D (\d+) (\d+) \d+ \d+ ", text)]
        assert [tuple(order[k - 1] for k in pair) for pair in rows] == list(dict.fromkeys(t.inputs for t in terms))
    else:
        lines = re.findall(r"^([A-Z]) (\d+)$", text, re.MULTILINE)
        assert [a for a, _ in lines] == [a for a in "XYZABC" if a in setup.names]
        assert {a: int(n) for a, n in lines} == {a: controller.number(setup, a) for a, _ in lines}


@pytest.mark.parametrize("name", ["fanuc-pitch", "fanuc-3d", "aerotech-1d", "aerotech-2d", "pmac", "linuxcnc-type1"])
def test_a_comment_at_each_table_names_the_axis(name: str) -> None:
    setup, controller = setup_of("bridge_cmm"), tabled(name)
    terms = [t for t in controller.structures(setup)[0] if t.inputs]
    text = "\n".join(controller.write(tuple(Table(t, np.zeros(t.shape)) for t in terms), setup).values())
    for number, letter in ((1, "X"), (2, "Y"), (3, "Z")):
        at_the_table = re.compile(
            rf"[;(#].*(?:axis A?|motor ){number}\D+is {letter}\b|{letter} \(motor {number}\)", re.I
        )
        assert at_the_table.search(text) or re.search(rf"# axis {letter}\n\[JOINT_{number - 1}\]", text), (
            letter,
            text[:900],
        )


JOINTS = ("X", "Y", "Z")
WRONG = {
    "Q=1,Y=2,Z=3": ("'Q'", "no such joint"),
    "X=1,Y=1,Z=3": ("the number 1 for X and for Y", "a number of its own"),
    "X=1,Y=2": ("none for Z", "Number every joint"),
    "X=1,Y=2,Z=3,X=4": ("the joint X twice", "once"),
    "X=1.5,Y=2,Z=3": ("'1.5'", "whole number"),
    "X=-1,Y=2,Z=3": ("'-1'", "whole number"),
    "X=one,Y=2,Z=3": ("'one'", "X=1,Y=2,Z=3"),
    "X,Y=2": ("'X'", "X=1,Y=2,Z=3"),
    "X=": ("'X='", "X=1,Y=2,Z=3"),
    ",": ("nothing", "X=1,Y=2,Z=3"),
    "X=Y1,Y=Y2,Z=Z3": ("the letter Y for X and for Y", "a letter of its own"),
    "X=T1": ("'T1'", "no letter of X Y Z"),
}


@pytest.mark.parametrize("text", WRONG)
def test_wrong_axes_are_refused_with_their_cure(text: str) -> None:
    with pytest.raises(InputError) as error:
        wanted_axes(text, JOINTS)
    assert all(w in str(error.value) for w in ("--axes", *WRONG[text])), str(error.value)


@given(st.text("XYZ=,123.-ab ", max_size=24))
def test_any_text_of_axes_is_understood_or_refused(text: str) -> None:
    try:
        out = wanted_axes(text, JOINTS)
    except InputError:
        return
    assert {*out} <= {*JOINTS}
    numbers = [w.number for w in out.values() if w.number is not None]
    assert len({*numbers}) == len(numbers)
    assert len(numbers) in (0, 3)


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["X", "y", "Z", "A", "rail", "arm", "table", "W"]),
            st.sampled_from(["prismatic", "rotary"]),
            st.sampled_from([(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.8, 0.0)]),
        ),
        min_size=1,
        max_size=6,
        unique_by=lambda j: j[0],
    )
)
def test_letters_are_each_given_once_and_follow_name_or_direction(
    joints: list[tuple[str, str, tuple[float, ...]]],
) -> None:
    made = [Joint(n, kind, axis, (0.0, 1.0)) for n, kind, axis in joints]  # type: ignore[arg-type]
    letters, unsure = axis_letters(made, np.array([j[2] for j in joints]), {})
    assert len({*letters}) == len(letters)
    for joint, letter in zip(made, letters, strict=True):
        if joint.name.upper() in AXIS_LETTERS:
            assert letter == joint.name.upper()
        elif joint.name not in unsure:
            k = int(np.argmax(np.abs(joint.axis)))
            assert letter in ("ABC"[k] if joint.type == "rotary" else "XYZ"[k] + "UVW"[k])
            assert max(map(abs, joint.axis)) > 0.9


def test_names_that_are_no_letters_are_mapped_by_direction_or_asked_for() -> None:
    named = setup_of("bridge_cmm", X="carriage", Y="bridge", Z="ram")
    assert {a.joint: a.name for a in named.axes} == {"bridge": "Y", "carriage": "X", "ram": "Z"}
    tabled("fanuc-pitch").suits(named)
    quill = setup_of("five_axis_table_quill", W="quill")
    assert {a.joint: a.name for a in quill.axes}["quill"] == "W"  # the second along z, beside Z
    twins = setup_of("five_axis_table_quill", W="quill", Z="column")
    assert {*twins.unsure} == {"quill", "column"}
    for name in ("fanuc-pitch", "siemens-cec", "klipper"):
        with pytest.raises(InputError, match=r"--axes: it cannot be known .*column, quill.*--axes B=B,X=X"):
            tabled(name).suits(twins)
    said = setup_of("five_axis_table_quill", "quill=W,column=Z", W="quill", Z="column")
    assert said.unsure == ()
    tabled("siemens-cec").suits(said)
    assert {a.joint: a.name for a in said.axes} == {"B": "B", "X": "X", "column": "Z", "Y": "Y", "quill": "W"}


def test_numbers_where_a_format_has_none_or_counts_from_another_are_refused() -> None:
    with pytest.raises(InputError, match="names axes by letters"):
        tabled("siemens-cec").suits(setup_of("bridge_cmm", "X=1,Y=2,Z=3"))
    with pytest.raises(InputError, match="counts axes from 1"):
        tabled("fanuc-pitch").suits(setup_of("bridge_cmm", "X=0,Y=1,Z=2"))
    tabled("linuxcnc-type1").suits(setup_of("bridge_cmm", "X=0,Y=1,Z=2"))


@pytest.fixture(scope="module")
def bridge(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bridge")
    done("simulate", "bridge_cmm", 60, "--noise", 0.002, "--out", folder / "s.csv")
    done("fit", "bridge_cmm", folder / "s.csv", "--out", folder / "fit")
    return folder / "fit"


def test_the_command_shows_the_numbers_first(bridge: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("identification.compensation.compensate.SAMPLE_POSES", 300)
    out = done("compensate", bridge, "--controller", "linuxcnc-type1", "--out", tmp_path / "a").out
    assert "axes: X = JOINT_0, Y = JOINT_1, Z = JOINT_2" in out
    checklist = (tmp_path / "a/checklist.txt").read_text().splitlines()
    assert checklist[1].startswith("axes: X = JOINT_0, Y = JOINT_1, Z = JOINT_2")
    more = ("--axes", "Y=4,X=2,Z=0", "--out", tmp_path / "b")
    out = done("compensate", bridge, "--controller", "linuxcnc-type1", *more).out
    assert "axes: Z = JOINT_0, X = JOINT_2, Y = JOINT_4" in out
    assert (tmp_path / "b/joint_4_Y.comp").read_text() == (tmp_path / "a/joint_1_Y.comp").read_text()
    data = json.loads((tmp_path / "b/compensation.json").read_text())
    assert data["axes"]["Y"] == {"axis": "Y", "address": "JOINT_4"}


@pytest.mark.parametrize("text", ["Q=1", "X=1,Y=1,Z=2", "X=0,Y=1", "X=a.b"])
def test_wrong_axes_end_with_2_and_write_nothing(text: str, bridge: Path, tmp_path: Path) -> None:
    result = run("compensate", bridge, "--controller", "linuxcnc-type1", "--axes", text, "--out", tmp_path / "o")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert "--axes" in result.err
    assert not (tmp_path / "o").exists()


@given(st.integers(-360, 0), st.integers(1, 200))
def test_a_full_turn_may_be_counted_from_zero(low: int, intervals: int) -> None:
    """Controls whose tables count from the motor's zero need multiples of the step."""
    grid = np.array(turn_grid(float(low), intervals, anchored=True))
    if len(grid):
        assert (grid[0], grid[-1]) == (low, pytest.approx(low + 360, abs=1e-6))
        assert len(grid) > intervals
        step = grid[1] - grid[0]
        np.testing.assert_allclose(grid / step, np.round(grid / step), atol=1e-6)
    for turn in (-180.0, -90.0, 0.0):
        assert len(turn_grid(turn, intervals, anchored=True)) > 0
