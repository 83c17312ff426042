"""Our own side: the only file here that knows the package's interface."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from functools import cache, partial

import numpy as np

from errormodel import kernel as known
from errormodel import turned_design
from errormodel.arrays import Array
from errormodel.chain import TOOL_CHANNELS, Chain
from errormodel.conventions import MOTIONS
from errormodel.kernel import Kernel
from errormodel.machine import Basis, Joint, Machine, Shape
from identification.estimation import least_squares
from identification.observation.models import GapView, PositionView, View
from identification.observation.sums import range_rows
from identification.runtime.parallel import parallel_map
from tests.benchmarks.five_axis import IDS, JOINTS, TOOL

__all__ = [
    "IDS", "as_design", "build", "build_compact", "fit", "fit_compiled", "fit_numpy", "solve", "stream",
    "stream_compiled", "stream_fitted",
]  # fmt: skip


def machine() -> Machine:
    """The benchmark's machine in the package's own terms."""
    elements: list[Shape | Joint] = []
    for place, (name, kind, axis, travel) in enumerate(JOINTS, start=1):
        motions = MOTIONS if kind == "rotary" else (MOTIONS[axis.index(1.0)], *MOTIONS[3:])
        elements.append(Joint(name, kind, axis, travel, dict.fromkeys(motions, Basis("first-order"))))
        elements.append(Shape(f"T{place}", motions=MOTIONS))
    return Machine("five-axis machine with rotary table and quill", tuple(elements), TOOL)


@cache
def chain() -> Chain:
    return Chain(machine())


@cache
def kernel() -> Kernel:
    """M at zero error, position rows, one tool in all rows."""
    return chain().kernel("design", IDS, dict(zip(TOOL_CHANNELS, TOOL, strict=True)), (0, 1, 2))


def build(q: Array) -> Array:
    """The dense M in freshly allocated memory, all 52 columns, as (52 * 3, n): one function of the pose a row."""
    return kernel()(_rows(q))


def as_design(result: Array, q: Array) -> Array:
    """The same as (n, 3, 52), a view."""
    return result.reshape(len(IDS), 3, len(q)).transpose(2, 1, 0)


@contextmanager
def compiled_from(rows: int) -> Iterator[None]:
    """The compiled loops from so many rows, where Numba is installed."""
    before, known.COMPILED_ROWS = known.COMPILED_ROWS, rows
    try:
        yield
    finally:
        known.COMPILED_ROWS = before


def turned_kernel() -> Kernel:
    """M in the axes in which long surveys are fitted; its last three functions are the gap."""
    return turned_design.turned_kernel(chain(), "nominal", IDS, dict(zip(TOOL_CHANNELS, TOOL, strict=True)))


def stream(q: Array) -> int:
    """M in the axes of the reference by NumPy: its distinct functions, block by block through one buffer."""
    return sum(np.asarray(functions).shape[1] for _, functions in kernel().blocks(_rows(q)))


def stream_fitted(q: Array, measured: Array) -> int:
    """M and the gap as long fits take them, by NumPy."""
    blocks = turned_kernel().blocks([*_rows(q), *measured.T])
    return sum(np.asarray(functions).shape[1] for _, functions in blocks)


def stream_compiled(q: Array) -> int:
    """M in the axes of the reference by the compiled loops, strip by strip, on all cores."""
    from errormodel.kernel_fused import fused

    rows, nothing = _rows(q), np.zeros(0)

    def work(span: slice) -> int:
        own, none = [c[span] for c in rows], np.zeros((0, 2), dtype=np.intp)
        fused(kernel()).sums(own, (), 0, np.zeros((3, 0)), none[:, 0].copy(), none, nothing, False)
        return len(own[0])

    size = range_rows(len(q))
    return sum(parallel_map([partial(work, slice(k, k + size)) for k in range(0, len(q), size)]))


def fit_numpy(q: Array, measured: Array) -> dict[str, object]:
    """`fit` by NumPy alone."""
    with compiled_from(sys.maxsize):
        return fit(q, measured)


def fit_compiled(q: Array, measured: Array) -> dict[str, object]:
    """`fit` by the compiled loops."""
    with compiled_from(0):
        return fit(q, measured)


def build_compact(q: Array) -> Array:
    """M without its repetitions and zeros: the distinct functions, (functions, n)."""
    return kernel().functions(_rows(q))


def fit(q: Array, measured: Array) -> dict[str, object]:
    """Least squares from commands (n, 5) and measured positions (n, 3), the measuring frame being fixed.

    The linear model, as the rivals solve it, and its residuals.

    Returns
    -------
    dict
        ``ids`` of the independent columns (each the one column that stands for its group), their ``values``,
        ``covariance``, and of the residuals ``sigma`` (per component), ``rms``, ``mean`` and ``max`` (of the 3-D
        residual), mm: what ``rivals.competent_numpy.fit`` returns.
    """
    found = least_squares.solve(chain(), [_view(q, measured)], IDS, exact=False)
    own = found.sums["position"]
    return {
        **_estimates(found),
        "covariance": found.covariance,
        "sigma": found.sigma["position"],
        "rms": float(np.sqrt(own.square / len(q))),
        "mean": own.length / len(q),
        "max": own.longest,
    }


def solve(q: Array, errors: Array) -> dict[str, object]:
    """Parameters from volumetric errors (n, 3), actual minus nominal, mm: the linear problem alone."""
    view = _view(q, np.zeros((len(q), 3)))
    known = GapView(**{f.name: getattr(view, f.name) for f in fields(View)}, gap=np.ascontiguousarray(errors.T))
    return _estimates(least_squares.solve(chain(), [known], IDS, exact=False))


def _view(q: Array, measured: Array) -> PositionView:
    n = len(q)
    return PositionView(
        kind="position",
        chain=chain(),
        ids=IDS,
        columns=IDS,
        rows=_rows(q),
        whitener=np.broadcast_to(1.0, n),
        index=np.broadcast_to(np.intp(0), n),
        fixed=dict(zip(TOOL_CHANNELS, TOOL, strict=True)),
        measured=measured,
    )


def _estimates(found: least_squares.Solution) -> dict[str, object]:
    base = found.groups.base
    return {"ids": tuple(found.unknowns[k] for k in base), "values": found.values[base]}


def _rows(q: Array) -> list[Array]:
    tools = (np.broadcast_to(component, len(q)) for component in TOOL)  # folded into the kernel: never read
    return [*q.T, *tools]
