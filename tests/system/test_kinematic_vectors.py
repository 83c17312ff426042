"""Vectors of controls' kinematic descriptions, by a forward kinematics of their manuals' definitions.

Nothing of the package moves an axis here: the tip follows from the vectors alone. With the nominal vectors it is that
of the nominal machine, with the written changes that of the actual one but for what is claimed to be left.

Definitions: SINUMERIK Operate IM9 6FC5397-1DP40, 22.6 (CYCLE800: of a head I3 from the tool adapter to the 2nd rotary
axis, I2 from there to the 1st; of a table I2 from the machine's reference point to the 1st, I3 from there to the 2nd;
I1 and I4 close); FANUC A-79348E p. 74-84 (19700 to the table's first axis, 19703 from there to the second; 19709 from
the tool axis to the rotary axis, 19712 from there to the first); HEIDENHAIN iTNC 530 HSCI p. 670, 722 (from the tool to
the workpiece: ``Trans`` moves all that follows, ``MachAxis`` moves what came before against what follows).
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from errormodel.chain import Chain
from errormodel.controllers import target
from errormodel.controllers.base import Controller
from errormodel.controllers.rotary_lines import Line
from errormodel.machine_file import read_machine
from identification.compensation.assessment import left, nothing
from identification.compensation.kinematic_description import Kinematics, description_text
from identification.compensation.rotary_axes import described, lines_of
from identification.compensation.volume import Volume
from tests.helpers.chains import Array
from tests.helpers.compensation import volume_of
from tests.helpers.nightly import first_of

ROUNDING_UM = 0.15  # vectors have four decimals of a mm, directions seven: 0.1 um at 1 m
POSES = 400
MIXED = """
errormodel: 1
name: A head and a table
units: {length: mm, angle: deg}
chain:
  - {joint: C, type: rotary, axis: z, travel: [0, 360]}
  - {shape: base, offset: [20, 400, 900]}
  - {joint: Y, type: prismatic, axis: y, travel: [-250, 250]}
  - {joint: X, type: prismatic, axis: x, travel: [-300, 300]}
  - {joint: Z, type: prismatic, axis: z, travel: [100, 500]}
  - {shape: ram, offset: [-20, -400, -700]}
  - {joint: B, type: rotary, axis: y, travel: [-100, 100]}
  - {shape: spindle, offset: [0, 0, -150]}
tool: [0, 0, -90]
errors: {shapes: all}
"""
Vectors = dict[str, Array]


def turned(axis: Array, angle: Array) -> Array:
    """Rotations (n, 3, 3) about an axis of any length, by Rodrigues' formula."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.asarray(np.eye(3) + s * cross + (1 - c) * cross @ cross)


def on(rotation: Array, point: Array) -> Array:
    return np.asarray(np.einsum("nij,nj->ni", rotation, np.broadcast_to(point, (len(rotation), 3))))


def centre(volume: Volume, k: int) -> Array:
    """The point of a rotary axis nearest to the zero position's tip, from three positions of the nominal machine."""
    q = np.zeros((3, len(volume.low)))
    q[:, k] = [0.0, 0.4, -0.3]
    q[:, [n for n, j in enumerate(volume.field.joints) if n > k and j.type == "rotary"]] = (
        0.5  # the tip beside the axis
    )
    a, b, c = volume.field.nominal(q)
    along = np.array(axis_of(volume, k))
    rows = np.array([b - a, c - a, along])
    found = np.linalg.solve(rows, [(b - a) @ (a + b) / 2, (c - a) @ (a + c) / 2, 0.0])
    return np.asarray(found)


def axis_of(volume: Volume, k: int) -> tuple[float, float, float]:
    return volume.field.joints[k].axis


def heads(t: Array, i2: Array, i3: Array, tool: Array, first: Array, second: Array | None) -> Array:
    """Tip of a head: ``t`` is the tool adapter without any turn."""
    inner = tool - i3
    out = inner if second is None else on(second, inner) - i2
    return np.asarray(t + i3 + (0 if second is None else i2) + on(first, out))


def tables(p: Array, i2: Array, i3: Array, first: Array, second: Array | None) -> Array:
    """Where the workpiece, which the table turns, has a point ``p`` of the machine; at zero it is ``p``."""
    if second is None:
        return np.asarray(i2 + on(first, p - i2))
    return np.asarray(i2 + i3 + on(second, on(first, p - i2) - i3))


Forward = Callable[[Vectors], Array]


