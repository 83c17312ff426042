"""The NumPy kernels against CasADi itself, and the chain against kinematics written again from the contract."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation

from errormodel.chain import Chain, What
from errormodel.conventions import MOTIONS, TRANSLATIONS
from errormodel.machine import Joint, Machine, Shape
from errormodel.machine_file import library, read_machine
from tests.helpers.chains import Array, errors, machines, poses
from tests.helpers.nightly import first_of

MACHINES = sorted(library())
ALL: tuple[What, ...] = ("nominal", "actual", "design", "linearised", "terms")


def evaluated(rows: ca.SX, scalars: ca.SX, outputs: ca.SX, x: list[Array], p: Array) -> Array:
    """All outputs (n_outputs, n) as CasADi's own virtual machine gives them."""
    function = ca.Function("f", [rows, scalars], [ca.densify(ca.vec(outputs))])
    n = len(x[0])
    return function.map(n)(np.array(x), ca.repmat(ca.DM(p), 1, n)).full()


def assert_same(found: Array, expected: Array, tolerance: float = 1e-12) -> None:
    """Relative to the largest value of each output."""
    assert found.shape == expected.shape
    scale = np.abs(expected).max(axis=1, keepdims=True, initial=0)
    allowed = tolerance * scale + 1e-15 * scale.max(initial=0)
    assert (np.abs(found - expected) <= allowed).all()


def check_chain(machine: Machine, p: Array, n: int) -> None:
    chain = Chain(machine)
    rows = poses(machine, n)
    for what in ALL:
        ids = chain.ids if what != "terms" else chain.machine_ids
        kernel = chain.kernel(what, ids)
        expected = evaluated(chain.rows, chain.values, chain.expression(what, ids), rows, p)
        assert_same(kernel(rows, p), expected)
        assert_same(kernel.expand(kernel.functions(rows, p)), expected)


@pytest.mark.parametrize("name", first_of(MACHINES, 4))
def test_every_kernel_of_the_library_is_casadi(name: str) -> None:
    machine = read_machine(name)
    check_chain(machine, errors(Chain(machine), 1, um=1e3, urad=1e4), 50)


@pytest.mark.long
@settings(max_examples=12)
@given(machines(), st.integers(0, 99))
def test_every_kernel_of_any_chain_is_casadi(machine: Machine, seed: int) -> None:
    chain = Chain(machine)
    p = np.random.default_rng(seed).normal(0, 1e-2, len(chain.ids))
    check_chain(machine, p, 7)


# ---- kinematics, once more, as the contract words them


def rotation(axis: int, angle: float) -> Array:
    return Rotation.from_rotvec(angle * np.eye(3)[axis]).as_matrix()


def transform(shift: Array, turn: Array) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = turn, shift
    return out


def small(six: Array) -> Array:
    """``Trans(d) Rot(e)``."""
    turn = rotation(0, six[3]) @ rotation(1, six[4]) @ rotation(2, six[5])
    return transform(six[:3], turn)


def joint_motion(joint: Joint, q: float, value: dict[str, float]) -> Array:
    """The six error motions of a joint at q."""
    six, axis = np.zeros(6), np.array(joint.axis)
    largest, (low, high) = max(map(abs, joint.travel)), joint.travel
    for k, motion in enumerate(MOTIONS):
        if motion not in joint.models:
            continue
        basis = joint.models[motion]

        def of(label: str, motion: str = motion) -> float:
            return value[f"{joint.name}.{motion}.{label}"]

        match basis.kind:
            case "first-order" if joint.type == "rotary":
                six[k] += of("1") * np.sin(q / 2)
            case "first-order" if motion in TRANSLATIONS:
                six[:3] += of("1") * q * axis
            case "first-order":
                six[k] += of("1") * q
                six[:3] += of("1") * q**2 / 2 * np.cross(np.eye(3)[k - 3], axis)
            case "polynomial":
                six[k] += sum(of(f"{i}") * (q / largest) ** i for i in range(1, basis.n + 1))
            case "harmonic":
                six[k] += sum(
                    of(f"sin{i}") * np.sin(i * q) + of(f"cos{i}") * (np.cos(i * q) - 1) for i in range(1, basis.n + 1)
                )
            case "spline":  # knots of n equal intervals, carried on beyond the ends
                step = (high - low) / basis.n
                knots = low + step * np.arange(-3, basis.n + 4)
                coefficients = np.array([0.0, *(of(f"s{i}") for i in range(1, basis.n + 3))])
                spline = BSpline(knots, coefficients, 3)
                six[k] += spline(np.clip(q, low, high)) - spline(np.clip(0.0, low, high))
    return six


def pose_by_hand(machine: Machine, command: dict[str, float], tool: Array, value: dict[str, float]) -> Array:
    def constants(name: str) -> Array:
        return np.array([value.get(f"{name}.{m}", 0.0) for m in MOTIONS])

    pose = small(constants("frame"))
    for element in machine.elements:
        if isinstance(element, Shape):
            six = constants(element.name)
            a, b, c = element.rotation
            pose = pose @ transform(np.array(element.offset), np.eye(3)) @ small(six)
            pose = pose @ transform(np.zeros(3), rotation(0, a) @ rotation(1, b) @ rotation(2, c))
            continue
        q, axis = command[element.name], np.array(element.axis)
        six = joint_motion(element, q, value)
        if element.type == "prismatic":
            pose = pose @ transform(q * axis, np.eye(3)) @ small(six)
        else:
            pose = pose @ small(six) @ transform(np.zeros(3), Rotation.from_rotvec(q * axis).as_matrix())
    return pose @ transform(tool, np.eye(3)) @ small(constants("tool"))


