"""Which parameters can be told apart: the five-axis paper's own groups, and what must not change them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from errormodel.chain import Chain
from errormodel.instruments.plain import Plain
from errormodel.machine import Joint, Machine, Shape, Vector
from errormodel.machine_file import library, read_machine
from errormodel.simulation import random_points
from errormodel.survey import Survey
from identification.estimation.fit import fit_machine
from identification.estimation.least_squares import identifiable
from identification.observation.identifiability import Floors, Groups, find_groups
from identification.observation.pose import Pose
from identification.results.description import describe
from tests.helpers.chains import Array, machines, poses, seen
from tests.helpers.findings import known, made, survey_of

MACHINES = sorted(library())

# Table 3 of the five-axis paper (its alpha, beta and gamma are rotations about z, y and x; t1 is the tool's length)
TABLE_3 = """
T1.dx + T2.dx + T3.dx + T4.dx + T5.dx - 312.035 T5.eb
T1.dy + T2.dy + T3.dy + T4.dy + T5.dy + 312.035 T5.ea
T1.dz + T2.dz + T3.dz + T4.dz + T5.dz
B.dx.1
B.dy.1
B.dz.1
X.dx.1
Y.dy.1
Z.dz.1
W.dz.1
T1.ec
T2.ec + T3.ec
T1.eb
T2.eb
T3.eb + T4.eb
T1.ea + T2.ea
T3.ea
T4.ea
B.eb.1
B.ec.1
B.ea.1
X.ec.1
X.eb.1
X.ea.1
Y.ec.1
Y.eb.1
Y.ea.1
Z.ec.1
Z.eb.1
Z.ea.1
W.eb.1
W.ea.1
""".strip().splitlines()


def with_tools(machine: Machine, tools: tuple[Vector, ...], n: int = 400) -> Survey:
    table = random_points(machine, n, seed=3)
    table[["tool_x", "tool_y", "tool_z"]] = np.resize(np.array(tools), (n, 3))
    table[["mx", "my", "mz"]] = 0.0
    return Survey(
        table.assign(run="1", file="a.csv", role="fit", row=1), "fixed", (), Plain(type="plain"), Path("a.csv")
    )


def test_the_five_axis_paper() -> None:
    found = describe(read_machine("five_axis_table_quill"))
    assert len(found.groups.ids) == 52
    assert set(found.groups.no_effect) == {"T4.ec", "T5.ec", "W.ec.1"}
    assert set(found.reasons) == set(found.groups.no_effect)
    assert found.groups.rank == 32
    assert sorted(found.groups.name(k) for k in range(32)) == sorted(TABLE_3)
    tool = found.groups.members(0)["T5.eb"]
    assert tool == pytest.approx(-312.035, abs=1e-7)
    data = found.as_json()
    assert (data["n_parameters"], data["n_no_effect"], data["rank"]) == (52, 3, 32)


def test_two_tools_split_two_groups() -> None:
    machine = read_machine("five_axis_table_quill")
    found = describe(machine, with_tools(machine, ((0, 0, -312.035), (0, 0, -435.185))))
    assert found.groups.rank == 34
    assert set(found.groups.no_effect) == {"T4.ec", "T5.ec", "W.ec.1"}
    names = {found.groups.name(k) for k in range(34)}
    assert set(found.split) == {line for line in TABLE_3 if "312.035" in line}
    split = {f"T1.{d} + T2.{d} + T3.{d} + T4.{d} + T5.{d}" for d in ("dx", "dy")}
    assert names == set(TABLE_3) - set(found.split) | split | {"T5.ea", "T5.eb"}
    one = describe(machine, with_tools(machine, ((0, 0, -435.185),)))
    assert one.groups.rank == 32
    assert one.groups.members(0)["T5.eb"] == pytest.approx(-435.185, abs=1e-7)


def groups_of(chain: Chain, n: int = 300, seed: int = 0, **more: object) -> Groups:
    return identifiable(chain, [seen(chain, poses(chain.machine, n, seed), **more)], chain.machine_ids)


def membership(groups: Groups) -> set[frozenset[str]]:
    return {frozenset(groups.members(k)) for k in range(groups.rank)}


def assert_same_groups(found: Groups, expected: Groups) -> None:
    """Ranks decided with room to spare are equal, and so is who stands with whom."""
    assert_same_rank(found, expected)
    assert membership(found) == membership(expected)


def assert_same_rank(found: Groups, expected: Groups) -> None:
    spectrum, rank = expected.singular_values, expected.rank
    assume(not rank or spectrum[rank - 1] > 1e-5)
    assume(rank == len(spectrum) or spectrum[rank] < 1e-11)
    assert found.rank == rank
    assert found.no_effect == expected.no_effect


def scaled(machine: Machine, factor: float) -> Machine:
    def times(v: Vector) -> Vector:
        return v[0] * factor, v[1] * factor, v[2] * factor

    def element(e: Shape | Joint) -> Shape | Joint:
        if isinstance(e, Shape):
            return replace(e, offset=times(e.offset))
        return replace(e, travel=(e.travel[0] * factor, e.travel[1] * factor)) if e.type == "prismatic" else e

    return replace(machine, elements=tuple(element(e) for e in machine.elements), tool=times(machine.tool))


@settings(max_examples=6)
@given(machines(most_joints=4), st.integers(0, 99))
def test_order_weights_units_and_frame_change_nothing(machine: Machine, seed: int) -> None:
    chain, rng = Chain(machine), np.random.default_rng(seed)
    expected = groups_of(chain)
    rows, shuffled = poses(machine, 300), rng.permutation(300)
    assert_same_groups(identifiable(chain, [seen(chain, [r[shuffled] for r in rows])], chain.machine_ids), expected)
    # weights of two decades are other data: what is clear stays so, but another member may stand for its group
    assert_same_rank(groups_of(chain, whitener=10 ** rng.uniform(-1, 1, 300)), expected)
    assert_same_groups(groups_of(Chain(scaled(machine, 25.4))), expected)
    turned = Pose(Rotation.from_rotvec(rng.normal(size=3)).as_matrix(), rng.normal(0, 1e4, 3))
    whitener = rng.normal(size=(300, 3, 3)) + 3 * np.eye(3)  # as of a tracker, in the axes of the measuring frame
    assert_same_rank(groups_of(chain, pose=turned, whitener=whitener), expected)
    assert_same_groups(groups_of(chain, pose=turned), expected)


@settings(max_examples=12)
@given(machines(most_joints=4), st.integers(0, 99))
def test_the_order_of_parameters_does_not_change_the_rank(machine: Machine, seed: int) -> None:
    chain, rng = Chain(machine), np.random.default_rng(seed)
    expected = groups_of(chain)
    assume(expected.rank and expected.singular_values[expected.rank - 1] > 1e-5)
    ids = tuple(rng.permutation(chain.machine_ids).tolist())
    found = identifiable(chain, [seen(chain, poses(machine, 300))], ids)
    assert found.rank == expected.rank
    assert set(found.no_effect) == set(expected.no_effect)


def check_combinations(chain: Chain, groups: Groups, seed: int) -> None:
    """M = M_base K at fresh poses; and a null combination really moves nothing, exact kinematics, to first order."""
    rows, zero = poses(chain.machine, 50, seed), np.zeros(len(chain.ids))
    own = chain.machine_ids
    m = chain.kernel("design", own)(rows, zero).reshape(len(own), 6, -1)[:, :3].reshape(len(own), -1)
    rest = m - groups.coefficients.T @ m[groups.base]
    size = np.linalg.norm(m, axis=1)
    terms = np.abs(groups.coefficients.T) @ size[groups.base] + size  # a sum rounds as its largest terms do
    # a power of a travel that lies far from zero rounds as much as the largest null singular value says
    spectrum = groups.singular_values
    rounded = spectrum[groups.rank :].max(initial=0.0) / spectrum[groups.rank - 1]
    assert (np.linalg.norm(rest, axis=1) <= (1e-9 + rounded) * terms + 1e-11 * chain.size * (terms == 0)).all()
    actual = chain.kernel("actual", outputs=(0, 1, 2))
    nominal = actual(rows, zero)
    for j in np.setdiff1d(np.arange(len(own)), groups.base):
        p = np.zeros(len(own))
        p[j] = 1.0
        p[groups.base] -= groups.coefficients[:, j]
        p *= 1e-5 * chain.size / max(np.abs(p[:, None] * m).max(), 1e-9 * chain.size)
        moved = [
            np.abs(actual(rows, chain.vector(dict(zip(own, p * f, strict=True)))) - nominal).max() for f in (1, 0.5)
        ]
        assert moved[1] < 0.27 * moved[0] + 1e-12 * chain.size, own[j]


@pytest.mark.long
@pytest.mark.parametrize("name", MACHINES)
def test_combinations_of_the_library(name: str) -> None:
    chain = Chain(read_machine(name))
    check_combinations(chain, describe(chain.machine).groups, seed=11)


@settings(max_examples=6)
@given(machines(most_joints=4))
def test_combinations_of_any_machine(machine: Machine) -> None:
    chain = Chain(machine)
    groups = groups_of(chain)
    assume(groups.rank and groups.singular_values[groups.rank - 1] > 1e-4)
    check_combinations(chain, groups, seed=11)


@pytest.mark.parametrize("name", MACHINES)
def test_full_travel_is_described(name: str) -> None:
    found = describe(read_machine(name))
    assert found.groups.rank + len(found.groups.no_effect) <= len(found.groups.ids)
    spectrum = found.groups.singular_values  # a rank is only as good as the gap it is read from
    assert spectrum[found.groups.rank - 1] > 1e-4
    assert (spectrum[found.groups.rank :] < 1e-10).all()


def test_few_parameters_stand_alone() -> None:
    shapes = {"T1": ("dx", "ea"), "T3": ("eb",)}
    machine = read_machine("five_axis_table_quill")
    elements = tuple(
        replace(e, motions=shapes.get(e.name, ())) if isinstance(e, Shape) else replace(e, models={})
        for e in machine.elements
    )
    found = describe(replace(machine, elements=elements)).groups
    assert [found.members(k) for k in range(found.rank)] == [{"T1.dx": 1.0}, {"T1.ea": 1.0}, {"T3.eb": 1.0}]
    assert found.no_effect == ()


def plain_groups(design: Array, noise: float = 0.0) -> Groups:
    n = design.shape[1]
    return find_groups(design, [f"p{k}" for k in range(n)], np.ones(n), range(n), Floors(noise))


def test_equally_weak_directions_do_not_stall() -> None:
    """Two columns as near to a third as each other: a threshold between their singular values parts them still."""
    e, small = np.eye(6), 1e-3
    design = np.array([e[0], e[0] + small * e[1], e[0] + small * e[2], e[3]]).T
    singular = plain_groups(design).singular_values
    found = plain_groups(design, float(np.sqrt(singular[2] * singular[3])))
    assert found.base.tolist() == [0, 1, 3]


@pytest.mark.parametrize(("share", "base"), [(0.02, "link"), (0.002, "joint")])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e3])
def test_what_is_hardly_seen_names_no_group(share: float, base: str, unit: float) -> None:
    """A link that turns a point of 200 mm lever moves it by 1 mm of travel: the joint's own error is seen whole."""
    moved = np.linspace(-1.0, 1.0, 9)
    design = unit * np.column_stack([share * moved, moved])
    scale = unit * np.linalg.norm(moved) * np.ones(2)
    groups = find_groups(design, ["link", "joint"], scale, [0, 1])
    assert groups.rank == 1
    assert next(iter(groups.members(0))) == base


