"""Proposals' design columns in blocks, and their products without what the geometry spans."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import groupby
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from errormodel.arrays import Array, Columns, Index, Mask
from errormodel.conventions import MOTIONS, Motion
from errormodel.effects.base import Effect, EffectTerm
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.random_effects import DEPENDENT
from identification.diagnosis.linear.survey_rows import SurveyRows
from identification.runtime.parallel import parallel_map

COLUMNS = 1000  # of a block: their products with some hundred vectors stay within a cache's neighbourhood
EXACT_AT_ONCE = 1_000_000  # of their values, in double precision: limits the memory
NOTHING = 1e-300  # length squared of a column
SINGLE = np.float32  # of the columns that are kept: what is left of one, a thousandth at least, is known to 1e-4


@dataclass(frozen=True, eq=False)
class Lever:
    """The one lever of all columns of some blocks, which are then its product with values of the survey's rows."""

    rows: SurveyRows
    lever: Array

    @cached_property
    def square(self) -> Array:
        """The weight (rows,) of each row in products of two columns."""
        return np.asarray(self.rows.summed(self.lever, self.rows.gathered(self.lever[:, None]))[:, 0], float)


class Vectors:
    """Vectors (N, r) that blocks are multiplied with: what is the same for all blocks is made once.

    The vectors' rows beyond the observations are not looked at.
    """

    def __init__(self, vectors: Array) -> None:
        self._vectors = vectors
        self._cast: dict[tuple[bool, DTypeLike], Columns] = {}

    @property
    def count(self) -> int:
        return len(self._vectors.T)

    def on(self, lever: Lever | None) -> OnLever:
        """The same for blocks of one lever."""
        return OnLever(self, lever)

    def cast(self, rows: SurveyRows | None, kind: DTypeLike) -> Columns:
        """The vectors in some precision, gathered by rows where these are given."""
        key = (rows is None, kind)
        if key not in self._cast:
            own = self._vectors.astype(kind, copy=False)
            self._cast[key] = own if rows is None else rows.gathered(own)
        return self._cast[key]


