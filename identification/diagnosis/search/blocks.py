"""Proposals' design columns in blocks, and their products without what the geometry spans."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from errormodel.arrays import Array, Columns, Index, Mask
from errormodel.conventions import MOTIONS, Motion
from errormodel.effects.base import Effect, EffectTerm
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.survey_rows import SurveyRows

BLOCK = 250  # proposals scored in one go
NOTHING = 1e-300  # length squared of a column
SINGLE = np.float32  # of the columns that are kept: what is left of one, a thousandth at least, is known to 1e-4


class Lever(NamedTuple):
    """The one lever of all columns of a block, which are then its product with values of the survey's rows."""

    rows: SurveyRows
    lever: Array

    @property
    def square(self) -> Array:
        """The weight (rows,) of each row in products of two columns."""
        return self.rows.summed(self.lever, self.lever[:, None])[:, 0]


class Block(NamedTuple):
    """Proposals with the same number of parameters, and their products without the geometry.

    The geometry is the first `rank` columns of the linear model's basis. It is projected out once; what has been
    accepted since is projected out when the proposals are scored.

    Attributes
    ----------
    numbers : (m,) the proposals'.
    columns : (m, k, n) of parameters as large as is usual, n observations; or of survey's rows, where a lever is
        common to all; `sizes` (m, k) what is usual.
    gram : (m, k, k) products of the columns without what the geometry spans.
    slope : (m, k) products of the columns with the residual.
    square : (m, k) the columns' own lengths squared.
    """

    numbers: Index
    columns: Columns
    sizes: Array
    gram: Array
    slope: Array
    square: Array
    rank: int
    exact: bool
    lever: Lever | None = None

    @classmethod
    def of(
        cls,
        linear: LinearModel,
        numbers: Index,
        columns: Columns,
        sizes: Array,
        exact: bool = False,
        lever: Lever | None = None,
    ) -> Block:
        """A block; `exact`: products in double precision, as random effects need them."""
        m, k, _ = columns.shape
        rank = linear.basis.shape[1]
        empty = np.empty((m, k))
        plain = cls(numbers, columns, sizes, np.empty((m, k, 0)), empty, empty, rank, exact, lever)
        with np.errstate(over="ignore", invalid="ignore"):
            # readings without noise weigh beyond single precision: undefined
            whole = plain.whole()
            undefined = ~np.isfinite(whole).all(axis=(1, 2))
            products = plain.times(np.column_stack([linear.basis, linear.residual]))
        columns[undefined], whole[undefined], products[undefined] = 0.0, 0.0, 0.0
        inner, slope = products[..., :-1], products[..., -1]
        square = np.maximum(np.diagonal(whole, axis1=1, axis2=2), NOTHING)
        return plain._replace(gram=whole - inner @ inner.transpose(0, 2, 1), slope=slope, square=square)

    def observed(self, size: int) -> Array:
        """The columns (m, k, size) as they act on observations; the ties behind these hold none of them."""
        if self.lever is None:
            return self.columns.astype(float)
        number = self.lever.rows.number
        out = np.zeros((*self.columns.shape[:2], size))
        out[..., : len(number)] = self.lever.lever * self.columns[..., number]
        return out

    def parts(self) -> Iterator[Array]:
        """The columns (k, n) of each proposal, in double precision."""
        return (own.astype(float) for own in self.columns)

    def whole(self) -> Array:
        """Products (m, k, k) of the columns with each other."""
        weight = 1.0 if self.lever is None else self.lever.square
        if self.exact:
            return np.array([(own * weight) @ own.T for own in self.parts()])
        columns = self.columns if self.lever is None else self.columns * np.asarray(weight, self.columns.dtype)
        return np.asarray(columns @ self.columns.transpose(0, 2, 1), float)

    def times(self, vectors: Array) -> Array:
        """Products (m, k, r) of the columns with vectors (N, r), whose rows beyond the columns' are not looked at."""
        m, k, n = self.columns.shape
        if self.lever is not None:
            vectors = self.lever.rows.summed(self.lever.lever, vectors)
        vectors = vectors[:n]
        if self.exact:
            return np.array([own @ vectors for own in self.parts()]).reshape(m, k, -1)
        flat = self.columns.reshape(m * k, n) @ vectors.astype(self.columns.dtype)
        return flat.reshape(m, k, -1).astype(float)

    def part(self, some: Mask) -> Block:
        """Some of its proposals."""
        return self._replace(
            numbers=self.numbers[some],
            columns=self.columns[some],
            sizes=self.sizes[some],
            gram=self.gram[some],
            slope=self.slope[some],
            square=self.square[some],
        )


Kind = tuple[bool, int, str, str]  # random or not, number of parameters, element and motion of a common lever


def blocks_of(linear: LinearModel, lists: Sequence[Sequence[Effect]], first: int) -> list[Block]:
    """The effects of some lists, numbered from `first` on, in blocks."""
    stacks: dict[Kind, _Stack] = {}
    for alike in lists:
        terms = linear.terms(alike)
        element, motion = _common(terms) if linear.rows is not None else ("", "")
        kind = (alike[0].random, len(terms), element, motion)
        if kind not in stacks:
            lever = None
            if linear.rows is not None and element:
                lever = Lever(linear.rows, linear.levers[element][MOTIONS.index(motion)])
            stacks[kind] = _Stack(len(terms), linear.size if lever is None else len(lever.rows.slots.T), lever)
        sizes = np.array([t.size for t in terms])
        room = stacks[kind].room(first, len(alike), sizes)
        if element:
            for k, term in enumerate(terms):
                (value,) = term.motion.values()
                np.multiply(np.asarray(value, SINGLE), SINGLE(term.size), out=room[:, k])
        else:
            linear.fill(terms, room, scaled=True)
        first += len(alike)
    return [block for kind, stack in sorted(stacks.items()) for block in stack.blocks(linear, kind[0])]


def _common(terms: Sequence[EffectTerm]) -> tuple[str, Motion | str]:
    """Element and motion, where all terms move one element in one motion; else nothing."""
    moved = {(t.element, *t.motion) for t in terms}
    (own, *others) = moved
    return (own[0], own[1]) if not others and len(own) == 2 else ("", "")


class _Stack:
    """Proposals of the same number of parameters, gathered in blocks that fit into a cache's neighbourhood."""

    def __init__(self, parameters: int, length: int, lever: Lever | None) -> None:
        self._shape, self._lever = (parameters, length), lever
        self._full: list[list[tuple[Index, Columns, Array]]] = [[]]
        self._count = 0

    def room(self, first: int, count: int, size: Array) -> Columns:
        """Where the columns (count, k, n) of the proposals from number `first` on go; their sizes are (k,)."""
        if self._count + count > BLOCK:
            self._full.append([])
            self._count = 0
        self._count += count
        columns = np.empty((count, *self._shape), SINGLE)
        self._full[-1].append((np.arange(first, first + count), columns, np.tile(size, (count, 1))))
        return columns

    def blocks(self, linear: LinearModel, exact: bool) -> Iterator[Block]:
        for k, parts in enumerate(self._full):
            joined = [np.concatenate(own) for own in zip(*parts, strict=True)]
            self._full[k] = []
            yield Block.of(linear, joined[0], joined[1], joined[2], exact, self._lever)