def check_by_hand(machine: Machine, p: Array, n: int) -> None:
    chain = Chain(machine)
    rows = poses(machine, n, tools=(machine.tool, (10.0, -20.0, -400.0)))
    found = chain.kernel("actual")(rows, p)
    value = dict(zip(chain.ids, p.tolist(), strict=True))
    for k in range(n):
        command = {name: float(c[k]) for name, c in zip(chain.channels, rows, strict=True)}
        expected = pose_by_hand(machine, command, np.array([command[f"tool_{a}"] for a in "xyz"]), value)
        size = max(chain.size, float(np.abs(expected[:3, 3]).max()))
        np.testing.assert_allclose(found[:3, k], expected[:3, 3], rtol=0, atol=1e-11 * size)
        np.testing.assert_allclose(found[3:, k].reshape(3, 3).T, expected[:3, :3], rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", MACHINES)
def test_the_library_moves_as_the_contract_says(name: str) -> None:
    machine = read_machine(name)
    p = np.random.default_rng(5).normal(0, 1e-3, len(Chain(machine).ids))
    check_by_hand(machine, p, 5)


@settings(max_examples=15)
@given(machines(), st.integers(0, 99))
def test_any_chain_moves_as_the_contract_says(machine: Machine, seed: int) -> None:
    check_by_hand(machine, np.random.default_rng(seed).normal(0, 1e-2, len(Chain(machine).ids)), 2)


# ---- M


def remainder(chain: Chain, rows: list[Array], p: Array) -> Array:
    """Exact minus linear: positions (mm) and rotation vectors (rad) of all poses."""
    exact, nominal = (chain.kernel("actual")(rows, v) for v in (p, np.zeros_like(p)))
    m = chain.kernel("design", chain.ids)(rows, np.zeros_like(p)).reshape(len(p), 6, -1)
    linear = np.einsum("p,pim->im", p, m)
    turn, before = (v[3:].reshape(3, 3, -1).transpose(2, 1, 0) for v in (exact, nominal))
    turned = Rotation.from_matrix(turn @ before.transpose(0, 2, 1)).as_rotvec().T
    return np.vstack([exact[:3] - nominal[:3] - linear[:3], chain.size * (turned - linear[3:])])


@settings(max_examples=10)
@given(machines(), st.integers(0, 99))
def test_what_m_leaves_out_is_of_second_order(machine: Machine, seed: int) -> None:
    chain = Chain(machine)
    rows, p = poses(machine, 20), np.random.default_rng(seed).normal(0, 1, len(chain.ids))
    p *= 1e-3 * chain.size / np.abs(chain.kernel("design", chain.ids)(rows, p)).max()  # about 0.1 % of the machine
    sizes = [float(np.linalg.norm(remainder(chain, rows, p * f))) for f in (1.0, 0.5, 0.25)]
    for large, half in pairwise(sizes):
        assert half < 0.27 * large + 1e-10 * chain.size


def check_derivative(machine: Machine, p: Array) -> None:
    chain = Chain(machine)
    rows = poses(machine, 4)
    actual, m = chain.kernel("actual"), chain.kernel("linearised", chain.ids)(rows, p).reshape(len(p), 6, -1)
    unit = np.abs(chain.kernel("terms", chain.ids)(rows, p)).reshape(-1, 6, 4)[: len(p)].max(axis=(1, 2))
    for k in range(len(p)):
        step = np.zeros_like(p)
        step[k] = 1e-4 / max(unit[k], 1e-12)
        after, before = actual(rows, p + step), actual(rows, p - step)
        slope = (after[:3] - before[:3]) / (2 * step[k])
        size = max(chain.size * unit[k], 1e-12)
        np.testing.assert_allclose(m[k, :3], slope, rtol=0, atol=3e-8 * size, err_msg=chain.ids[k])
        turn, back = (v[3:].reshape(3, 3, -1).transpose(2, 1, 0) for v in (after, before))
        turned = Rotation.from_matrix(turn @ back.transpose(0, 2, 1)).as_rotvec().T / (2 * step[k])
        np.testing.assert_allclose(m[k, 3:], turned, rtol=0, atol=3e-8 * max(unit[k], 1e-12), err_msg=chain.ids[k])


@pytest.mark.long
@pytest.mark.parametrize("name", MACHINES)
def test_m_is_the_derivative_everywhere(name: str) -> None:
    machine = read_machine(name)
    for size in (0.0, 1e-2):
        check_derivative(machine, np.random.default_rng(2).normal(0, size, len(Chain(machine).ids)))


@pytest.mark.long
@settings(max_examples=10)
@given(machines(most_joints=4), st.integers(0, 9))
def test_m_of_any_chain_is_its_derivative(machine: Machine, seed: int) -> None:
    check_derivative(machine, np.random.default_rng(seed).normal(0, 1e-2, len(Chain(machine).ids)))