def test_nothing_stands_above_the_noise() -> None:
    found = plain_groups(np.eye(4), 2.0)
    assert (found.rank, found.condition, found.coefficients.shape) == (0, 1.0, (0, 4))
    nothing = plain_groups(np.zeros((5, 3)))
    assert (nothing.rank, nothing.no_effect) == (0, ("p0", "p1", "p2"))


def test_a_group_reads_as_a_formula() -> None:
    found = plain_groups(np.array([[1.0, 0, 1, -2.5, 0], [0, 1, -1, 0, 1 / 3]]))
    assert [found.name(k) for k in range(2)] == ["p0 + p2 - 2.5 p3", "p1 - p2 + 0.333333 p4"]


def test_a_column_shorter_than_the_noise_has_no_effect() -> None:
    rng = np.random.default_rng(0)
    design = rng.normal(size=(30, 2)) * [1.0, 1e-6]
    scale = np.full(2, np.sqrt(30.0))
    assert find_groups(design, ("a", "b"), scale, [0, 1]).no_effect == ()
    assert find_groups(design, ("a", "b"), scale, [0, 1], Floors(lever=1e-5)).no_effect == ("b",)
    assert find_groups(design, ("a", "b"), scale, [0, 1], Floors(lever=1e-7)).no_effect == ()


