"""The instruction list of a CasADi expression as nodes, each of which is one NumPy function of others.

CasADi remains the only model. Common sub-expressions (also up to sign) are merged.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import frexp
from typing import Any

import casadi as ca

UNARY = {
    ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TAN: "tan", ca.OP_ASIN: "arcsin", ca.OP_ACOS: "arccos",
    ca.OP_ATAN: "arctan", ca.OP_SQ: "square", ca.OP_SQRT: "sqrt", ca.OP_EXP: "exp", ca.OP_LOG: "log",
    ca.OP_FABS: "absolute", ca.OP_SIGN: "sign", ca.OP_INV: "reciprocal", ca.OP_TANH: "tanh", ca.OP_SINH: "sinh",
    ca.OP_COSH: "cosh", ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil", ca.OP_NOT: "logical_not",
    ca.OP_NEG: "negative", ca.OP_ASINH: "arcsinh", ca.OP_ACOSH: "arccosh", ca.OP_ATANH: "arctanh",
    ca.OP_EXPM1: "expm1", ca.OP_LOG1P: "log1p",
}  # fmt: skip
BINARY = {
    ca.OP_ADD: "add", ca.OP_SUB: "subtract", ca.OP_MUL: "multiply", ca.OP_DIV: "divide", ca.OP_POW: "power",
    ca.OP_CONSTPOW: "power", ca.OP_FMIN: "fmin", ca.OP_FMAX: "fmax", ca.OP_ATAN2: "arctan2", ca.OP_LT: "less",
    ca.OP_LE: "less_equal", ca.OP_EQ: "equal", ca.OP_NE: "not_equal", ca.OP_AND: "logical_and",
    ca.OP_OR: "logical_or", ca.OP_FMOD: "fmod", ca.OP_HYPOT: "hypot", ca.OP_COPYSIGN: "copysign",
    ca.OP_IF_ELSE_ZERO: "where",
}  # fmt: skip
# functions f with f(x, y) = f(y, x)
_COMMUTATIVE = {"add", "multiply", "fmin", "fmax", "equal", "not_equal", "logical_and", "logical_or", "hypot"}
# functions with f(-x) = -f(x)
_ODD = {"sin", "tan", "arcsin", "arctan", "tanh", "sinh", "arcsinh", "arctanh", "reciprocal", "sign"}
_EVEN = {"cos", "square", "absolute", "cosh"}  # functions with f(-x) = f(x)

LEAVES = ("const", "input")

Ref = tuple[int, int]  # (sign, node)


@dataclass
class Program:
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
        if name in _ODD or name in _EVEN:
            sign, a = (a[0] if name in _ODD else 1), (1, a[1])
        node = self.plain(a)
        return sign, self.node((name, node), self.scalar[node])

    def binary(self, name: str, a: Ref, b: Ref) -> Ref:
        sign = 1
        if name in ("multiply", "divide"):
            sign, a, b = a[0] * b[0], (1, a[1]), (1, b[1])
            kind, *value = self.nodes[b[1]]
            if name == "divide" and kind == "const" and frexp(value[0])[0] == 0.5:  # by a power of two: the same bits
                name, b = "multiply", self.constant(1 / value[0])
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

    def needed(self, wanted: Iterable[int]) -> list[int]:
        """The nodes that others are computed from, and these, each after its operands."""
        found, stack = set[int](), list(wanted)
        while stack:
            node = stack.pop()
            if node not in found:
                found.add(node)
                stack.extend(self.operands(node))
        return sorted(found)

    def operands(self, node: int) -> tuple[int, ...]:
        whole = self.nodes[node]
        return () if whole[0] in LEAVES else whole[1:]


def with_tangents(program: Program, wanted: list[int]) -> tuple[Program, list[int]]:
    """The program with sine and cosine of one angle from the tangent of half of it, and the wanted nodes in it.

    NumPy computes a tangent in a quarter of the time of a sine, where the processor has wide vectors, and in the same
    elsewhere. Errors are of the order of 1e-16.
    """
    needed = program.needed(wanted)
    sines, cosines = ({program.nodes[n][1] for n in needed if program.nodes[n][0] == f} for f in ("sin", "cos"))
    both = {a for a in sines & cosines if not program.scalar[a]}
    out, new = Program(), dict[int, int]()
    for node in needed:
        kind, *operands = program.nodes[node]
        if kind in LEAVES:
            new[node] = out.node(program.nodes[node], program.scalar[node])
        elif kind in ("sin", "cos") and operands[0] in both:
            half = out.binary("multiply", out.constant(0.5), (1, new[operands[0]]))
            tangent = out.unary("tan", half)
            square, one = out.unary("square", tangent), out.constant(1.0)
            above = out.binary("add", tangent, tangent) if kind == "sin" else out.binary("subtract", one, square)
            new[node] = out.plain(out.binary("divide", above, out.binary("add", one, square)))
        else:
            new[node] = out.node((kind, *(new[a] for a in operands)), program.scalar[node])
    return out, [new[node] for node in wanted]


def trace(function: ca.Function) -> tuple[Program, list[tuple[float, int | None]]]:
    """Program of a function, and (coefficient, node or None if zero) of each element of its dense output."""
    program, work = Program(), {}
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
        elif op in UNARY:
            work[out[0]] = program.unary(UNARY[op], work[args[0]])
        elif op in BINARY:
            work[out[0]] = program.binary(BINARY[op], work[args[0]], work[args[1]])
        else:
            raise NotImplementedError(f"CasADi operation {op} has no NumPy counterpart yet; add it to kernel.py")
    return program, outputs
