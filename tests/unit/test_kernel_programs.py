"""Kernels of expressions that no chain has: every operation, signs, switches, infinities, blocks and buffers."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from errormodel.arrays import as_rows
from errormodel.chain import Chain
from errormodel.kernel import KERNEL_BLOCK_ROWS, Kernel
from errormodel.machine_file import read_machine
from tests.helpers.chains import Array, errors, poses

X, P = ca.SX.sym("x", 3), ca.SX.sym("p", 2)
x, y, z = (X[k] for k in range(3))
a, b = P[0], P[1]

SPECIAL = np.array([0.0, 1.0, -1.0, 0.5, -2.5, 3.0, np.inf, -np.inf, np.nan, 1e-300, -1e300])


def evaluated(outputs: ca.SX, rows: list[Array], p: Array) -> Array:
    """As CasADi's own virtual machine gives it, (n_outputs, n)."""
    n = len(rows[0])
    function = ca.Function("f", [X, P], [ca.densify(ca.vec(outputs))])
    return function.map(n)(np.array(rows), ca.repmat(ca.DM(p), 1, n)).full()


def check(outputs: ca.SX, rows: list[Array], p: Array, tolerance: float = 1e-12) -> None:
    kernel = Kernel(X, P, outputs)
    expected = evaluated(outputs, rows, p)
    np.testing.assert_allclose(kernel(rows, p), expected, rtol=tolerance, atol=1e-290)
    np.testing.assert_allclose(kernel.expand(kernel.functions(rows, p)), expected, rtol=tolerance, atol=1e-290)


UNARY = {
    "sin": ca.sin, "cos": ca.cos, "tan": ca.tan, "asin": ca.asin, "acos": ca.acos, "atan": ca.atan, "sinh": ca.sinh,
    "cosh": ca.cosh, "tanh": ca.tanh, "asinh": ca.asinh, "acosh": ca.acosh, "atanh": ca.atanh, "exp": ca.exp,
    "expm1": ca.expm1, "log": ca.log, "log1p": ca.log1p, "sqrt": ca.sqrt, "sq": lambda v: v**2, "inv": lambda v: 1 / v,
    "fabs": ca.fabs, "sign": ca.sign, "floor": ca.floor, "ceil": ca.ceil, "not": ca.logic_not, "twice": lambda v: 2 * v,
    "cube": lambda v: v**3, "root": lambda v: v**0.3,
}  # fmt: skip
BINARY = {
    "add": lambda v, w: v + w, "sub": lambda v, w: v - w, "mul": lambda v, w: v * w, "div": lambda v, w: v / w,
    "pow": lambda v, w: v**w, "fmin": ca.fmin, "fmax": ca.fmax, "atan2": ca.atan2, "fmod": ca.fmod,
    "hypot": ca.hypot, "copysign": ca.copysign, "lt": lambda v, w: v < w, "le": lambda v, w: v <= w,
    "eq": ca.eq, "ne": ca.ne, "and": ca.logic_and, "or": ca.logic_or, "if": lambda v, w: ca.if_else(v > 1, w, v),
}  # fmt: skip


@pytest.mark.parametrize("name", UNARY)
def test_functions_of_one_value(name: str) -> None:
    """Of rows and of parameters, with either sign outside and inside, ordinary and not."""
    f = UNARY[name]
    values = np.concatenate([np.random.default_rng(0).normal(0, 2, 60), SPECIAL])
    outputs = ca.vertcat(f(x), f(-x), -f(x), -f(-x), f(a), -f(-a), f(a) * x, f(y - x), f(x - y), f(-3 * x) * f(x))
    for p in (0.3, -1.5):
        check(outputs, as_rows(values, np.roll(values, 1), values), np.array([p, 1.0]))


@pytest.mark.parametrize("name", BINARY)
def test_functions_of_two_values(name: str) -> None:
    f = BINARY[name]
    rng = np.random.default_rng(1)
    left, right = (np.concatenate([rng.normal(0, 2, 60), np.ravel(g)]) for g in np.meshgrid(SPECIAL, SPECIAL))
    outputs = ca.vertcat(
        f(x, y), f(y, x), f(-x, y), f(x, -y), f(-x, -y), -f(x, y), f(x, 2.0), f(-2.0, x), f(x, a), f(b, x), f(a, b),
        f(x, x), f(-x, x), f(x - y, y - x), f(f(x, z), f(z, x)),
    )  # fmt: skip
    check(outputs, as_rows(left, right, rng.normal(0, 2, len(left))), np.array([0.7, -1.2]))


