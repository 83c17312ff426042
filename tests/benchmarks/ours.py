"""Our own side: the only file here that knows the package's interface."""

from __future__ import annotations

from functools import cache

import numpy as np

from errormodel.chain import TOOL_CHANNELS, Chain
from errormodel.conventions import MOTIONS
from errormodel.kernel import Kernel, as_rows
from errormodel.machine import Basis, Joint, Machine, Shape
from tests.benchmarks.five_axis import IDS, JOINTS, TOOL, Array

__all__ = ["IDS", "as_design", "build", "build_compact", "fit", "solve"]


class NotWiredError(NotImplementedError):
    """A part of the package that this benchmark does not call yet."""


def machine() -> Machine:
    """The benchmark's machine in the package's own terms."""
    elements: list[Shape | Joint] = []
    for place, (name, kind, axis, travel) in enumerate(JOINTS, start=1):
        motions = MOTIONS if kind == "rotary" else (MOTIONS[axis.index(1.0)], *MOTIONS[3:])
        elements.append(Joint(name, kind, axis, travel, dict.fromkeys(motions, Basis("first-order"))))
        elements.append(Shape(f"T{place}", motions=MOTIONS))
    return Machine("five-axis machine with rotary table and quill", tuple(elements), TOOL)


@cache
def kernel() -> Kernel:
    """M at zero error, position rows, one tool in all rows."""
    return Chain(machine()).kernel("design", IDS, dict(zip(TOOL_CHANNELS, TOOL, strict=True)), (0, 1, 2))


def build(q: Array) -> Array:
    """The dense M in freshly allocated memory, all 52 columns, as (52 * 3, n): one function of the pose a row."""
    return kernel()(_rows(q))


def as_design(result: Array, q: Array) -> Array:
    """The same as (n, 3, 52), a view."""
    return result.reshape(len(IDS), 3, len(q)).transpose(2, 1, 0)


def build_compact(q: Array) -> Array:
    """M without its repetitions and zeros: the distinct functions, (functions, n)."""
    return kernel().functions(_rows(q))


def fit(q: Array, measured: Array) -> dict[str, object]:
    """Least squares from commands (n, 5) and measured positions (n, 3), the measuring frame being fixed.

    Returns
    -------
    dict
        ``ids`` of the independent columns (each the one column that stands for its group), their ``values``,
        ``covariance``, and of the residuals ``sigma`` (per component), ``rms``, ``mean`` and ``max`` (of the 3-D
        residual), mm: what ``rivals.competent_numpy.fit`` returns.
    """
    raise NotWiredError("identification.fit is not called by tests/benchmarks/ours.py yet")


def solve(q: Array, errors: Array) -> dict[str, object]:
    """The same from volumetric errors (n, 3), actual minus nominal, mm: the linear problem alone."""
    raise NotWiredError("identification.fit is not called by tests/benchmarks/ours.py yet")


def _rows(q: Array) -> list[Array]:
    return [*as_rows(*q.T), *[np.zeros(len(q))] * len(TOOL_CHANNELS)]
