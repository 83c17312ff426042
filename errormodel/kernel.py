"""Fast numerical evaluation of a CasADi expression: its instruction list, run by NumPy on blocks of rows.

What does not depend on the row is computed once, and the rest becomes a list of steps that work in place on blocks that
fit the cache. No compiler is needed; where Numba is installed, sums over long surveys go through
`errormodel.kernel_fused`. The tests compare both with CasADi to 1e-12.
"""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.util import find_spec
from typing import Any, Self

import casadi as ca
import numpy as np

from errormodel.arrays import Array, Numbers
from errormodel.kernel_program import LEAVES, Program, trace, with_tangents

# rows per block: few calls, and the functions of a five-axis machine stay in the caches
KERNEL_BLOCK_ROWS = 4096
COMPILED_ROWS = 500_000  # rows from which a fit saves a second of CPU by the loops, twice what loading Numba takes
# of single numbers NumPy's functions give the same, and take ten times as long
OF_NUMBERS: dict[str, Callable[..., float]] = {
    "add": operator.add, "subtract": operator.sub, "multiply": operator.mul, "negative": operator.neg
}  # fmt: skip
ARITHMETIC = ("add", "subtract", "multiply", "divide", "square", "negative", "positive")  # as fast as memory

Step = tuple[str, tuple[int, ...], int]  # NumPy function, slots of its operands, and the slot that it writes


def _chosen(condition: Array, value: Array, out: Array) -> None:
    """`value` where the condition holds, else 0; not a product, since the branch not taken may be infinite."""
    np.copyto(out, np.where(condition, value, 0.0))


_in_all: ContextVar[int] = ContextVar("in_all", default=0)


@cache
def _compiled() -> bool:
    if find_spec("numba") is None:
        return False
    try:
        from errormodel import kernel_compiled  # noqa: F401  (whether it can be loaded)
    except (ImportError, RuntimeError):  # a Numba for another NumPy, or no folder that it may keep its code in
        return False
    return True


@contextmanager
def of_rows(count: int) -> Iterator[None]:
    """Within the block, rows are part of so many."""
    token = _in_all.set(count)
    try:
        yield
    finally:
        _in_all.reset(token)


def in_all(rows: int) -> int:
    """How many rows so many are, or are part of."""
    return max(rows, _in_all.get())


def compiled(rows: int) -> bool:
    """Whether Numba is installed and so many rows, or all that they are of, are worth the compiled loops."""
    return in_all(rows) >= COMPILED_ROWS and _compiled()


FUNCTIONS: dict[str, Callable[..., Any]] = {"where": _chosen}


@dataclass(frozen=True)
class Tape:
    """Steps that compute the functions of a block.

    Slots are, in this order, values that are the same in all rows, inputs, work registers and functions.

    Attributes
    ----------
    scalars : NumPy function and operands (places in this list) of each value that is the same in all rows; of a
        parameter its number and of a constant its value.
    inputs : number of each row symbol that is used.
    fixed : places in `scalars` of the values that steps use.
    """

    scalars: tuple[tuple[str, tuple[Any, ...]], ...]
    fixed: tuple[int, ...]
    inputs: tuple[int, ...]
    registers: int
    steps: tuple[Step, ...]

    def values(self, parameters: Numbers) -> Array:
        """Values (fixed,) that are the same in all rows."""
        known: list[float] = []
        for kind, operands in self.scalars:
            if kind == "const":
                known.append(operands[0])
            elif kind == "input":
                known.append(float(parameters[operands[0]]))
            elif kind == "where":
                known.append(known[operands[1]] if known[operands[0]] else 0.0)
            else:
                function = OF_NUMBERS.get(kind) or getattr(np, kind)
                known.append(float(function(*(known[a] for a in operands))))
        return np.array([known[k] for k in self.fixed], dtype=np.float64)