def test_scalars_may_be_infinite_where_nobody_looks() -> None:
    """A switch on a parameter at 0/0 warns nobody, and the branch not taken does not matter."""
    outputs = ca.vertcat(ca.if_else(a > 0, ca.log(a) / a, 1), x * ca.if_else(a == 0, 1, ca.sin(a) / a))
    check(outputs, [np.arange(5.0)] * 3, np.zeros(2))


def test_rows_may_be_infinite_where_nobody_looks() -> None:
    outputs = ca.vertcat(
        ca.if_else(x > 0, ca.log(x), -5), ca.if_else(x == 0, 1, ca.sin(x) / x), ca.if_else(x < 0, -1 / x, y)
    )
    check(outputs, [np.array([-1.0, 0.0, 2.0])] * 3, np.zeros(2))
    assert np.isfinite(Kernel(X, P, outputs)([np.array([-1.0, 0.0, 2.0])] * 3, np.zeros(2))).all()


def test_a_difference_keeps_its_side_of_the_cut() -> None:
    """x - y and y - x are one function up to sign, but both are +0 where x is y: atan2 must not jump to -pi."""
    check(ca.vertcat(ca.atan2(x - y, -1), ca.atan2(y - x, -1), x - y, y - x), [np.array([1.0, 2.0])] * 3, np.zeros(2))


EXACT = {
    "add": lambda v, w: v + w, "sub": lambda v, w: v - w, "mul": lambda v, w: v * w, "neg": lambda v, w: -v,
    "tame": lambda v, w: v / (1 + w**2), "sq": lambda v, w: v**2, "root": lambda v, w: ca.sqrt(ca.fabs(v)),
    "fmin": ca.fmin, "fmax": ca.fmax, "sign": lambda v, w: ca.sign(v), "floor": lambda v, w: ca.floor(w),
    "if": lambda v, w: ca.if_else(v < w, -v, w), "sinus": lambda v, w: ca.if_else(v, w, -w),
}  # fmt: skip


@settings(max_examples=60)
@given(
    st.lists(
        st.tuples(st.sampled_from(sorted(EXACT)), st.integers(0, 99), st.integers(0, 99)), min_size=1, max_size=25
    ),
    st.integers(0, 99),
)
def test_any_program_of_exact_operations_is_casadi_to_the_last_bit(
    steps: list[tuple[str, int, int]], seed: int
) -> None:
    nodes = [x, y, z, a, b, ca.SX(1), ca.SX(-2.5), ca.SX(0)]
    for name, i, k in steps:
        nodes.append(EXACT[name](nodes[-1 - i % len(nodes)], nodes[k % len(nodes)]))
    rng = np.random.default_rng(seed)
    outputs = ca.vertcat(*nodes[-8:], -nodes[-1], nodes[0])
    rows = [rng.normal(0, 1, 9).round(1) for _ in range(3)]
    p = rng.normal(0, 1, 2).round(1)
    np.testing.assert_array_equal(Kernel(X, P, outputs)(rows, p), evaluated(outputs, rows, p))


# ---- outputs, blocks, buffers

OUTPUTS = ca.vertcat(
    ca.horzcat(x * y, -x * y, 0, 2), ca.horzcat(y * x, ca.sin(x) + a, -3, 1), ca.horzcat(x, -z, a, 0 * x)
)


@pytest.mark.parametrize(
    "n", [0, 1, 2, KERNEL_BLOCK_ROWS - 1, KERNEL_BLOCK_ROWS, KERNEL_BLOCK_ROWS + 1, 2 * KERNEL_BLOCK_ROWS + 3]
)
def test_blocks(n: int) -> None:
    rows = [np.random.default_rng(k).normal(size=n) for k in range(3)]
    kernel, p = Kernel(X, P, OUTPUTS), np.array([0.3, 0.4])
    expected = evaluated(OUTPUTS, rows, p) if n else np.zeros((12, 0))
    np.testing.assert_allclose(kernel(rows, p), expected, rtol=1e-12)
    parts = [(part, kernel.expand(f)) for part, f in kernel.blocks(rows, p, size=1000)]
    assert [part.start for part, _ in parts] == list(range(0, n, 1000))
    for part, values in parts:
        np.testing.assert_array_equal(values, kernel(rows, p)[:, part])


