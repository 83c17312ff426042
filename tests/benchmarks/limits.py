"""What the computer can do, by one thread and in seconds of CPU, beside what M and the fit ask of it."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from errormodel.kernel import KERNEL_BLOCK_ROWS
from identification.runtime.blas import one_blas_thread
from tests.benchmarks import ours

ROWS = 1 << 22  # of vectors that fit no cache
OUTPUTS, PASSES = 3, 2  # components of a position; passes over M in a linear fit


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


def show(found: dict[str, float]) -> None:
    print("\nLimits of one thread")
    for name, value in found.items():
        unit = "ns a pose at least" if "," in name else "GF/s" if name == "dgemm" else "GB/s"
        print(f"{name:<44}{value:>9.1f} {unit}")
