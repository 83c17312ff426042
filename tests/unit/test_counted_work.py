"""What a fit of many rows costs, counted and not timed: operations, passes over the rows, and bytes.

A number here may fall; where one has to rise, the reason belongs into the commit.
"""

from __future__ import annotations

import tracemalloc
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from errormodel import kernel
from errormodel.kernel import Kernel
from errormodel.kernel_fused import fused
from identification.estimation.least_squares import solve
from identification.observation import sums as passes
from tests.benchmarks import five_axis, ours

ROWS = 110_000  # enough for axes of their own
SAMPLES = 3000  # rows for ranks and norms, whatever the number of rows


def test_operations_of_m() -> None:
    """Of the five-axis machine: 46 distinct functions of 156 entries, in 81 steps, one of them slow."""
    made = ours.kernel()
    kinds = Counter(kind for kind, _, _ in made.tape.steps)
    assert (made.n_functions, made.n_outputs) == (46, 156)
    assert made.tape.registers <= 6
    assert sum(kinds.values()) <= 81
    assert {k: n for k, n in kinds.items() if k not in kernel.ARITHMETIC} == {"tan": 1}
    assert kinds["divide"] <= 2  # as long as seven products each


def test_operations_of_a_fit() -> None:
    """In axes of their own: 24 functions and the gap in 72 steps, a third of the products; all of it is compiled."""
    made = ours.turned_kernel()
    assert (made.n_functions, made.n_outputs) == (24 + 3, 3 * len(five_axis.IDS) + 3)
    assert len(made.tape.steps) <= 72
    assert made.tape.registers <= 7
    assert len(fused(made).steps) <= 66  # sine and cosine are one step each
    assert fused(made).before.n_functions == 0  # no step is left to NumPy
    view, columns = ours._view(five_axis.poses(1), np.zeros((1, 3))), np.arange(len(five_axis.IDS))
    tiles = []
    for gram in (True, False):
        task = passes.Pass(view, columns, None, view.at_zero, None, gram)
        work = passes._Turned(task, made, passes.selectors_of(made, 3, columns), view.in_other_axes)  # type: ignore[arg-type]
        tiles.append(len(work.tiles[1]))
    assert tiles == [25, 7]  # of 16 products each


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Rows that kernels evaluate, by the number of their functions, without what is sampled."""
    rows: Counter[str] = Counter()
    blocks, task = Kernel.blocks, passes.Pass.run

    def counting(self: Kernel, columns: Any, *arguments: Any, **named: Any) -> Iterator[Any]:
        if len(columns[0]) > SAMPLES:
            rows["M" if self.n_functions > 12 else "points"] += len(columns[0])
        return blocks(self, columns, *arguments, **named)

    def summing(self: Any) -> Any:
        rows["Gram" if self.gram else "slopes"] += len(self.view)
        return task(self)

    monkeypatch.setattr(Kernel, "blocks", counting)
    monkeypatch.setattr(passes.Pass, "run", summing)
    return rows


def test_passes_of_a_fit(counted: Counter[str]) -> None:
    """A linear fit: the Gram matrix once, one refinement. On the exact kinematics, three; gaps come with M."""
    q = five_axis.poses(ROWS)
    measured = five_axis.measured(q, ours.as_design(ours.build(q), q))
    counted.clear()
    ours.fit(q, measured)
    assert counted == {"M": 2 * ROWS, "Gram": ROWS, "slopes": ROWS}
    counted.clear()
    found = solve(ours.chain(), [ours._view(q, measured)], five_axis.IDS)
    assert found.converged
    assert counted == {"M": 4 * ROWS, "Gram": ROWS, "slopes": 3 * ROWS}


def test_calls_of_compiled_loops(counted: Counter[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """One call for each range of rows and pass, on rows where they are: nothing goes back to the interpreter."""
    from errormodel import kernel_fused

    calls: list[int] = []
    q = five_axis.poses(ROWS)
    measured = five_axis.measured(q, ours.as_design(ours.build(q), q))
    counted.clear()
    monkeypatch.setattr(kernel, "_compiled", lambda: True)
    monkeypatch.setattr(kernel_fused, "sums", lambda *given: calls.append(given[4]))
    task = passes.Pass(ours._view(q, measured), np.arange(52), None, np.zeros(100), None, True)
    with ours.compiled_from(0):
        tracemalloc.start()
        task.run()
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    whole, rest = divmod(ROWS, passes.SHORTEST_ROWS)
    assert sorted(calls) == [rest, *[passes.SHORTEST_ROWS] * whole]
    assert counted == {"Gram": ROWS}
    assert peak < 1e6  # strips of 256 rows, and not one column of all rows


def test_rows_of_slopes() -> None:
    """OpenBLAS takes half as long for four rows as for three; a single one stays alone."""
    kernel = ours.kernel()
    view = ours._view(five_axis.poses(1), np.zeros((1, 3)))
    columns = np.arange(len(five_axis.IDS))
    task = passes.Pass(view, columns, np.ones(len(columns)), view.at_zero, None, False)
    whole = passes.selectors_of(kernel, 3, columns)
    rows = [len(passes._Alike(task, kernel, whole[:c]).slopes) for c in (1, 2, 3)]  # type: ignore[arg-type]
    assert rows == [1, 2, 4]


def test_bytes_of_a_fit() -> None:
    """Nothing is stored of each row; all is in blocks."""
    peak = []
    for rows in (ROWS, 3 * ROWS):
        q = five_axis.poses(rows)
        measured = five_axis.nominal(q) + np.random.default_rng(1).normal(0, 0.01, (rows, 3))
        tracemalloc.start()
        solve(ours.chain(), [ours._view(q, measured)], five_axis.IDS, exact=False)
        peak.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peak[1] - peak[0] < 2 * ROWS * 2
    assert peak[0] < 16e6
