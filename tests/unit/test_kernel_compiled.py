"""The compiled loops against NumPy; where Numba is not installed, the same loops as plain Python."""

from __future__ import annotations

from dataclasses import fields

import casadi as ca
import numpy as np
import pytest

from errormodel import kernel
from errormodel.arrays import Array
from errormodel.kernel import Kernel, compiled
from errormodel.kernel_compiled import fill, run, sine
from errormodel.kernel_fused import _aligned, _places, fused
from identification.observation import sums as passes
from identification.observation.models import GapView, PositionView, View
from identification.observation.normal_equations import accumulate
from identification.observation.sums import Sums
from identification.runtime.parallel import one_core
from tests.benchmarks import five_axis, ours

ROWS = 90
ROUND_OFF = 1e-14  # of a function relative to its largest value: sines of both ways differ in their last bit


def loops(monkeypatch: pytest.MonkeyPatch, wanted: bool) -> None:
    """Compiled loops for any number of rows, whether or not Numba is there, or none; other axes in both cases."""
    monkeypatch.setattr(kernel, "_compiled", lambda: wanted)
    monkeypatch.setattr(kernel, "COMPILED_ROWS", 0)
    monkeypatch.setattr(passes, "TURNED_ROWS", 0)


def both(made: Kernel, rows: list[Array], p: Array) -> tuple[Array, Array]:
    """All functions by NumPy and by the loops."""
    plain, own, n = made.functions(rows, p), fused(made), len(rows[0])
    slow = iter(own.before.functions(rows, p) if own.before.n_functions else ())
    memory, places = _places([rows[k] if k < own.given else next(slow) for k in own.tape.inputs])
    first = len(own.tape.inputs) + own.tape.registers
    work = _aligned(first + made.n_functions)
    fill(memory, places, np.uintp(0), work, np.uintp(n))
    with np.errstate(all="ignore"):  # of the loops in plain Python, as their caller has it
        run(own.steps, np.append(own.tape.values(p), 0.0), work, n)
    return plain, work[first:, :n]


def test_m_is_the_same() -> None:
    plain, fast = both(ours.kernel(), ours._rows(five_axis.poses(ROWS)), np.zeros(0))
    assert np.abs(fast - plain).max() > 0  # else nothing was compared
    np.testing.assert_array_less(np.abs(fast - plain).max(axis=1), ROUND_OFF * np.abs(plain).max(axis=1) + 1e-300)


def test_every_step_on_arrays_and_scalars() -> None:
    x, y, a, b = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("a"), ca.SX.sym("b")
    arithmetic = [
        f(*pair)
        for f in (lambda v, w: v + w, lambda v, w: v - w, lambda v, w: v * w, lambda v, w: v / w)
        for pair in ((x, y), (y, x), (x, a), (a, x), (x, 3), (3, x), (a, b), (x, x))
    ]
    slow = [ca.if_else(x > a, y, -y) - ca.exp(-x * y), ca.atan2(ca.sqrt(x), y) / a, ca.exp(ca.tan(y)) + x]
    made = Kernel(ca.vertcat(x, y), ca.vertcat(a, b), ca.vertcat(*arithmetic, *slow, -x, x**2, a, 2.5))
    assert {s[0] for s in made.tape.steps} >= set(kernel.ARITHMETIC) - {"negative"}
    assert fused(made).before.n_functions == 5  # what the loops do not know, and the others need
    rng = np.random.default_rng(3)
    plain, fast = both(made, [rng.normal(0, 2, ROWS), np.where(rng.random(ROWS) < 0.1, 0, 1.5)], np.array([0.3, -7.0]))
    np.testing.assert_array_equal(fast, plain)


@pytest.mark.parametrize("reach", [1e-9, 1.0, 7.0, 1e5])
def test_sines_and_cosines(reach: float) -> None:
    angles = np.append(np.random.default_rng(5).uniform(-reach, reach, 200), [0.0, np.pi / 4, np.pi, -np.pi / 2])
    work = np.zeros((3, len(angles)))
    work[0] = angles
    sine(work, 0, 1, len(angles), 0.0)
    sine(work, 0, 2, len(angles), 1.0)
    exact = np.array([[float(f(ca.DM(x))) for x in angles] for f in (ca.sin, ca.cos)])
    np.testing.assert_allclose(work[1:], exact, rtol=3e-16, atol=1e-16)
    np.testing.assert_allclose(np.square(work[1:]).sum(axis=0), 1, rtol=5e-16)