def test_a_share_that_the_noise_hides_is_none() -> None:
    """c acts as a and a thousandth of b."""
    rng = np.random.default_rng(1)
    q = np.linalg.qr(rng.normal(size=(30, 2)))[0]
    design = np.column_stack([q, q @ [1.0, 1e-3]])
    ids, scale = ("a", "b", "c"), np.ones(3)
    seen = find_groups(design, ids, scale, [0, 1, 2])
    assert seen.members(1) == pytest.approx({"b": 1.0, "c": 1e-3})
    hidden = find_groups(design, ids, scale, [0, 1, 2], Floors(direction=1e-2))
    assert hidden.members(0) == pytest.approx({"a": 1.0, "c": 1.0})
    assert hidden.members(1) == {"b": 1.0}


@pytest.mark.parametrize("width", [0.01, 1.0])
def test_a_play_far_narrower_than_the_travel_is_determined(width: float) -> None:
    """The joint and what follows it with a play move together: both at random would be thousands of widths apart."""
    machine = read_machine("bridge_cmm")
    extended = known(machine, made("hysteresis", joint="X", width=width))
    fit = fit_machine(extended, survey_of(extended, random_points(machine, 60, 4), {}))
    assert not {i for i in fit.solution.groups.no_effect if "hysteresis" in i}
