"""SymPy: the derivative taken symbolically, printed once as NumPy code with common sub-expressions, then vectorised.

All 52 columns. Returned as (3, 52, n), which is how vectorised code fills it fastest; the zeros are written by the
allocation. `build` evaluates all poses at once, as most users would.
"""

from __future__ import annotations

import numpy as np
import sympy as sp

from tests.benchmarks.five_axis import IDS, JOINTS, MOTIONS, TOOL, Array

__all__ = ["IDS", "as_design", "build"]


def derivative() -> tuple[list[sp.Symbol], sp.Matrix]:
    """Commands, and M (3, 52) at zero error, each error inserted as a small motion where it acts."""
    q = list(sp.symbols([name for name, *_ in JOINTS], real=True))
    steps: list[tuple[sp.Matrix, list[sp.Matrix]]] = []  # nominal transform, and its derivatives by each parameter
    for (_, kind, axis, _), position in zip(JOINTS, q, strict=True):
        direction = sp.Matrix([int(a) for a in axis])
        small = [_small(motion) for motion in MOTIONS]
        if kind == "rotary":
            move = sp.rot_axis2(-position).row_join(sp.zeros(3, 1)).col_join(sp.Matrix([[0, 0, 0, 1]]))
            steps.append((move, [sp.sin(position / 2) * s * move for s in small]))
        else:
            move = sp.eye(4)
            move[:3, 3] = position * direction
            slopes = [sp.zeros(4)]
            slopes[0][:3, 3] = position * direction
            for k, turn in enumerate(small[3:]):
                slope = position * turn
                slope[:3, 3] = position**2 / 2 * sp.eye(3)[:, k].cross(direction)
                slopes.append(slope)
            steps.append((move, slopes))
        steps.append((sp.eye(4), small))
    tip = sp.Matrix([*(sp.Float(t, 17) for t in TOOL), 1])
    behind = [tip]  # the point as seen from behind each step
    for move, _ in reversed(steps):
        behind.insert(0, move * behind[0])
    columns, before = [], sp.eye(4)
    for (move, slopes), point in zip(steps, behind[1:], strict=True):
        columns += [(before * slope * point)[:3, :] for slope in slopes]
        before = before * move
    return q, sp.Matrix.hstack(*columns)


def _small(motion: str) -> sp.Matrix:
    k = "xyz".index(motion[1]) if motion[0] == "d" else "abc".index(motion[1])
    out = sp.zeros(4)
    if motion[0] == "d":
        out[k, 3] = 1
    else:
        out[:3, :3] = sp.Matrix([sp.eye(3)[:, k].cross(sp.eye(3)[:, j]).T for j in range(3)]).T
    return out


_Q, _M = derivative()
PLACES = [(r, c) for r in range(3) for c in range(len(IDS)) if _M[r, c] != 0]
FUNCTION = sp.lambdify(_Q, [_M[r, c] for r, c in PLACES], modules="numpy", cse=True)


def build(q: Array) -> Array:
    M = np.zeros((3, len(IDS), len(q)))
    for (r, c), value in zip(PLACES, FUNCTION(*np.ascontiguousarray(q.T)), strict=True):
        M[r, c] = value
    return M


def as_design(result: Array, q: Array) -> Array:
    return result.transpose(2, 0, 1)