def forward(volume: Volume, q: Array, ends: Mapping[str, Array]) -> tuple[Vectors, Forward]:
    """Nominal vectors of a machine between points of its axes, and its tip by such vectors."""
    field = volume.field
    names = [j.name for j in field.joints]
    rotary = [k for k, j in enumerate(field.joints) if j.type == "rotary"]
    linear = [k for k, j in enumerate(field.joints) if j.type != "rotary"]
    flat = q.copy()
    flat[:, rotary] = 0.0
    tip = field.nominal(flat)
    tool = np.asarray(field.chain.machine.tool, dtype=np.float64)
    zero = field.nominal(np.zeros((1, len(names))))[0]
    adapter = zero - tool
    table = [k for k in rotary if k < min(linear)][::-1]  # the first carries the second
    head = [k for k in rotary if k > max(linear)]
    at = {k: ends[names[k]] for k in rotary}
    for k in rotary:  # the points lie on the axes, which are found from three positions
        beside = np.cross(at[k] - centre(volume, k), axis_of(volume, k))
        np.testing.assert_allclose(beside, 0, atol=1e-6)
    nominal: Vectors = {}
    if len(head) == 2:
        nominal |= {"I3": at[head[1]] - adapter, "I2": at[head[0]] - at[head[1]]}
    elif len(table) == 2:
        nominal |= {"I2": at[table[0]], "I3": at[table[1]] - at[table[0]]}
    else:
        nominal |= {"I2": at[head[0]] - adapter, "I3": at[table[0]]}
    order = [*head, *table]
    nominal |= {f"V{n}": np.array(axis_of(volume, k)) for n, k in enumerate(order, 1)}

    def moved(v: Vectors) -> Array:
        turns = [turned(v[f"V{n}"], q[:, k]) for n, k in enumerate(order, 1)]
        if len(head) == 2:
            return heads(tip - tool, v["I2"], v["I3"], tool, turns[0], turns[1])
        if len(table) == 2:
            return tables(tip, v["I2"], v["I3"], turns[0], turns[1])
        out = heads(tip - tool, np.zeros(3), v["I2"], tool, turns[0], None)
        return tables(out, v["I3"], np.zeros(3), turns[1], None)

    return nominal, moved


def siemens(text: str) -> Vectors:
    numbers = r"((?:[-+]\d+\.\d+ ?)+)"
    found = re.findall(rf"(I\d|V\d) \(\$TC_CARR[^)]*\): {numbers}", text)
    return {k: np.array(v.split(), dtype=float) for k, v in found}


def fanuc(text: str) -> Vectors:
    rows = re.findall(r"(197\d\d) to 197\d\d [^:]*: ((?:[-+]\d+\.\d+ ?)+)", text)
    return {k: np.array(v.split(), dtype=float) for k, v in rows}


def rms_um(errors: Array, at: Array) -> float:
    """Root mean square of errors after the best small motion of the whole."""
    lever = at - at.mean(axis=0)
    turn = -np.cross(lever[:, None, :], np.eye(3)[None])
    design = np.concatenate([np.tile(np.eye(3), (len(at), 1, 1)), -turn.transpose(0, 2, 1)], axis=2).reshape(-1, 6)
    left_over = errors.ravel() - design @ np.linalg.lstsq(design, errors.ravel(), rcond=None)[0]
    return float(1000 * np.sqrt(np.mean(np.sum(left_over.reshape(-1, 3) ** 2, axis=1))))


def machine(name: str, folder: Path, errors: Mapping[str, float]) -> Volume:
    if name == "mixed":
        (folder / "mixed.yaml").write_text(MIXED)
    model = read_machine(str(folder / "mixed.yaml") if name == "mixed" else name)
    return volume_of(model, Chain(model).vector(dict(errors)))


CASES = {"trunnion_five_axis": ("trunnion", "base"), "fork_head_five_axis": ("ram", "fork", "spindle"),
         "mixed": ("base", "spindle", "ram")}  # fmt: skip


def random_errors(shapes: tuple[str, ...], seed: int, tilts: bool) -> dict[str, float]:
    rng = np.random.default_rng(seed)
    sizes = {"dx": 0.03, "dy": 0.03, "dz": 0.03, **(dict.fromkeys(("ea", "eb", "ec"), 4e-5) if tilts else {})}
    return {f"{s}.{m}": float(rng.normal(0, size)) for s in shapes for m, size in sizes.items()}