def test_rows_of_any_stride_are_read_where_they_are() -> None:
    table = np.arange(60.0).reshape(20, 3)
    rows = [table[:, 1], np.arange(20.0), np.broadcast_to(7.0, 20), table[::-1, 2]]
    work = np.zeros((4, 10))
    fill(*_places(rows), np.uintp(4), work, np.uintp(10))
    np.testing.assert_array_equal(work, np.array([r[4:14] for r in rows]))


@pytest.mark.parametrize("weights", [False, True], ids=["one weight", "weights"])
@pytest.mark.parametrize("gap", ["nominal", "actual", "linear", "stored"])
@pytest.mark.parametrize("gram", [False, True], ids=["slopes", "Gram matrix"])
def test_sums_are_the_same(weights: bool, gap: str, gram: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the loops, by NumPy in the same axes, and in those of the reference."""
    rng = np.random.default_rng(4)
    values = rng.normal(0, 1e-4, len(five_axis.IDS)) * (gap in ("actual", "linear"))
    held = np.zeros(len(ours.chain().ids))
    place = {name: k for k, name in enumerate(five_axis.IDS)}
    q = five_axis.poses(ROWS)
    measured = five_axis.nominal(q) + rng.normal(0, 0.01, (ROWS, 3))
    view: View = ours._view(q, measured)
    own = {f.name: getattr(view, f.name) for f in fields(View)}
    if weights:
        own["whitener"] = rng.uniform(0.5, 2, ROWS)
    view = PositionView(**own, measured=measured)
    view = GapView.of(view, held) if gap == "stored" else view
    monkeypatch.setattr(passes, "RANGE_ROWS", 40)

    def summed() -> Sums:
        exact = gap in ("nominal", "actual")
        return accumulate([view], place, values, held, exact=exact, gram=gram, lengths=True)["position"]

    reference = summed()
    for wanted in (False, True):
        loops(monkeypatch, wanted)
        sums = summed()
        scale = np.sqrt(np.outer(np.diag(reference.gram), np.diag(reference.gram))) + 1
        np.testing.assert_allclose(sums.gram / scale, reference.gram / scale, atol=1e-12)
        assert (sums.gram != 0).any() == gram
        np.testing.assert_allclose(sums.slope, reference.slope, rtol=1e-9, atol=1e-12 * np.abs(reference.slope).max())
        found = [(s.square, s.length, s.longest) for s in (sums, reference)]
        np.testing.assert_allclose(*found, rtol=1e-10)  # 1e-13 of the machine's size beside residuals of 0.01 mm


@pytest.mark.parametrize("wanted", [False, True], ids=["NumPy", "loops"])
def test_same_bytes_on_any_number_of_cores(wanted: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 3)
    monkeypatch.setattr(passes, "RANGE_ROWS", 20)
    loops(monkeypatch, wanted)
    q = five_axis.poses(ROWS)
    views = [ours._view(q, five_axis.nominal(q) + np.random.default_rng(6).normal(0, 0.01, (ROWS, 3)))]
    place = {name: k for k, name in enumerate(five_axis.IDS)}
    many = accumulate(views, place, np.zeros(len(place)), np.zeros(len(ours.chain().ids)))["position"]
    with one_core():
        one = accumulate(views, place, np.zeros(len(place)), np.zeros(len(ours.chain().ids)))["position"]
    assert many.gram.tobytes() == one.gram.tobytes()
    assert many.slope.tobytes() == one.slope.tobytes()


def test_few_rows_are_not_worth_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel, "_compiled", lambda: True)
    assert not compiled(kernel.COMPILED_ROWS - 1)
    assert compiled(kernel.COMPILED_ROWS)
