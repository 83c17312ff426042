"""The inner loops of long surveys, compiled by Numba: the steps of a tape, and sums of products of rows.

`run` does what NumPy does with each step, to the last bit: strips of rows stay in the first-level cache from step to
step. `products` adds up the Gram matrix of the functions, four rows by four, and only where it is asked for; BLAS takes
twice as long for matrices as flat as these. Without Numba both are plain Python, which the tests run.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, TypeVar

from errormodel.arrays import Array, Index

F = TypeVar("F", bound=Callable[..., Any])


def _plain(**_: Any) -> Callable[[F], F]:
    return lambda function: function


if TYPE_CHECKING or find_spec("numba") is None:  # nobody calls it then, but the tests
    njit = _plain
else:
    from numba import njit

STRIP_ROWS = 512  # registers of a strip stay in the first-level cache; measured
TILE = 4  # functions by functions whose products are added up at once, in the registers of the processor
PRODUCT_ROWS = 1024  # columns of a tile that are read from the second-level cache at once; measured

# codes of steps: of arrays, of an array and a scalar (1), of a scalar and an array (2)
CODES = {
    ("positive", 0): 0, ("positive", 1): 1, ("negative", 0): 2, ("square", 0): 3,
    ("add", 0): 4, ("add", 1): 5, ("subtract", 0): 6, ("subtract", 1): 7, ("subtract", 2): 8,
    ("multiply", 0): 9, ("multiply", 1): 10, ("divide", 0): 11, ("divide", 1): 12, ("divide", 2): 13,
}  # fmt: skip


def coded(kind: str, operands: tuple[int, ...], out: int, scalars: int) -> tuple[int, int, int, int]:
    """A step as numbers: code, operands (an array before a scalar where the order does not matter), and result."""
    a, b = operands[0], operands[-1]
    if kind in ("add", "multiply") and a < scalars:
        a, b = b, a
    form = 0 if min(a, b) >= scalars else 1 if b < scalars else 2
    return CODES[kind, form], a, b, out


@njit(cache=True, nogil=True, error_model="numpy")
def run(steps: Index, values: Array, work: Array, functions: Array) -> None:
    """Steps (k, 4) as `coded` gives them.

    Parameters
    ----------
    values : the slots that are the same in all rows; then come those of `work` (inputs and registers, rows) and of
        `functions` (functions, rows).
    """
    first = len(values)
    second = first + len(work)
    m = work.shape[1]
    for low in range(0, m, STRIP_ROWS):
        high = min(low + STRIP_ROWS, m)
        for k in range(len(steps)):
            code, i, j, target = steps[k, 0], steps[k, 1], steps[k, 2], steps[k, 3]
            out = (work[target - first] if target < second else functions[target - second])[low:high]
            s = values[j] if j < first else (values[i] if i < first else 0.0)
            i = j if i < first else i
            j = i if j < first else j
            if i < first:
                for r in range(len(out)):
                    out[r] = s
                continue
            a = (work[i - first] if i < second else functions[i - second])[low:high]
            b = (work[j - first] if j < second else functions[j - second])[low:high]
            if code == 0:
                for r in range(len(out)):
                    out[r] = a[r]
            elif code == 2:
                for r in range(len(out)):
                    out[r] = -a[r]
            elif code == 3:
                for r in range(len(out)):
                    out[r] = a[r] * a[r]
            elif code == 4:
                for r in range(len(out)):
                    out[r] = a[r] + b[r]
            elif code == 5:
                for r in range(len(out)):
                    out[r] = a[r] + s
            elif code == 6:
                for r in range(len(out)):
                    out[r] = a[r] - b[r]
            elif code == 7:
                for r in range(len(out)):
                    out[r] = a[r] - s
            elif code == 8:
                for r in range(len(out)):
                    out[r] = s - a[r]
            elif code == 9:
                for r in range(len(out)):
                    out[r] = a[r] * b[r]
            elif code == 10:
                for r in range(len(out)):
                    out[r] = a[r] * s
            elif code == 11:
                for r in range(len(out)):
                    out[r] = a[r] / b[r]
            elif code == 12:
                for r in range(len(out)):
                    out[r] = a[r] / s
            else:
                for r in range(len(out)):
                    out[r] = s / a[r]


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def products(functions: Array, others: Array, order: Index, tiles: Index, out: Array) -> None:
    """Add products of rows, summed over the columns, to `out` (k, k), tile by tile.

    Parameters
    ----------
    functions, others : (n, m) and (c, m): rows, counted through.
    order : (k,) numbers of rows, k a multiple of `TILE`.
    tiles : (t, 2) which rows and columns of tiles are wanted.
    """
    n, m = functions.shape
    for low in range(0, m, PRODUCT_ROWS):
        high = min(low + PRODUCT_ROWS, m)
        for t in range(len(tiles)):
            i, j = TILE * tiles[t, 0], TILE * tiles[t, 1]
            p0, p1, p2, p3 = order[i], order[i + 1], order[i + 2], order[i + 3]
            q0, q1, q2, q3 = order[j], order[j + 1], order[j + 2], order[j + 3]
            a0 = (functions[p0] if p0 < n else others[p0 - n])[low:high]
            a1 = (functions[p1] if p1 < n else others[p1 - n])[low:high]
            a2 = (functions[p2] if p2 < n else others[p2 - n])[low:high]
            a3 = (functions[p3] if p3 < n else others[p3 - n])[low:high]
            b0 = (functions[q0] if q0 < n else others[q0 - n])[low:high]
            b1 = (functions[q1] if q1 < n else others[q1 - n])[low:high]
            b2 = (functions[q2] if q2 < n else others[q2 - n])[low:high]
            b3 = (functions[q3] if q3 < n else others[q3 - n])[low:high]
            s00 = s01 = s02 = s03 = s10 = s11 = s12 = s13 = 0.0
            s20 = s21 = s22 = s23 = s30 = s31 = s32 = s33 = 0.0
            for r in range(high - low):
                x0, x1, x2, x3 = a0[r], a1[r], a2[r], a3[r]
                y0, y1, y2, y3 = b0[r], b1[r], b2[r], b3[r]
                s00 += x0 * y0
                s01 += x0 * y1
                s02 += x0 * y2
                s03 += x0 * y3
                s10 += x1 * y0
                s11 += x1 * y1
                s12 += x1 * y2
                s13 += x1 * y3
                s20 += x2 * y0
                s21 += x2 * y1
                s22 += x2 * y2
                s23 += x2 * y3
                s30 += x3 * y0
                s31 += x3 * y1
                s32 += x3 * y2
                s33 += x3 * y3
            out[i, j] += s00
            out[i, j + 1] += s01
            out[i, j + 2] += s02
            out[i, j + 3] += s03
            out[i + 1, j] += s10
            out[i + 1, j + 1] += s11
            out[i + 1, j + 2] += s12
            out[i + 1, j + 3] += s13
            out[i + 2, j] += s20
            out[i + 2, j + 1] += s21
            out[i + 2, j + 2] += s22
            out[i + 2, j + 3] += s23
            out[i + 3, j] += s30
            out[i + 3, j + 1] += s31
            out[i + 3, j + 2] += s32
            out[i + 3, j + 3] += s33