@dataclass(frozen=True)
class Written:
    """What is written, the points of the axes that are named, and the errors before and claimed to be left, um."""

    text: str
    ends: dict[str, Array]
    slopes: dict[str, Array]
    before: float
    claimed: float


@cache
def found_in(name: str, seed: int, tilts: bool, tilts_are_told: bool) -> tuple[Volume, tuple[Line, ...], float, float]:
    """A machine with random errors, its rotary axes as they are found, and the errors before and then, um.

    `tilts`: of the machine; `tilts_are_told`: whether the control can be told of them.
    """
    with tempfile.TemporaryDirectory() as folder:
        volume = machine(name, Path(folder), random_errors(CASES[name], seed, tilts))
    lines = lines_of(volume, setup := volume.setup(None, None)[0], tilts_are_told)
    known = replace(volume, field=described(volume.field, setup, lines))
    before, claimed = (left(v, nothing, 0).rms_um for v in (volume, known))
    return volume, lines, before, claimed


def steps(controller: str, name: str, seed: int, tilts: bool = True) -> tuple[Volume, Written]:
    """What is written for a controller of such a machine."""
    kind = target(controller)
    assert isinstance(kind, Controller)
    volume, lines, *errors = found_in(name, seed, tilts, kind.describes_tilt)
    setup, found = volume.setup(None, None)[0], Kinematics(lines, *errors, asked=True, tilts=kind.describes_tilt)
    text = description_text(found, [], kind.describe(lines, setup))
    zero = volume.field.nominal(np.zeros((1, len(volume.low))))[0]
    ends, slopes = {}, {}
    for one in lines:
        point = re.search(rf"axis {one.axis} .*\n +the shift is that of its point ([^(]+)\(.*\n(.*)", text)
        assert point is not None, text
        ends[one.axis] = zero + np.array(point[1].split(), dtype=float)
        slope = re.match(" +along .* it is ([^m]+) mm", point[2])
        assert (slope is not None) == kind.describes_tilt
        slopes[one.axis] = np.array(slope[1].split() if slope else [0, 0, 0], dtype=float) / 1000
    return volume, Written(text, ends, slopes, *errors)


@pytest.mark.parametrize("seed", first_of([1, 2]))
@pytest.mark.parametrize("name", CASES)
def test_the_swivel_vectors_of_a_siemens_leave_what_is_claimed(name: str, seed: int) -> None:
    volume, said = steps("siemens-cec", name, seed)
    q, came = volume.poses(POSES, 5)
    nominal, moved = forward(volume, q, said.ends)
    points = volume.field.nominal(q)
    np.testing.assert_allclose(moved(nominal), points, atol=1e-9)
    changes = siemens(said.text)
    assert {"I2", "I3", "V1", "V2"} <= {*changes}
    actual = volume.field.actual(q, came)
    right, wrong = (
        rms_um(actual - moved({k: v + sign * changes[k] for k, v in nominal.items()}), points) for sign in (1, -1)
    )
    assert right < said.claimed + ROUNDING_UM
    assert said.claimed < 0.1 * said.before
    assert wrong > 1.5 * said.before
    closing = [changes[k] for k in changes if k in ("I1", "I4")]
    assert closing
    total = changes["I2"] + (changes["I3"] if name != "mixed" else 0)
    assert any(np.abs(total + c).max() < 2e-4 for c in closing)


@pytest.mark.parametrize("tilts", [False, True])
@pytest.mark.parametrize("seed", first_of([1, 2]))
@pytest.mark.parametrize("name", CASES)
def test_the_tool_centre_point_parameters_of_a_fanuc_leave_what_is_claimed(name: str, seed: int, tilts: bool) -> None:
    """The tilt of an axis has no parameter that is known: no claim counts on it."""
    volume, said = steps("fanuc-pitch", name, seed, tilts)
    found = fanuc(said.text)
    if name == "trunnion_five_axis":
        changes = {"I2": found["19700"], "I3": found["19703"]}
    elif name == "fork_head_five_axis":
        changes = {"I3": found["19709"], "I2": found["19712"]}
    else:
        changes = {"I3": found["19700"], "I2": found["19709"]}
    q, came = volume.poses(POSES, 5)
    nominal, moved = forward(volume, q, said.ends)
    actual, points = volume.field.actual(q, came), volume.field.nominal(q)
    right = rms_um(actual - moved({k: v + changes.get(k, 0.0) for k, v in nominal.items()}), points)
    assert right < said.claimed + ROUNDING_UM
    assert right == pytest.approx(said.claimed, rel=0.1) if tilts else right < 0.1 * said.before


