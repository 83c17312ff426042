"""What the computer can do, by one thread and in seconds of CPU, beside what M and the fit ask of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from errormodel.arrays import Array
from errormodel.kernel import KERNEL_BLOCK_ROWS
from identification.observation import sums as passes
from identification.observation.sums import _Products
from identification.runtime.blas import one_blas_thread
from identification.runtime.parallel import one_core
from tests.benchmarks import five_axis, ours

ROWS = 1 << 22  # of vectors that fit no cache
OUTPUTS, PASSES = 3, 2  # components of a position; passes over M in a linear fit
SOME = 1 << 17  # poses on which the parts of compiled loops are measured
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
    reference, made = ours.kernel(), ours.turned_kernel()
    n, steps = made.n_functions, len(made.tape.steps)
    # a product and a sum each: of one triangle; of the gaps and the functions, and of what is taken off the gaps
    gram = (n * (n + 1) + 2 * (2 * PASSES - 2) * OUTPUTS * (n - OUTPUTS)) / found["dgemm"]
    return found | {
        "M of the reference, arithmetic": len(reference.tape.steps) / found["dgemm"] * 2,  # not two at once
        "M of the reference, every step through the cache": 24 * len(reference.tape.steps) / found["in cache"],
        "fit, arithmetic": PASSES * steps / found["dgemm"] * 2 + gram,
        "fit, every step through the cache": PASSES * 24 * steps / found["in cache"] + gram,
        "dense M, written once": 8 * reference.n_outputs / found["fill"],
    }


def parts(found: dict[str, float]) -> dict[str, tuple[float, float]]:
    """Parts of a fit by NumPy alone, each by itself: ns of CPU a pose, and the least by arithmetic and by the cache."""
    made, rng, m = ours.turned_kernel(), np.random.default_rng(0), KERNEL_BLOCK_ROWS
    whole, n, many = made.n_functions, made.n_functions - OUTPUTS, 20
    q, steps = five_axis.poses(16 * m), len(made.tape.steps)
    measured = five_axis.nominal(q)
    functions, slopes = rng.normal(size=(whole + -whole % 4, m)), rng.normal(size=(OUTPUTS + 1, n))
    lengths = _Products(np.zeros((0, 0)))
    all_q = five_axis.poses(FITTED)
    seen = five_axis.nominal(all_q) + rng.normal(0, 0.01, (FITTED, OUTPUTS))

    def block(work: Callable[[], object]) -> float:
        return least(lambda: [work() for _ in range(many)]) / many / m * 1e9

    def through(bytes_: int, operations: int) -> float:
        return max(bytes_ / found["in cache"], operations / found["dgemm"])

    with one_core():
        took = {
            "M and gaps, twice": (
                PASSES * least(lambda: ours.stream_fitted(q, measured)) / len(q) * 1e9,
                PASSES * through(24 * steps, 2 * steps),
            ),
            "products of functions and gaps (OpenBLAS)": (
                block(lambda: functions @ functions.T),
                through(8 * whole, whole * (whole + 1)),
            ),
            "what is taken off the gaps, and their products": (
                block(lambda: functions[n:] - slopes @ functions[:n]) + block(lambda: functions[:n] @ functions[n:].T),
                2 * through(8 * whole, 2 * OUTPUTS * n),
            ),
            "lengths of residuals": (block(lambda: lengths.add_lengths(functions[n:whole])), 0.0),
            "ranks, groups, noise": _fixed(ours.fit_numpy, all_q, seen),
        }
        took["fit"] = least(lambda: ours.fit_numpy(all_q, seen)) / FITTED * 1e9, 0.0
    return _with_rest(took)


def compiled_parts(found: dict[str, float]) -> dict[str, tuple[float, float]]:
    """The same of a fit by the compiled loops in one thread, as differences."""
    from errormodel import kernel_fused

    q = five_axis.poses(FITTED)
    seen = five_axis.nominal(q) + np.random.default_rng(0).normal(0, 0.01, (FITTED, OUTPUTS))
    view, columns = ours._view(q[:SOME], seen[:SOME]), np.arange(len(five_axis.IDS))
    linear, flops = np.full(len(columns), 1e-6), found["dgemm"]
    with one_core(), ours.compiled_from(0):
        works = [
            passes.Pass(view, columns, given, view.at_zero, None, gram, True).work()
            for given, gram in ((None, True), (linear, False))
        ]
        loops, n = kernel_fused.fused(works[0].kernel), works[0].kernel.n_functions - OUTPUTS
        steps, nothing = loops.steps, (np.zeros((3, 0)), np.zeros(0, np.intp), np.zeros((0, 2), np.intp))

        def took(own: tuple[Any, ...], lengths: bool = False) -> float:
            rows = works[0].rows(slice(None))
            return least(lambda: loops.sums(rows, (), n, *own, np.zeros(0), lengths)) / SOME * 1e9

        computed, sized = took(nothing), took(nothing, True) - took(nothing)
        loops.steps = steps[:0]
        read = took(nothing)
        loops.steps = steps
        gram, slopes = (w.tiles for w in works)
        off = took((works[1].slopes[:3], *slopes))
        out = {
            "commands and measurements, twice": (PASSES * read, PASSES * 64 / found["triad"]),
            "M and gaps, twice": (PASSES * (computed - read), PASSES * 2 * len(steps) / flops),
            "products of functions and gaps": (took((nothing[0], *gram)) - computed, 2 * 292 / flops),
            "what is taken off the gaps, and their products": (off - computed, 2 * 2 * OUTPUTS * n / flops),
            "lengths of residuals": (sized, 0.0),
            "ranks, groups, noise": _fixed(ours.fit_compiled, q, seen),
            "fit": (least(lambda: ours.fit_compiled(q, seen)) / FITTED * 1e9, 0.0),
        }
    return _with_rest(out)


def _fixed(fit: Callable[..., object], q: Array, seen: Array) -> tuple[float, float]:
    return least(lambda: fit(q[:500], seen[:500])) / FITTED * 1e9, 0.0


def _with_rest(took: dict[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """The parts with what is left of the whole, which comes last."""
    *parts, (name, (whole, _)) = took.items()
    rest = whole - sum(own for _, (own, _) in parts)
    return {**dict(parts), "what the caches lose between the parts": (rest, 0.0)} | {
        name: (whole, sum(bound for _, (_, bound) in parts))
    }


def show_parts(how: str, took: dict[str, tuple[float, float]]) -> None:
    print(f"\n{f'A fit of {FITTED} poses by {how}':<62}{'ns a pose':>12}{'at least':>12}")
    for name, (own, bound) in took.items():
        print(f"{name:<68}{own:>6.0f}{f'{bound:.0f}' if bound else '-':>12}")


def show(found: dict[str, float]) -> None:
    print("\nLimits of one thread")
    for name, value in found.items():
        unit = "ns a pose at least" if "," in name else "GF/s" if name == "dgemm" else "GB/s"
        print(f"{name:<44}{value:>9.1f} {unit}")
