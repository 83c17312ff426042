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
from identification.estimation.least_squares import solve
from identification.observation import normal_equations
from tests.benchmarks import five_axis, ours

ROWS = 70_000  # more than one core works on at a time
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


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Rows that kernels evaluate, by the number of their functions, without what is sampled."""
    rows: Counter[str] = Counter()
    blocks, task = Kernel.blocks, normal_equations._Task.run

    def counting(self: Kernel, columns: Any, *arguments: Any, **named: Any) -> Iterator[Any]:
        if len(columns[0]) > SAMPLES:
            rows["M" if self.n_functions > 12 else "points"] += len(columns[0])
        return blocks(self, columns, *arguments, **named)

    def summing(self: Any) -> Any:
        rows["Gram" if self.gram else "slopes"] += len(self.view)
        return task(self)

    monkeypatch.setattr(Kernel, "blocks", counting)
    monkeypatch.setattr(normal_equations._Task, "run", summing)
    return rows


def test_passes_of_a_fit(counted: Counter[str]) -> None:
    """A linear fit: gaps once, the Gram matrix once, one refinement. On the exact kinematics, three."""
    q = five_axis.poses(ROWS)
    measured = five_axis.measured(q, ours.as_design(ours.build(q), q))
    counted.clear()
    ours.fit(q, measured)
    assert counted == {"points": ROWS, "M": 2 * ROWS, "Gram": ROWS, "slopes": ROWS}
    counted.clear()
    found = solve(ours.chain(), [ours._view(q, measured)], five_axis.IDS)
    assert found.converged
    assert counted == {"points": 4 * ROWS, "M": 4 * ROWS, "Gram": ROWS, "slopes": 3 * ROWS}


def test_rows_of_slopes() -> None:
    """OpenBLAS takes half as long for four rows as for three; a single one stays alone."""
    kernel = ours.kernel()
    view = ours._view(five_axis.poses(1), np.zeros((1, 3)))
    columns = np.arange(len(five_axis.IDS))
    task = normal_equations._Task(view, columns, np.ones(len(columns)), view.at_zero, None, False)
    whole = normal_equations.selectors_of(kernel, 3, columns)
    rows = [len(normal_equations._Alike(task, kernel, whole[:c], None).slopes) for c in (1, 2, 3)]  # type: ignore[arg-type]
    assert rows == [1, 2, 4]


def test_bytes_of_a_fit() -> None:
    """The gaps are stored, 24 bytes a row; all else is in blocks that each core has of its own."""
    peak = []
    for rows in (ROWS, 3 * ROWS):
        q = five_axis.poses(rows)
        measured = five_axis.nominal(q) + np.random.default_rng(1).normal(0, 0.01, (rows, 3))
        tracemalloc.start()
        solve(ours.chain(), [ours._view(q, measured)], five_axis.IDS, exact=False)
        peak.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peak[1] - peak[0] < 2 * ROWS * 28
    assert peak[0] < ROWS * 28 + 16e6