def tape_of(program: Program, wanted: list[int], in_place: bool = True) -> Tape:
    """Steps for the wanted nodes, arithmetic apart from slower functions as far as their order allows.

    Steps may work `in_place`: their result then takes the register of an operand that is used for the last time.
    """
    nodes, needed = program.nodes, program.needed(wanted)
    operands_of = {node: program.operands(node) for node in needed}
    stage: dict[int, int] = {}
    for node in needed:
        stage[node] = max((stage[a] + is_slow(nodes[a][0]) for a in operands_of[node]), default=0)
    scalars = [n for n in needed if program.scalar[n]]
    where = {node: k for k, node in enumerate(scalars)}
    steps = sorted((n for n in needed if not program.scalar[n]), key=lambda n: (stage[n], is_slow(nodes[n][0]), n))
    inputs = [n for n in steps if nodes[n][0] == "input"]
    work = [n for n in steps if nodes[n][0] != "input"]
    used = {a for n in work for a in operands_of[n]} | set(wanted)
    fixed = [n for n in scalars if n in used]
    # work registers count from 0 and functions from -1 down, until it is known how many there are
    slot = {n: ("fixed", k) for k, n in enumerate([*fixed, *inputs])}
    home = {n: k for k, n in enumerate(wanted)}
    last = {a: n for n in work for a in operands_of[n]}
    out: list[tuple[str, tuple[tuple[str, int], ...], tuple[str, int]]] = []
    out += [("positive", (slot[n],), ("function", home[n])) for n in (*fixed, *inputs) if n in home]
    free, registers = list[tuple[str, int]](), 0
    for node in work:
        kind, operands = nodes[node][0], operands_of[node]
        taken = tuple(slot[a] for a in operands)
        over = [slot[a] for a in dict.fromkeys(operands) if last[a] == node and slot[a][0] == "work"]
        free += over if in_place else []
        if node in home:
            slot[node] = "function", home[node]
        elif free:
            slot[node] = free.pop()
        else:
            slot[node], registers = ("work", registers), registers + 1
        free += [] if in_place else over
        out.append((kind, taken, slot[node]))
    first = {"fixed": 0, "work": len(fixed) + len(inputs), "function": len(fixed) + len(inputs) + registers}
    return Tape(
        tuple(
            (nodes[n][0], (nodes[n][1],) if nodes[n][0] == "const" else (nodes[n][2],))
            if nodes[n][0] in LEAVES
            else (nodes[n][0], tuple(where[a] for a in operands_of[n]))
            for n in scalars
        ),
        tuple(where[n] for n in fixed),
        tuple(nodes[n][2] for n in inputs),
        registers,
        tuple((kind, tuple(first[a] + k for a, k in taken), first[b] + j) for kind, taken, (b, j) in out),
    )


def is_slow(kind: str) -> bool:
    """Whether a step takes NumPy longer than reading and writing memory."""
    return kind not in ARITHMETIC and kind not in LEAVES


