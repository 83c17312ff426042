"""What the computer can do, by one thread and in seconds of CPU, beside what M and the fit ask of it."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from errormodel.kernel import KERNEL_BLOCK_ROWS
from identification.observation.models import GapView
from identification.runtime.blas import one_blas_thread
from identification.runtime.parallel import one_core
from tests.benchmarks import five_axis, ours

ROWS = 1 << 22  # of vectors that fit no cache
OUTPUTS, PASSES = 3, 2  # components of a position; passes over M in a linear fit
FITTED = 1_000_000  # poses of the fit whose parts are measured


def least(work: Callable[[], object], repeats: int = 9) -> float:
    """CPU seconds of the quickest of some turns."""
    took = []
    for _ in range(repeats):
        begun = time.thread_time()
        work()
        took.append(time.thread_time() - begun)
    return min(took)


def measured() -> dict[str, float]:
    """Bandwidths (GB/s) and arithmetic (10^9 floating-point operations a second), and least ns a pose by them."""
    a, b, c = np.ones(ROWS), np.ones(ROWS), np.empty(ROWS)
    small = np.ones((3, KERNEL_BLOCK_ROWS))
    square = np.ones((512, 512))
    many = 200

    def in_cache() -> None:
        for _ in range(many):
            np.multiply(small[0], small[1], small[2])

    with one_blas_thread():
        found = {
            "fill": 8 * ROWS / least(lambda: c.fill(1.0)) / 1e9,
            "triad": 24 * ROWS / least(lambda: np.multiply(a, b, c)) / 1e9,
            "in cache": 24 * many * small.shape[1] / least(in_cache) / 1e9,
            "dgemm": 2 * 512**3 / least(lambda: square @ square) / 1e9,
        }
    made = ours.kernel()
    steps, n = len(made.tape.steps), made.n_functions
    products = (n + OUTPUTS) * (n + OUTPUTS + 1)  # a product and a sum each, of one triangle
    streamed = 2 * OUTPUTS * n * (2 * PASSES - 1)  # residuals and their products with the functions
    gram = (products + streamed) / found["dgemm"]
    return found | {
        "M, arithmetic": steps / found["dgemm"] * 2,  # no step is a product and a sum at once
        "M, every step through the cache": 24 * steps / found["in cache"],
        "fit, arithmetic": PASSES * steps / found["dgemm"] * 2 + gram,
        "fit, every step through the cache": PASSES * 24 * steps / found["in cache"] + gram,
        "dense M, written once": 8 * made.n_outputs / found["fill"],
    }


def parts(found: dict[str, float]) -> dict[str, tuple[float, float]]:
    """Parts of a fit by NumPy alone, each by itself: ns of CPU a pose, and the least by arithmetic and by the cache."""
    made, rng, m = ours.kernel(), np.random.default_rng(0), KERNEL_BLOCK_ROWS
    n, q, many = made.n_functions, five_axis.poses(16 * m), 20
    measured, steps = five_axis.nominal(q), len(made.tape.steps)
    view = ours._view(q, measured)
    points = len(view.chain.kernel("nominal", (), view.fixed, view.outputs).tape.steps)
    functions, gap, slopes = rng.normal(size=(n, m)), rng.normal(size=(OUTPUTS, m)), rng.normal(size=(OUTPUTS + 1, n))
    all_q = five_axis.poses(FITTED)
    seen = five_axis.nominal(all_q) + rng.normal(0, 0.01, (FITTED, OUTPUTS))

    def block(work: Callable[[], object]) -> float:
        return least(lambda: [work() for _ in range(many)]) / many / m * 1e9

    def through(bytes_: int, operations: int) -> float:
        return max(bytes_ / found["in cache"], operations / found["dgemm"])

    with one_core():
        took = {
            "nominal points and gaps": (
                least(lambda: GapView.of(view, view.at_zero)) / len(q) * 1e9,
                through(24 * points + 48 * OUTPUTS, 2 * points),
            ),
            "M, twice": (
                PASSES * least(lambda: ours.stream_numpy(q)) / len(q) * 1e9,
                PASSES * through(24 * steps, 2 * steps),
            ),
            "products of the functions (OpenBLAS)": (
                block(lambda: functions @ functions.T),
                through(8 * n, n * (n + 1)),
            ),
            "residual, and its products, twice": (
                block(lambda: gap - (slopes @ functions)[:OUTPUTS]) + PASSES * block(lambda: functions @ gap.T),
                (PASSES + 1) * through(8 * n, 2 * OUTPUTS * n),
            ),
            "ranks, groups, noise": (
                least(lambda: ours.fit_numpy(all_q[:500], seen[:500])) / FITTED * 1e9,
                0.0,
            ),
        }
        whole = least(lambda: ours.fit_numpy(all_q, seen)) / FITTED * 1e9
    took["sizes of residuals, and what the caches lose between the parts"] = (
        whole - sum(own for own, _ in took.values()),
        0.0,
    )
    return took | {"fit": (whole, sum(bound for _, bound in took.values()))}


def show_parts(took: dict[str, tuple[float, float]]) -> None:
    print(f"\nA fit of {FITTED} poses by NumPy alone, by parts{'ns a pose':>23}{'at least':>12}")
    for name, (own, bound) in took.items():
        print(f"{name:<68}{own:>6.0f}{f'{bound:.0f}' if bound else '-':>12}")


def show(found: dict[str, float]) -> None:
    print("\nLimits of one thread")
    for name, value in found.items():
        unit = "ns a pose at least" if "," in name else "GF/s" if name == "dgemm" else "GB/s"
        print(f"{name:<44}{value:>9.1f} {unit}")
