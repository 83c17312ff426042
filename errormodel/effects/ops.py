"""Elementary functions that act on CasADi symbols and on NumPy arrays alike, for the formulas of effects."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

Value = Any  # a float, an array with one value per row, or an SX


def _both(name: str, numeric: str | None = None) -> Any:
    symbolic, plain = getattr(ca, name), getattr(np, numeric or name)

    def function(*args: Value) -> Value:
        return symbolic(*args) if any(isinstance(a, ca.SX) for a in args) else plain(*args)

    function.__name__ = name
    return function


sin, cos, exp, tanh, sqrt = (_both(n) for n in ("sin", "cos", "exp", "tanh", "sqrt"))
fmax, fmin, absolute = _both("fmax", "maximum"), _both("fmin", "minimum"), _both("fabs", "abs")
atan2 = _both("atan2", "arctan2")


def cubic(u: Value) -> Value:
    """Cardinal cubic B-spline with support [-2, 2]; its integer translates sum to one."""
    far, near = fmax(2 - absolute(u), 0), fmax(1 - absolute(u), 0)
    return far * far * far / 6 - near * near * near * (4 / 6)  # of arrays twice as fast as powers


def cubics(u: Value, first: int, count: int) -> list[Value]:
    """``cubic(u - k)`` of so many integers k from the first on: of each number four are not zero."""
    if isinstance(u, ca.SX):  # in one expression: each call of CasADi takes as long for one as for many
        return ca.vertsplit(cubic(u - ca.DM(range(first, first + count))))
    if not np.ndim(u):
        return [cubic(u - k) for k in range(first, first + count)]
    known = np.isfinite(u)
    below = np.floor(np.where(known, u, 0.0)).astype(np.intp)
    out = np.where(known, np.zeros((count, *np.shape(u))), np.nan)
    for step in (-1, 0, 1, 2):
        number = below + step - first
        own = known & (number >= 0) & (number < count)
        out[number[own], *np.nonzero(own)] = cubic(u - below - step)[own]
    return list(out)