class OnLever:
    """Vectors for blocks of one lever: their sums over the observations of each row."""

    def __init__(self, vectors: Vectors, lever: Lever | None) -> None:
        self._vectors, self._lever = vectors, lever
        self._summed: dict[DTypeLike, Columns] = {}

    def cast(self, kind: DTypeLike) -> Columns:
        """What columns in some precision are multiplied with."""
        if self._lever is None:
            return self._vectors.cast(None, kind)
        if kind not in self._summed:
            rows = self._lever.rows
            self._summed[kind] = rows.summed(self._lever.lever, self._vectors.cast(rows, kind))
        return self._summed[kind]


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
        geometry: OnLever | None = None,
    ) -> Block:
        """A block.

        Parameters
        ----------
        exact : products in double precision, as random effects need them.
        geometry : the linear model's basis and residual as vectors on the lever, where they are made already.
        """
        m, k, _ = columns.shape
        rank = linear.basis.shape[1]
        empty = np.empty((m, k))
        plain = cls(numbers, columns, sizes, np.empty((m, k, 0)), empty, empty, rank, exact, lever)
        with np.errstate(over="ignore", invalid="ignore"):
            # readings without noise weigh beyond single precision: undefined
            whole = plain.whole()
            undefined = ~np.isfinite(whole).all(axis=(1, 2))
            columns[undefined], whole[undefined] = 0.0, 0.0
            if exact:
                plain = plain._in_principal_components(whole)
                whole = plain.whole()
            products = plain.times(geometry or geometry_of(linear).on(lever))
        products[undefined] = 0.0
        inner, slope = products[..., :-1], products[..., -1].copy()  # a view would keep all products
        square = np.maximum(np.diagonal(whole, axis1=1, axis2=2), NOTHING)
        return plain._replace(gram=whole - gram_of(inner), slope=slope, square=square)

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

    def times(self, vectors: OnLever) -> Array:
        """Products (m, k, r) of the columns with vectors on the block's lever."""
        m, k, n = self.columns.shape
        if self.exact:
            own, most = vectors.cast(np.float64)[:n], max(EXACT_AT_ONCE // (k * n), 1)
            some = (self.columns[first : first + most].reshape(-1, n) for first in range(0, m, most))
            return np.asarray(np.vstack([part.astype(float) @ own for part in some]).reshape(m, k, -1), float)
        own = vectors.cast(self.columns.dtype)[:n]
        return (self.columns.reshape(m * k, n) @ own).reshape(m, k, -1).astype(float)

    def _in_principal_components(self, whole: Array) -> Block:
        """The block of random effects with as few parameters as their products (m, k, k) need."""
        values, vectors = np.linalg.eigh(whole)
        rank = int((values > DEPENDENT * values[:, -1:]).sum(axis=1).max(initial=1))
        turned = vectors[:, :, -rank:].transpose(0, 2, 1)
        columns = np.array([t @ own for t, own in zip(turned, self.parts(), strict=True)], self.columns.dtype)
        return self._replace(columns=columns, sizes=self.sizes[:, :rank])

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


def geometry_of(linear: LinearModel) -> Vectors:
    """A linear model's basis and its residual."""
    return Vectors(np.column_stack([linear.basis, linear.residual]))


def gram_of(columns: Array) -> Array:
    """Products (m, k, k) of each proposal's rows (m, k, r) with each other."""
    if columns.shape[1] == 1:
        return np.asarray(np.einsum("mkr,mkr->mk", columns, columns)[..., None])
    return np.asarray(columns @ columns.transpose(0, 2, 1))


def products(blocks: Iterable[Block], vectors: Vectors) -> Iterator[Array]:
    """Products (m, k, r) of each block's columns with vectors; sums over rows once for neighbours with one lever."""
    for lever, own in groupby(blocks, lambda block: block.lever):
        here = vectors.on(lever)
        yield from (block.times(here) for block in own)


class Kind(NamedTuple):
    """Element and motion of a common lever ("" where there is none), random or not, and the number of parameters."""

    element: str
    motion: Motion | Literal[""]
    random: bool
    parameters: int


Made = tuple[Index, Columns, Array]  # numbers of some proposals (m,), columns (m, k, n), usual sizes (m, k)


def columns_of(linear: LinearModel, lists: Sequence[Sequence[Effect]], first: int) -> dict[Kind, list[Made]]:
    """The columns of the effects of some lists, numbered from `first` on."""
    out: dict[Kind, list[Made]] = {}
    for alike in lists:
        terms = linear.terms(alike)
        element, motion = _common(terms) if linear.rows is not None else ("", "")
        rows = linear.rows if element else None
        columns = np.empty((len(alike), len(terms), linear.size if rows is None else len(rows.slots.T)), SINGLE)
        if element:
            for k, term in enumerate(terms):
                (value,) = term.motion.values()
                np.multiply(np.asarray(value, SINGLE), SINGLE(term.size), out=columns[:, k])
        else:
            linear.fill(terms, columns, scaled=True)
        numbers, sizes = np.arange(first, first + len(alike)), np.array([t.size for t in terms])
        own = out.setdefault(Kind(element, motion, alike[0].random, len(terms)), [])
        own.append((numbers, columns, np.tile(sizes, (len(alike), 1))))
        first += len(alike)
    return out


def _common(terms: Sequence[EffectTerm]) -> tuple[str, Motion | Literal[""]]:
    """Element and motion, where all terms move one element in one motion; else nothing."""
    moved = {(t.element, motion) for t in terms for motion in t.motion}
    return moved.pop() if len(moved) == 1 and all(t.motion for t in terms) else ("", "")


def blocks_of(linear: LinearModel, made: dict[Kind, list[Made]]) -> list[Block]:
    """Columns in blocks, those of one lever side by side; `made` is emptied, as both would be too much."""
    geometry = geometry_of(linear)
    jobs = [
        partial(_on_one_lever, linear, geometry, {kind: made.pop(kind) for kind in own})
        for own in ([*kinds] for _, kinds in groupby(sorted(made), lambda kind: kind[:2]))
    ]
    return [block for blocks in parallel_map(jobs) for block in blocks]


def _on_one_lever(linear: LinearModel, geometry: Vectors, made: dict[Kind, list[Made]]) -> list[Block]:
    element, motion = next((kind.element, kind.motion) for kind in made)
    lever = None
    if linear.rows is not None and motion:
        lever = Lever(linear.rows, linear.levers[element][MOTIONS.index(motion)])
    here, blocks = geometry.on(lever), []
    for kind in sorted(made):
        for some in _in_parts(made.pop(kind), kind.parameters):
            joined = [np.concatenate(own) for own in zip(*some, strict=True)]
            some.clear()
            blocks.append(Block.of(linear, joined[0], joined[1], joined[2], kind.random, lever, here))
    return blocks


def _in_parts(made: list[Made], parameters: int) -> Iterator[list[Made]]:
    """Proposals in lists that have at most `COLUMNS` columns, or are one."""
    part, count = list[Made](), 0
    for own in made:
        if part and (count + len(own[0])) * parameters > COLUMNS:
            yield part
            part, count = [], 0
        part.append(own)
        count += len(own[0])
    yield part