def test_equal_functions_are_computed_once() -> None:
    """x y, sin x + a, the constant 1, x, z and a: six, whatever their signs and factors."""
    kernel = Kernel(X, P, OUTPUTS)
    assert kernel.n_functions == 6
    assert set(kernel.coefficient) == {0.0, 1.0, -1.0, 2.0, -3.0}


def test_a_buffer_used_before() -> None:
    kernel = Kernel(X, P, OUTPUTS)
    rows = [np.linspace(-1, 1, 300) + k for k in range(3)]
    out = kernel(rows, [1.0, 2.0])
    again = kernel([2 * r for r in rows], [-1.0, 0.5], out=out)
    assert again is out
    np.testing.assert_array_equal(out, kernel([2 * r for r in rows], [-1.0, 0.5]))


def test_nothing_to_compute() -> None:
    for outputs in (ca.SX(3, 2), ca.SX.zeros(3, 2), ca.SX(3, 0)):
        kernel = Kernel(X, P, outputs)
        rows = [np.ones(4)] * 3
        assert (kernel(rows, [0.0, 0.0]) == 0).all()
        assert kernel.expand(kernel.functions(rows, [0.0, 0.0])).shape == (outputs.numel(), 4)


def test_warnings_of_the_caller_stay_his() -> None:
    before = np.geterr()
    for _ in zip(*(Kernel(X, P, OUTPUTS).blocks([np.ones(9)] * 3, [0.0, 0.0], size=2) for _ in range(2)), strict=True):
        assert np.geterr() == before
    assert np.geterr() == before


# ---- what a chain asks of its kernels


def test_fixed_channels_and_selected_outputs() -> None:
    machine = read_machine("trunnion_five_axis")
    chain = Chain(machine)
    rows, p = poses(machine, 30), errors(chain, 3)
    tool = dict(zip(chain.channels[-3:], machine.tool, strict=True))
    first = {chain.channels[0]: float(rows[0][0]), **tool}
    still = [np.full(30, rows[0][0]), *rows[1:]]
    for what, ids in (("actual", ()), ("nominal", ()), ("design", chain.ids), ("linearised", chain.ids[::-1])):
        whole = chain.kernel(what, ids)(still, p).reshape(max(len(ids), 1), -1, 30)  # type: ignore[call-overload]
        for outputs in ((0, 1, 2), (3, 4, 5), (2, 0), (4,)):
            part = chain.kernel(what, ids, first, outputs)(still, p).reshape(max(len(ids), 1), -1, 30)
            np.testing.assert_allclose(part, whole[:, list(outputs)], rtol=1e-12, atol=1e-12 * chain.size)


def test_columns_in_any_order() -> None:
    chain = Chain(read_machine("horizontal_three_axis"))
    rows, zero = poses(chain.machine, 5), np.zeros(len(chain.ids))
    whole = chain.kernel("design", chain.ids)(rows, zero).reshape(-1, 6, 5)
    some = chain.kernel("design", chain.ids[20:3:-2])(rows, zero).reshape(-1, 6, 5)
    np.testing.assert_allclose(some, whole[20:3:-2], rtol=1e-13)


def test_a_machine_without_errors() -> None:
    """Nothing but the frame and the tool to see."""
    machine = read_machine("six_axis_arm")
    bare = type(machine)("bare", tuple(type(e)(e.name, *_geometry(e)) for e in machine.elements), machine.tool)
    chain = Chain(bare)
    assert chain.machine_ids == ()
    assert chain.kernel("design", ())(poses(bare, 4), np.zeros(12)).shape == (0, 4)


def _geometry(element: object) -> tuple[object, ...]:
    return tuple(
        getattr(element, name) for name in ("offset", "rotation", "type", "axis", "travel") if hasattr(element, name)
    )