class Kernel:
    """Evaluation of a CasADi expression ``outputs(rows, scalars)`` for many rows at once.

    Parameters
    ----------
    rows : SX (k, 1)
        Symbols that vary from row to row (commands, time, temperatures).
    scalars : SX (m, 1)
        Symbols that are the same in all rows (parameters, shape parameters).
    outputs : SX
        Any matrix of expressions, taken as a column-major list.

    Attributes
    ----------
    n_functions : int
        Distinct non-zero functions among the outputs, up to sign and constant factor, in the order of the outputs.
    index, coefficient : arrays (n_outputs,)
        ``output[k] = coefficient[k] * functions[index[k]]`` (coefficient 0 where the output is identically 0).
    """

    def __init__(self, rows: ca.SX, scalars: ca.SX, outputs: ca.SX) -> None:
        program, table = trace(ca.Function("f", [rows, scalars], [ca.cse(outputs)]))
        wanted = list(dict.fromkeys(node for _, node in table if node is not None))
        where = {node: k for k, node in enumerate(wanted)}
        self.program, self.wanted = program, wanted
        self._take(*with_tangents(program, wanted), rows.numel())
        self.n_outputs = len(table)
        self.index = np.array([0 if node is None else where[node] for _, node in table], dtype=np.intp)
        self.coefficient = np.array([value for value, _ in table])

    def _take(self, program: Program, wanted: list[int], n_rows: int) -> None:
        self.tape, self.n_rows, self.n_functions = tape_of(program, wanted), n_rows, len(wanted)

    @classmethod
    def of(cls, program: Program, wanted: list[int], n_rows: int) -> Self:
        """Kernel of the nodes of a program, each a function and an output, on so many row symbols."""
        self = cls.__new__(cls)
        self._take(program, wanted, n_rows)
        self.n_outputs, self.index, self.coefficient = len(wanted), np.arange(len(wanted)), np.ones(len(wanted))
        return self

    @cached_property
    def _steps(self) -> list[tuple[Callable[..., Any], tuple[int, ...], int]]:
        return [(FUNCTIONS.get(kind) or getattr(np, kind), operands, out) for kind, operands, out in self.tape.steps]

    @cached_property
    def _once(self) -> list[bool]:
        """Whether each input is used once."""
        uses = Counter(k for _, operands, _ in self.tape.steps for k in operands)
        return [uses[len(self.tape.fixed) + k] == 1 for k in range(len(self.tape.inputs))]

    def blocks(
        self,
        rows: Sequence[Array],
        scalars: Numbers = (),
        size: int = KERNEL_BLOCK_ROWS,
        into: Sequence[Array] | Array | None = None,
        spare: int = 0,
    ) -> Iterator[tuple[slice, Array | list[Array]]]:
        """Yield ``(rows of the block, functions (n_functions, m))`` block by block.

        Parameters
        ----------
        rows : values of the row symbols, each (n,).
        scalars : values of the scalar symbols.
        size : rows per block.
        into : n_functions arrays (n,) that receive the functions; without it each block reuses one array.
        spare : rows of zeros behind the functions of that array: BLAS is quicker where their number has a divisor of 4.
        """
        n = len(rows[0])
        with np.errstate(all="ignore"):  # both branches of a switch are evaluated, possibly one of them at 0/0
            values = self.tape.values(scalars)
        fixed = [values[k, ...] for k in range(len(values))]
        work, functions = np.empty((0, 0)), np.empty((0, 0))
        # others are copied: to read with a stride takes longer
        direct = [rows[k].strides[0] in (0, 8) or once for k, once in zip(self.tape.inputs, self._once, strict=True)]
        for start in range(0, n, size):
            part = slice(start, min(start + size, n))
            m = part.stop - start
            if work.shape[1] != m:
                work = np.empty((len(self.tape.inputs) + self.tape.registers, m))
                functions = np.zeros((0 if into is not None else self.n_functions + spare, m))
            target = functions if into is None else [row[part] for row in into]
            slots = [*fixed, *work, *target]
            for k, (number, as_is) in enumerate(zip(self.tape.inputs, direct, strict=True)):
                if as_is:
                    slots[len(fixed) + k] = rows[number][part]
                else:
                    work[k] = rows[number][part]
            with np.errstate(all="ignore"):  # not around the yield, which would silence the caller's arithmetic
                for function, operands, out in self._steps:
                    function(*[slots[k] for k in operands], slots[out])
            yield part, target

    def expand(self, functions: Array | list[Array]) -> Array:
        """All outputs (n_outputs, m) of a block, from its distinct functions."""
        functions, live = np.asarray(functions), self.coefficient != 0
        if (self.coefficient == 1).all():  # positions: a copy is all
            return functions[self.index]
        out = np.zeros((self.n_outputs, functions.shape[1]))
        out[live] = functions[self.index[live]] * self.coefficient[live, None]
        return out

    def functions(self, rows: Sequence[Array], scalars: Numbers = ()) -> Array:
        """Distinct functions over all rows, (n_functions, n): the outputs without repetitions."""
        out = np.empty((self.n_functions, len(rows[0])))
        for _ in self.blocks(rows, scalars, into=out):
            pass
        return out

    def __call__(self, rows: Sequence[Array], scalars: Numbers = (), out: Array | None = None) -> Array:
        """All outputs over all rows, (n_outputs, n); `out` may be a buffer from an earlier call of this kernel."""
        if out is None:
            out = np.zeros((self.n_outputs, len(rows[0])))
        # each function is computed into the first output equal to it, and copied from there while it is in the cache
        home = {
            int(i): k
            for k, (i, c) in reversed(list(enumerate(zip(self.index, self.coefficient, strict=True))))
            if c == 1
        }
        spare = {i: np.empty(len(rows[0])) for i in range(self.n_functions) if i not in home}
        into = [out[home[i]] if i in home else spare[i] for i in range(self.n_functions)]
        copies = [
            (out[k], into[i], float(c))
            for k, (i, c) in enumerate(zip(self.index, self.coefficient, strict=True))
            if c and home.get(int(i)) != k
        ]
        for part, _ in self.blocks(rows, scalars, into=into):
            for target, function, c in copies:
                if c == 1:
                    np.copyto(target[part], function[part])
                elif c == -1:
                    np.negative(function[part], target[part])
                else:
                    np.multiply(function[part], c, target[part])
        return out
