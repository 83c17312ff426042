"""A kernel for compiled loops that do all with a strip of rows; what they do not know is done by NumPy beforehand."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import as_strided

from errormodel.arrays import Array, Index, Numbers
from errormodel.kernel import Kernel, tape_of
from errormodel.kernel_compiled import CODES, PAD, TILE, Places, coded, sums
from errormodel.kernel_program import LEAVES, Program

STRIP_ROWS = 256  # what belongs to a strip stays in the first two levels of the cache; 192 to 768 take as long
KNOWN = {kind for kind, _ in CODES} | {*LEAVES}


@lru_cache(maxsize=32)
def fused(kernel: Kernel) -> FusedKernel:
    """The kernel for compiled loops, made once."""
    return FusedKernel(kernel)


class FusedKernel:
    """Steps of the functions of a kernel, and their sums.

    Attributes
    ----------
    before : the kernel of what NumPy does; its functions are inputs of the steps, behind the `given` rows.
    steps : (k, 5) as `coded` gives them, for slots in this order: values, inputs, registers, functions.
    functions : number of functions, the last of the slots.
    """

    def __init__(self, kernel: Kernel) -> None:
        program, wanted, self.given = kernel.program, kernel.wanted, kernel.n_rows
        slow = [n for n in program.needed(wanted) if program.nodes[n][0] not in KNOWN and not program.scalar[n]]
        self.tape = tape_of(*_without(program, wanted, slow, self.given), in_place=False)
        used = [slow[k - self.given] for k in self.tape.inputs if k >= self.given]
        self.before = Kernel.of(program, used, self.given)
        scalars = len(self.tape.fixed)
        self.steps = np.array([coded(*step, scalars) for step in self.tape.steps], dtype=np.intp).reshape(-1, 5)
        self.functions = kernel.n_functions

    def sums(
        self, rows: Sequence[Array], scalars: Numbers, n: int, slopes: Array, order: Index, tiles: Index,
        weights: Array, lengths: bool,
    ) -> tuple[Array, float, float]:  # fmt: skip
        """Products of the functions, the first `n`, and of the three residuals behind them, summed over all rows.

        Parameters
        ----------
        slopes : (3, k) of the functions that are taken off the residuals; k is 0 or `n`.
        order : (k,) numbers of functions and residuals, k a multiple of `kernel_compiled.TILE`.
        tiles : (t, 2) which rows and columns of tiles of products are wanted.
        weights : (rows,) factor of each row, or (0,).
        lengths : whether lengths of residuals are wanted, too.

        Returns
        -------
        tuple
            Products (k, k), the sum of the residuals' lengths and the largest of them, all weighted.
        """
        first = len(self.tape.inputs) + self.tape.registers
        with np.errstate(all="ignore"):
            values = np.append(self.tape.values(scalars), 0.0)
        work = _aligned(first + self.functions)
        out, found = np.zeros((len(order), len(order))), np.zeros(2 if lengths else 0)
        whole = np.zeros((3, -(-slopes.shape[1] // TILE) * TILE))
        whole[:, : slopes.shape[1]] = slopes
        slow = iter(self.before.functions(rows, scalars) if self.before.n_functions else ())
        inputs = [rows[number] if number < self.given else next(slow) for number in self.tape.inputs]
        with np.errstate(all="ignore"):  # both branches of a switch are evaluated
            sums(
                self.steps, values, *_places(inputs), len(rows[0]), work, first, n, whole, order + first, tiles,
                weights, out, found,
            )  # fmt: skip
        return out, *(found.tolist() or (0.0, 0.0))


def _places(rows: Sequence[Array]) -> tuple[Array, Places]:
    """The memory that all rows are in, and place and stride of each: what is compiled once takes any number of them.

    It is an array from the lowest address to the highest, of which the places alone are read.
    """
    kept = [r if r.strides[0] >= 0 and r.strides[0] % 8 == 0 and r.flags.aligned else r.copy() for r in rows]
    if not kept or not len(kept[0]):
        return np.zeros(1), np.zeros((len(kept), 2), dtype=np.uintp)
    starts = [r.ctypes.data for r in kept]
    lowest = kept[int(np.argmin(starts))]
    end = max(start + (len(r) - 1) * r.strides[0] for start, r in zip(starts, kept, strict=True))
    memory = as_strided(lowest, ((end - min(starts)) // 8 + 1,), (8,), writeable=False)
    strides = [r.strides[0] // 8 for r in kept]
    return memory, np.array([[(a - min(starts)) // 8, s] for a, s in zip(starts, strides, strict=True)], dtype=np.uintp)


def _aligned(rows: int) -> Array:
    """An array (rows, rows of a strip + `PAD`) that begins at a line of the cache."""
    size = rows * (STRIP_ROWS + PAD)
    room = np.empty(size + 8)
    start = -(room.ctypes.data // 8) % 8
    return room[start : start + size].reshape(rows, -1)


def _without(program: Program, wanted: list[int], slow: list[int], n_rows: int) -> tuple[Program, list[int]]:
    """The program with the slow nodes as further inputs, and the wanted nodes in it."""
    out, new = Program(), dict[int, int]()
    for node in program.needed(wanted):
        key = program.nodes[node]
        if node in slow:
            new[node] = out.node(("input", 0, n_rows + slow.index(node)), False)
        elif operands := program.operands(node):
            new[node] = out.node((key[0], *(new[a] for a in operands)), program.scalar[node])
        else:
            new[node] = out.node(key, program.scalar[node])
    return out, [new[node] for node in wanted]
