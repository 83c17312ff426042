"""Numba: the closed form of the dense M for one pose written by hand for this chain, in a compiled loop, one thread.

All 52 columns, (3n, 52). Needs a compiler in the process (LLVM) and a person who derives the formulas.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from tests.benchmarks.five_axis import IDS, JOINTS, TOOL, Array

__all__ = ["IDS", "build"]

_AXES = np.array([axis for _, _, axis, _ in JOINTS[1:]])
_TOOL = np.array(TOOL)


@njit(cache=False)
def _member(row, at, s, c, level, x, y, z, factor):  # six columns of constants; `level` 0 before B, 1 behind it
    """``factor * (R, R [e_k x lever])`` with the lever (x, y, z) in the axes R; R is I before B, Ry(B) behind."""
    if not level:
        s, c = 0.0, 1.0
    row[0, at], row[1, at], row[2, at] = factor * c, 0.0, -factor * s
    row[0, at + 1], row[1, at + 1], row[2, at + 1] = 0.0, factor, 0.0
    row[0, at + 2], row[1, at + 2], row[2, at + 2] = factor * s, 0.0, factor * c
    _turns(row, at + 3, s, c, x, y, z, factor)


@njit(cache=False)
def _turns(row, at, s, c, x, y, z, factor):
    row[0, at], row[1, at], row[2, at] = factor * s * y, -factor * z, factor * c * y
    row[0, at + 1], row[1, at + 1], row[2, at + 1] = factor * (c * z - s * x), 0.0, -factor * (s * z + c * x)
    row[0, at + 2], row[1, at + 2], row[2, at + 2] = -factor * c * y, factor * x, factor * s * y


@njit(cache=False)
def _loop(q, axes, tool, M):
    for i in range(len(q)):
        row = M[i]
        s, c = np.sin(q[i, 0]), np.cos(q[i, 0])
        x, y, z = tool[0] + q[i, 1], tool[1] + q[i, 3], tool[2] + q[i, 2] + q[i, 4]  # lever arm from B, behind it
        half = np.sin(q[i, 0] / 2)
        _member(row, 0, s, c, 0, c * x + s * z, y, c * z - s * x, half)
        _member(row, 6, s, c, 1, x, y, z, 1.0)
        at = 12
        for k in range(4):
            t = q[i, k + 1]
            ax, ay, az = axes[k, 0], axes[k, 1], axes[k, 2]
            x, y, z = x - t * ax, y - t * ay, z - t * az  # lever arm behind this joint
            row[0, at] = t * (c * ax + s * az)
            row[1, at] = t * ay
            row[2, at] = t * (c * az - s * ax)
            # q (e x lever) + q^2/2 (e x axis) = q (e x (lever + q/2 axis))
            _turns(row, at + 1, s, c, x + t / 2 * ax, y + t / 2 * ay, z + t / 2 * az, t)
            _member(row, at + 4, s, c, 1, x, y, z, 1.0)
            at += 10


def build(q: Array) -> Array:
    M = np.empty((len(q), 3, len(IDS)))
    _loop(q, _AXES, _TOOL, M)
    return M.reshape(3 * len(q), -1)
