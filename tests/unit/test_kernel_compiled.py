"""The compiled loops against NumPy; where Numba is not installed, the same loops as plain Python."""

from __future__ import annotations

from dataclasses import fields

import casadi as ca
import numpy as np
import pytest

from errormodel import kernel, kernel_compiled
from errormodel.arrays import Array
from errormodel.kernel import Kernel, compiled
from identification.observation.models import GapView, PositionView, View
from identification.observation.normal_equations import Sums, accumulate
from tests.benchmarks import five_axis, ours

ROWS = 90


@pytest.fixture
def always(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiled loops for any number of rows, whether or not Numba is there."""
    monkeypatch.setattr(kernel, "_compiled", lambda: kernel_compiled)
    monkeypatch.setattr(kernel, "COMPILED_ROWS", 0)


def both(made: Kernel, rows: list[Array], p: Array) -> tuple[Array, Array]:
    """All functions by NumPy and by the loops, in blocks that do not divide the rows."""
    found = []
    for loops in (None, kernel_compiled):
        blocks = [np.array(f) for _, f in made.blocks(rows, p, size=40, loops=loops)]
        found.append(np.hstack(blocks))
    return found[0], found[1]


def test_m_is_the_same_to_the_last_bit() -> None:
    plain, fast = both(ours.kernel(), ours._rows(five_axis.poses(ROWS)), np.zeros(0))
    np.testing.assert_array_equal(fast, plain)


def test_every_step_on_arrays_and_scalars() -> None:
    x, y, a, b = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("a"), ca.SX.sym("b")
    arithmetic = [
        f(*pair)
        for f in (lambda v, w: v + w, lambda v, w: v - w, lambda v, w: v * w, lambda v, w: v / w)
        for pair in ((x, y), (y, x), (x, a), (a, x), (x, 3), (3, x), (a, b), (x, x))
    ]
    slow = [ca.sin(x) * ca.cos(x), ca.if_else(x > a, y, -y) - ca.exp(-x * y), ca.atan2(ca.sqrt(x), y) / a]
    made = Kernel(ca.vertcat(x, y), ca.vertcat(a, b), ca.vertcat(*arithmetic, *slow, -x, x**2, a, 2.5))
    assert {s[0] for s in made.tape.steps} >= set(kernel.ARITHMETIC) - {"negative"}
    rng = np.random.default_rng(3)
    plain, fast = both(made, [rng.normal(0, 2, ROWS), np.where(rng.random(ROWS) < 0.1, 0, 1.5)], np.array([0.3, -7.0]))
    np.testing.assert_array_equal(fast, plain)


@pytest.mark.usefixtures("always")
@pytest.mark.parametrize("weights", [False, True], ids=["one weight", "weights"])
@pytest.mark.parametrize("stored", [False, True], ids=["exact", "stored gaps"])
@pytest.mark.parametrize("gram", [False, True], ids=["slopes", "Gram matrix"])
def test_sums_are_the_same(weights: bool, stored: bool, gram: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(4)
    values = rng.normal(0, 1e-4, len(five_axis.IDS))
    held = np.zeros(len(ours.chain().ids))
    place = {name: k for k, name in enumerate(five_axis.IDS)}
    q = five_axis.poses(ROWS)
    measured = five_axis.nominal(q) + rng.normal(0, 0.01, (ROWS, 3))

    def summed() -> tuple[Sums, Array | None]:
        view: View = ours._view(q, measured)
        own = {f.name: getattr(view, f.name) for f in fields(View)}
        if weights:
            own["whitener"] = np.random.default_rng(5).uniform(0.5, 2, ROWS)
        gap = np.array(measured.T) if stored else None
        view = GapView(**own, gap=gap) if gap is not None else PositionView(**own, measured=measured)
        return accumulate([view], place, values, held, exact=not stored, gram=gram)["position"], gap

    fast, left = summed()
    monkeypatch.setattr(kernel, "COMPILED_ROWS", ROWS + 1)
    plain, known = summed()
    for name in ("gram", "slope", "square"):
        own, other = np.asarray(getattr(fast, name)), np.asarray(getattr(plain, name))
        np.testing.assert_allclose(own, other, rtol=1e-12, atol=1e-12 * np.abs(other).max())
    assert (fast.gram != 0).any() == gram
    if stored:
        np.testing.assert_allclose(left, known, rtol=1e-12, atol=1e-12)


def test_few_rows_are_not_worth_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel, "_compiled", lambda: kernel_compiled)
    assert compiled(kernel.COMPILED_ROWS - 1) is None
    assert compiled(kernel.COMPILED_ROWS) is kernel_compiled