def rigid(key: str, value: float) -> Array:
    """A Trans line as a matrix (4, 4): mm along X, Y, Z, degrees about them by A, B, C."""
    out = np.eye(4)
    if key in "XYZ":
        out["XYZ".index(key), 3] = value
    else:
        out[:3, :3] = turned(np.eye(3)["ABC".index(key)], np.radians([value]))[0]
    return out


def heidenhain(text: str) -> dict[str, tuple[Array, Array]]:
    """The Trans lines before and after each axis, each as one matrix (4, 4)."""
    found = {}
    for axis, rows in re.findall(r"^around (\w):\n((?:  .*\n)+)", text, re.MULTILINE):
        before, mark, after = rows.partition(f"  MachAxis {axis}\n")
        assert mark
        moves = [[rigid(k, float(v)) for k, v in re.findall(r"  Trans (\w) (\S+)", p)] for p in (before, after)]
        first, second = (np.linalg.multi_dot([np.eye(4), np.eye(4), *m]) for m in moves)
        found[axis] = first, second
    return found


def described_tip(
    volume: Volume, q: Array, ends: Mapping[str, Array], trans: Mapping[str, tuple[Array, Array]]
) -> Array:
    """Tip (n, 3) in the workpiece's frame by a description table, walked from the tool to the workpiece."""
    zero = volume.field.nominal(np.zeros((1, len(volume.low))))[0]
    frame = np.tile(np.eye(4), (len(q), 1, 1))  # the present frame in the tool's; it begins at the tip at zero
    for k, joint in reversed([*enumerate(volume.field.joints)]):
        axis, step = np.array(joint.axis), np.tile(np.eye(4), (len(q), 1, 1))
        if joint.type != "rotary":
            step[:, :3, 3] = -q[:, k, None] * axis  # what follows moves against the tool the other way
            frame = frame @ step
            continue
        there = np.eye(4)
        there[:3, 3] = ends[joint.name] - zero
        back = np.linalg.inv(there)
        step[:, :3, :3] = turned(axis, -q[:, k])
        before, after = trans[joint.name]
        frame = frame @ there @ before @ step @ after @ back
    return np.asarray(np.linalg.inv(frame)[:, :3, 3] + zero)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("name", CASES)
def test_the_description_table_of_a_heidenhain_leaves_what_is_claimed(name: str, seed: int) -> None:
    volume, said = steps("heidenhain", name, seed)
    q, came = volume.poses(POSES, 5)
    trans = heidenhain(said.text)
    assert {*trans} == {j.name for j in volume.field.joints if j.type == "rotary"}
    points, none = volume.field.nominal(q), dict.fromkeys(trans, (np.eye(4), np.eye(4)))
    np.testing.assert_allclose(described_tip(volume, q, said.ends, none), points, atol=1e-9)
    actual = volume.field.actual(q, came)
    turned_round = {k: (after, before) for k, (before, after) in trans.items()}
    right, wrong = (rms_um(actual - described_tip(volume, q, said.ends, t), points) for t in (trans, turned_round))
    assert right < said.claimed + ROUNDING_UM
    assert said.claimed < 0.1 * said.before
    assert wrong > 1.5 * said.before
    for before, after in trans.values():  # one undoes the other
        np.testing.assert_allclose(before @ after, np.eye(4), atol=1e-6)


def test_a_vector_that_ends_elsewhere_on_a_tilted_axis_is_changed_otherwise() -> None:
    """The share of the tilt that is written with the shift: of a fork head's C, whose vector ends 2 m lower."""
    (volume, said), along = steps("siemens-cec", "fork_head_five_axis", 1), np.array([0.0, 0.0, 1.0])
    q, came = volume.poses(POSES, 5)
    actual, points = volume.field.actual(q, came), volume.field.nominal(q)
    changes = siemens(said.text)
    ends = {**said.ends, "C": said.ends["C"] - 2000 * along}
    nominal, moved = forward(volume, q, ends)
    plain = {k: v + changes[k] for k, v in nominal.items()}
    shifted = {**plain, "I2": plain["I2"] - 2000 * said.slopes["C"]}
    assert rms_um(actual - moved(plain), points) > 0.3 * said.before
    assert rms_um(actual - moved(shifted), points) < said.claimed + 2 * ROUNDING_UM
