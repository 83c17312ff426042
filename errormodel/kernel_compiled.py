"""The inner loops of long surveys, compiled by Numba: all that a least-squares pass does with a row, strip by strip.

A strip's functions stay in the first levels of the cache: steps of a tape write them, and `tile` adds up their Gram
matrix, four rows by four, only where it is asked for; BLAS takes three times as long for matrices as flat as these.
Nothing goes back to the interpreter between strips, so that threads run side by side. Without Numba all is plain
Python, which the tests run.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from errormodel.arrays import Array, Index

Places = NDArray[np.uintp]
F = TypeVar("F", bound=Callable[..., Any])


def _plain(**_: Any) -> Callable[[F], F]:
    return lambda function: function


if TYPE_CHECKING or find_spec("numba") is None:  # nobody calls it then, but the tests
    njit = _plain
else:
    from numba import njit

PAD = 8  # numbers between rows of a strip's array, which so begin in different sets of the cache
WHOLE = 1.5 * 2.0**52  # added and taken off again, it leaves the nearest whole number
TILE = 4  # functions by functions whose products are added up at once, in the registers of the processor

# codes of steps: of arrays, of an array and a scalar (1), of a scalar and an array (2)
CODES = {
    ("positive", 0): 0, ("positive", 1): 1, ("negative", 0): 2, ("square", 0): 3,
    ("add", 0): 4, ("add", 1): 5, ("subtract", 0): 6, ("subtract", 1): 7, ("subtract", 2): 8,
    ("multiply", 0): 9, ("multiply", 1): 10, ("divide", 0): 11, ("divide", 1): 12, ("divide", 2): 13,
    ("sin", 0): 14, ("cos", 0): 15,
}  # fmt: skip


def coded(kind: str, operands: tuple[int, ...], out: int, scalars: int) -> tuple[int, int, int, int, int]:
    """A step as numbers: code, row of its first array, of its second, number of its scalar, and row of the result.

    Slots are those of `errormodel.kernel.Tape`: the first ones are scalars, the others the rows of one array.
    """
    a, b = operands[0], operands[-1]
    if kind in ("add", "multiply") and a < scalars:
        a, b = b, a
    form = 0 if min(a, b) >= scalars else 1 if b < scalars else 2
    arrays, numbers = [k - scalars for k in (a, b) if k >= scalars], [k for k in (a, b) if k < scalars]
    first, second = (arrays[0], arrays[-1]) if arrays else (0, 0)
    return CODES[kind, form], first, second, numbers[0] if numbers else 0, out - scalars


@njit(cache=True, nogil=True, fastmath={"contract"})
def sine(work: Array, a: int, out: int, m: int, quarters: float) -> None:
    """Sine of a row plus so many right angles (1: the cosine), within 1e-16 of the exact value or of an ulp.

    Numba calls the C library for each number, which takes ten times as long. The angle is reduced by multiples of a
    right angle in three parts (Cody and Waite); the polynomials are those of Sun's fdlibm.
    """
    for r in range(m):
        x = work[a, r]
        n = (x * 0.6366197723675814 + WHOLE) - WHOLE
        y = ((x - n * 1.57079632673412561417) - n * 6.07710050630396597660e-11) - n * 2.02226624879595063154e-21
        z = y * y
        s = 2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
        s = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * s)
        c = -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
        c = 4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * c))
        s = y + y * z * (-1.66666666666666324348e-01 + z * s)
        half = 0.5 * z
        c = (1.0 - half) + (((1.0 - (1.0 - half)) - half) + z * z * c)
        n += quarters
        q = n - 4.0 * ((0.25 * n + WHOLE) - WHOLE)  # -2 to 2
        value = c if q * q == 1.0 else s
        work[out, r] = -value if q == -1.0 or q * q == 4.0 else value


@njit(cache=True, nogil=True, error_model="numpy")
def run(steps: Index, values: Array, work: Array, m: int) -> None:
    """Steps (k, 5) as `coded` gives them, on the first `m` columns of `work`; none works in place.

    Rows are indexed and not sliced: a slice costs as long as 200 products.
    """
    for k in range(len(steps)):
        code, a, b, out = steps[k, 0], steps[k, 1], steps[k, 2], steps[k, 4]
        s = values[steps[k, 3]]
        if code == 0:
            for r in range(m):
                work[out, r] = work[a, r]
        elif code == 1:
            for r in range(m):
                work[out, r] = s
        elif code == 2:
            for r in range(m):
                work[out, r] = -work[a, r]
        elif code == 3:
            for r in range(m):
                work[out, r] = work[a, r] * work[a, r]
        elif code == 4:
            for r in range(m):
                work[out, r] = work[a, r] + work[b, r]
        elif code == 5:
            for r in range(m):
                work[out, r] = work[a, r] + s
        elif code == 6:
            for r in range(m):
                work[out, r] = work[a, r] - work[b, r]
        elif code == 7:
            for r in range(m):
                work[out, r] = work[a, r] - s
        elif code == 8:
            for r in range(m):
                work[out, r] = s - work[a, r]
        elif code == 9:
            for r in range(m):
                work[out, r] = work[a, r] * work[b, r]
        elif code == 10:
            for r in range(m):
                work[out, r] = work[a, r] * s
        elif code == 11:
            for r in range(m):
                work[out, r] = work[a, r] / work[b, r]
        elif code == 12:
            for r in range(m):
                work[out, r] = work[a, r] / s
        elif code == 13:
            for r in range(m):
                work[out, r] = s / work[a, r]
        else:
            sine(work, a, out, m, 0.0 if code == 14 else 1.0)


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def tile(work: Array, p: Index, i: int, j: int, m: int, out: Array) -> None:
    """Add to `out` products of four rows of `work`, from ``p[i]``, with four from ``p[j]``, summed over `m` columns."""
    a, b, c, d = p[i], p[i + 1], p[i + 2], p[i + 3]
    e, f, g, h = p[j], p[j + 1], p[j + 2], p[j + 3]
    s00 = s01 = s02 = s03 = s10 = s11 = s12 = s13 = 0.0
    s20 = s21 = s22 = s23 = s30 = s31 = s32 = s33 = 0.0
    for r in range(m):
        x0, x1, x2, x3 = work[a, r], work[b, r], work[c, r], work[d, r]
        y0, y1, y2, y3 = work[e, r], work[f, r], work[g, r], work[h, r]
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


@njit(cache=True, nogil=True, fastmath={"contract"})
def less(work: Array, first: int, slopes: Array, left: int, m: int) -> None:
    """Take slopes (3, k) times k rows of `work`, from `first` on, off the three rows from `left` on; four at a time."""
    for k in range(0, slopes.shape[1], 4):
        a = first + k
        x0, x1, x2, x3 = slopes[0, k], slopes[0, k + 1], slopes[0, k + 2], slopes[0, k + 3]
        y0, y1, y2, y3 = slopes[1, k], slopes[1, k + 1], slopes[1, k + 2], slopes[1, k + 3]
        z0, z1, z2, z3 = slopes[2, k], slopes[2, k + 1], slopes[2, k + 2], slopes[2, k + 3]
        for r in range(m):
            f, g, h, i = work[a, r], work[a + 1, r], work[a + 2, r], work[a + 3, r]
            work[left, r] -= x0 * f + x1 * g + x2 * h + x3 * i
            work[left + 1, r] -= y0 * f + y1 * g + y2 * h + y3 * i
            work[left + 2, r] -= z0 * f + z1 * g + z2 * h + z3 * i


@njit(cache=True, nogil=True)
def fill(memory: Array, places: Places, low: np.uintp, work: Array, m: np.uintp) -> None:
    """Copy `m` inputs from `low` on into the first rows of `work`.

    Places are numbers without sign, which are never counted from the end of an array.
    """
    for k in range(len(places)):
        start, stride = places[k, 0] + low * places[k, 1], places[k, 1]
        if stride == 1:
            for r in range(m):
                work[k, r] = memory[start + r]
        else:
            for r in range(m):
                work[k, r] = memory[start + r * stride]


@njit(cache=True, nogil=True)
def weigh(weights: Array, low: np.uintp, work: Array, first: int, last: int, m: int) -> None:
    """Multiply rows of `work` by the weights of `m` rows from `low` on."""
    for k in range(first, last):
        for r in range(np.uintp(m)):
            work[k, r] *= weights[low + r]


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nnan", "nsz"})
def sizes(work: Array, left: int, m: int, lengths: Array) -> None:
    """Take the lengths of the residuals into their sum and their largest."""
    total = most = 0.0
    for r in range(m):
        square = work[left, r] * work[left, r] + work[left + 1, r] * work[left + 1, r]
        size = np.sqrt(square + work[left + 2, r] * work[left + 2, r])
        total += size
        most = size if size > most else most
    lengths[0] += total
    lengths[1] = max(lengths[1], most)


@njit(cache=True, nogil=True)
def sums(
    steps: Index, values: Array, memory: Array, places: Places, rows: int, work: Array, first: int, n: int,
    slopes: Array, order: Index, tiles: Index, weights: Array, out: Array, lengths: Array,
) -> None:  # fmt: skip
    """Functions of all rows, strip by strip, their residuals and products.

    Parameters
    ----------
    steps, values : as in `run`.
    memory, places : in which the inputs are, and where the first value of each is and how many further on the next
        one (inputs, 2). They become the first rows of `work`, strip by strip.
    rows : how many there are.
    work : (slots without the scalars, rows of a strip + `PAD`), overwritten.
    first, n : row of `work` from which on there are `n` functions of M and three residuals.
    slopes : (3, k) of what is taken off the residuals: 0 functions, or a multiple of 4.
    order : (k,) rows of `work`, k a multiple of `TILE`; `tiles` (t, 2): which rows and columns of tiles are wanted.
    weights : (rows,) factor of each row, or (0,).
    out : (k, k), to which products are added.
    lengths : (2,) sum of the residuals' lengths, and the largest; (0,) if they are not wanted.
    """
    strip = work.shape[1] - PAD
    for low in range(0, rows, strip):
        m = min(strip, rows - low)
        fill(memory, places, np.uintp(low), work, np.uintp(m))
        run(steps, values, work, m)
        less(work, first, slopes, first + n, m)
        if len(weights):
            weigh(weights, np.uintp(low), work, first, first + n + 3, m)
        for t in range(len(tiles)):
            tile(work, order, TILE * tiles[t, 0], TILE * tiles[t, 1], m, out)
        if len(lengths):
            sizes(work, first + n, m, lengths)
