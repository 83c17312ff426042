"""Fast numerical evaluation of a CasADi expression: its instruction list, compiled to NumPy on blocks of rows.

CasADi remains the only model. Common sub-expressions (also up to sign) are merged, those that do not depend on the row
are computed once as floats, and the rest becomes a NumPy program that works in place on blocks that fit the cache. No
compiler is needed. The tests compare it with CasADi to 1e-12.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from errormodel.arrays import Array, Numbers

# rows per block; the functions of a five-axis machine then fit the second-level cache
KERNEL_BLOCK_ROWS = 4096

_UNARY_UFUNCS = {
    ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TAN: "tan", ca.OP_ASIN: "arcsin", ca.OP_ACOS: "arccos",
    ca.OP_ATAN: "arctan", ca.OP_SQ: "square", ca.OP_SQRT: "sqrt", ca.OP_EXP: "exp", ca.OP_LOG: "log",
    ca.OP_FABS: "absolute", ca.OP_SIGN: "sign", ca.OP_INV: "reciprocal", ca.OP_TANH: "tanh", ca.OP_SINH: "sinh",
    ca.OP_COSH: "cosh", ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil", ca.OP_NOT: "logical_not",
    ca.OP_NEG: "negative", ca.OP_ASINH: "arcsinh", ca.OP_ACOSH: "arccosh", ca.OP_ATANH: "arctanh",
    ca.OP_EXPM1: "expm1", ca.OP_LOG1P: "log1p",
}  # fmt: skip
_BINARY_UFUNCS = {
    ca.OP_ADD: "add", ca.OP_SUB: "subtract", ca.OP_MUL: "multiply", ca.OP_DIV: "divide", ca.OP_POW: "power",
    ca.OP_CONSTPOW: "power", ca.OP_FMIN: "fmin", ca.OP_FMAX: "fmax", ca.OP_ATAN2: "arctan2", ca.OP_LT: "less",
    ca.OP_LE: "less_equal", ca.OP_EQ: "equal", ca.OP_NE: "not_equal", ca.OP_AND: "logical_and",
    ca.OP_OR: "logical_or", ca.OP_FMOD: "fmod", ca.OP_HYPOT: "hypot", ca.OP_COPYSIGN: "copysign",
    ca.OP_IF_ELSE_ZERO: "where",
}  # fmt: skip
# functions f with f(x, y) = f(y, x)
_COMMUTATIVE = {"add", "multiply", "fmin", "fmax", "equal", "not_equal", "logical_and", "logical_or", "hypot"}
# functions with f(-x) = -f(x)
_ODD_UFUNCS = {"sin", "tan", "arcsin", "arctan", "tanh", "sinh", "arcsinh", "arctanh", "reciprocal", "sign"}
_EVEN_UFUNCS = {"cos", "square", "absolute", "cosh"}  # functions with f(-x) = f(x)

Ref = tuple[int, int]  # (sign, node)


@dataclass
class _Program:
    """Hash-consed nodes of the expression; a reference carries a sign, so that a negation costs nothing."""

    nodes: list[tuple[Any, ...]] = field(default_factory=list)
    scalar: list[bool] = field(default_factory=list)  # whether the node is independent of the row
    index: dict[tuple[Any, ...], int] = field(default_factory=dict)

    def node(self, key: tuple[Any, ...], scalar: bool) -> int:
        if key not in self.index:
            self.index[key] = len(self.nodes)
            self.nodes.append(key)
            self.scalar.append(scalar)
        return self.index[key]

    def constant(self, value: float) -> Ref:
        return (-1 if value < 0 else 1), self.node(("const", abs(value)), True)

    def plain(self, ref: Ref) -> int:
        sign, node = ref
        if sign > 0:
            return node
        kind, *args = self.nodes[node]
        if kind == "subtract":  # as cheap as a negation, and +0 where both operands are equal, as in CasADi
            return self.node((kind, *args[::-1]), self.scalar[node])
        return self.node(("negative", node), self.scalar[node])

    def unary(self, name: str, a: Ref) -> Ref:
        if name == "negative":
            return -a[0], a[1]
        sign = 1
        if name in _ODD_UFUNCS or name in _EVEN_UFUNCS:
            sign, a = (a[0] if name in _ODD_UFUNCS else 1), (1, a[1])
        node = self.plain(a)
        return sign, self.node((name, node), self.scalar[node])

    def binary(self, name: str, a: Ref, b: Ref) -> Ref:
        sign = 1
        if name in ("multiply", "divide"):
            sign, a, b = a[0] * b[0], (1, a[1]), (1, b[1])
        elif name in ("add", "subtract"):
            if name == "subtract":
                b = (-b[0], b[1])
            sign = a[0]
            name, a, b = ("add" if a[0] == b[0] else "subtract"), (1, a[1]), (1, b[1])
            if name == "subtract" and a[1] > b[1]:  # x - y and y - x are one function
                sign, a, b = -sign, b, a
        elif name == "where":  # the condition's sign is irrelevant, the value's is kept
            sign, a, b = b[0], (1, a[1]), (1, b[1])
        left, right = self.plain(a), self.plain(b)
        if name in _COMMUTATIVE and left > right:
            left, right = right, left
        return sign, self.node((name, left, right), self.scalar[left] and self.scalar[right])


def _trace(function: ca.Function) -> tuple[_Program, list[tuple[float, int | None]]]:
    """Program of a function, and (coefficient, node or None if zero) of each element of its dense output."""
    program, work = _Program(), {}
    sparsity = function.sparsity_out(0)
    outputs: list[tuple[float, int | None]] = [(0.0, None)] * sparsity.numel()
    rows, columns = sparsity.get_triplet()
    place = [r + c * sparsity.size1() for r, c in zip(rows, columns, strict=True)]
    for k in range(function.n_instructions()):
        op, args, out = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_INPUT:
            work[out[0]] = (1, program.node(("input", args[0], args[1]), args[0] == 1))
        elif op == ca.OP_CONST:
            work[out[0]] = program.constant(function.instruction_constant(k))
        elif op == ca.OP_OUTPUT:
            sign, node = work[args[0]]
            kind = program.nodes[node]
            if kind[0] == "const":  # a constant column: one function, "1", times its value
                value = sign * kind[1]
                one = program.node(("const", 1.0), True)
                outputs[place[out[1]]] = (value, one) if value else (0.0, None)
            else:
                outputs[place[out[1]]] = (float(sign), node)
        elif op == ca.OP_TWICE:
            work[out[0]] = program.binary("multiply", program.constant(2.0), work[args[0]])
        elif op == ca.OP_ASSIGN:
            work[out[0]] = work[args[0]]
        elif op in _UNARY_UFUNCS:
            work[out[0]] = program.unary(_UNARY_UFUNCS[op], work[args[0]])
        elif op in _BINARY_UFUNCS:
            work[out[0]] = program.binary(_BINARY_UFUNCS[op], work[args[0]], work[args[1]])
        else:
            raise NotImplementedError(f"CasADi operation {op} has no NumPy counterpart yet; add it to kernel.py")
    return program, outputs


def _emit(program: _Program, wanted: list[int]) -> tuple[str, int]:
    """Python source of the block program, and the number of work registers that it needs."""
    needed, stack = set(), list(wanted)
    while stack:
        node = stack.pop()
        if node not in needed:
            needed.add(node)
            if program.nodes[node][0] not in ("const", "input"):
                stack.extend(program.nodes[node][1:])
    last = {a: n for n in sorted(needed) if program.nodes[n][0] not in ("const", "input") for a in program.nodes[n][1:]}
    slot = {node: k for k, node in enumerate(wanted)}
    name: dict[int, str] = {}
    head, body, free, registers = [], [], list[str](), 0
    for node in sorted(needed):
        kind, *args = program.nodes[node]
        if kind == "const":
            name[node] = f"float('{args[0]!r}')"
            if node in slot:
                body.append(f"F[{slot[node]}][...] = {name[node]}")
        elif kind == "input":
            name[node] = f"p[{args[1]}]" if args[0] == 1 else f"x{args[1]}"
            if node in slot:
                body.append(f"F[{slot[node]}][...] = {name[node]}")
        elif program.scalar[node]:
            name[node] = f"s{node}"
            operands = ", ".join(name[a] for a in args) + (", 0.0" if kind == "where" else "")
            head.append(f"s{node} = float(np.{kind}({operands}))")
            if node in slot:
                body.append(f"F[{slot[node]}][...] = s{node}")
        else:
            operands = ", ".join(name[a] for a in args)
            # registers of operands that are used here for the last time are freed first: ufuncs may work in place
            free += [name[a] for a in dict.fromkeys(args) if last[a] == node and name[a].startswith("w")]
            if node in slot:
                name[node] = f"f{node}"
                body.append(f"f{node} = F[{slot[node]}]")
            elif free:
                name[node] = free.pop()
            else:
                name[node], registers = f"w{registers}", registers + 1
            if kind == "where":  # not a product, since the branch not taken may be infinite
                body.append(f"np.copyto({name[node]}, np.where({operands}, 0.0))")
            else:
                body.append(f"np.{kind}({operands}, out={name[node]})")
    inputs = sorted({program.nodes[n][2] for n in needed if program.nodes[n][:2] == ("input", 0)})
    unpack = [f"x{k} = X[{k}]" for k in inputs] + [f"w{k} = W[{k}]" for k in range(registers)]
    lines = ["def scalars(p, np):", *(f"    {s}" for s in head), "    return locals()"]
    text = "\n".join(lines)
    lines = ["def block(X, W, F, p, s, np):", *(f"    {n} = s['{n}']" for n in (h.split(" = ")[0] for h in head))]
    return text + "\n" + "\n".join([*lines, *(f"    {s}" for s in unpack + body), "    return F"]), registers


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
        Distinct non-zero functions among the outputs, up to sign and constant factor.
    index, coefficient : arrays (n_outputs,)
        ``output[k] = coefficient[k] * functions[index[k]]`` (coefficient 0 where the output is identically 0).
    """

    def __init__(self, rows: ca.SX, scalars: ca.SX, outputs: ca.SX) -> None:
        function = ca.Function("f", [rows, scalars], [ca.cse(outputs)])
        program, table = _trace(function)
        wanted = sorted({node for _, node in table if node is not None})
        where = {node: k for k, node in enumerate(wanted)}
        source, self._registers = _emit(program, wanted)
        scope: dict[str, Any] = {}
        exec(compile(source, "<kernel>", "exec"), scope)
        self._block, self._scalars = scope["block"], scope["scalars"]
        self.n_functions = len(wanted)
        self.n_outputs = len(table)
        self.index = np.array([0 if node is None else where[node] for _, node in table], dtype=np.intp)
        self.coefficient = np.array([value for value, _ in table])

    def blocks(
        self,
        rows: Sequence[Array],
        scalars: Numbers = (),
        size: int = KERNEL_BLOCK_ROWS,
        into: Sequence[Array] | Array | None = None,
    ) -> Iterator[tuple[slice, Array | list[Array]]]:
        """Yield ``(rows of the block, functions (n_functions, m))`` block by block.

        Parameters
        ----------
        rows : values of the row symbols, each (n,).
        scalars : values of the scalar symbols.
        size : rows per block.
        into : n_functions arrays (n,) that receive the functions; without it each block reuses one array.
        """
        n = len(rows[0])
        p = [float(v) for v in scalars]
        work = np.empty((self._registers, min(size, n)))
        functions = np.empty((self.n_functions, min(size, n))) if into is None else None
        with np.errstate(all="ignore"):  # both branches of a switch are evaluated, possibly one of them at 0/0
            s = self._scalars(p, np)
        for start in range(0, n, size):
            part = slice(start, min(start + size, n))
            m = part.stop - start
            target = work[:0, :m] if into is None else [row[part] for row in into]
            if functions is not None:
                target = functions[:, :m]
            with np.errstate(all="ignore"):  # not around the yield, which would silence the caller's arithmetic
                done = self._block([x[part] for x in rows], work[:, :m], target, p, s, np)
            yield part, done

    def expand(self, functions: Array | list[Array]) -> Array:
        """All outputs (n_outputs, m) of a block, from its distinct functions."""
        functions, live = np.asarray(functions), self.coefficient != 0
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
