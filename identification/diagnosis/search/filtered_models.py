"""A linear model behind the filters that make noises white, and what further columns would explain there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.effects.base import Effect
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.random_effects import EXACT
from identification.diagnosis.search.weighed_products import GEOMETRY, WeighedProducts
from identification.estimation.noise import Noise, series_edges
from identification.estimation.orthonormal_basis import APART

ROUNDED = 1e-11  # of a column's length squared: as much is rounding


@dataclass(frozen=True)
class Filtered:
    """A linear model behind the filter that makes a noise white.

    Attributes
    ----------
    triangle : (r, r) Cholesky factor of the products of the filtered columns that span what the model fits.
    taken : (r,) the residual along the orthonormal columns that it makes of them.
    square, freedom : of what that leaves of the residual.
    likelihood : restricted log likelihood, up to a constant.
    """

    triangle: Array
    taken: Array
    square: float
    freedom: int
    likelihood: float

    @classmethod
    def of(cls, triangle: Array, along: Array, square: float, freedom: int, lengths: float = 0.0) -> Filtered:
        """From products of the filtered columns with each other, and of the residual with them and with itself.

        Parameters
        ----------
        lengths : log determinant of the triangle before the filter; 0: of orthonormal columns.
        """
        taken = solved(triangle, along)
        left = max(float(square - taken @ taken), EXACT)
        determinant = float(np.log(np.diag(triangle)).sum()) - lengths
        return cls(triangle, taken, left, freedom, -freedom / 2 * float(np.log(left)) - determinant)


class Left(NamedTuple):
    """Of columns behind a filter, what the model leaves: products with each other and the residual; their squares.

    Those of the columns with each other are (k, k) of each group, one after the other.
    """

    grams: list[Array]
    slopes: Array
    squares: Array


class FilteredModel(Protocol):
    """A linear model behind the filters of some noises."""

    @property
    def filtered(self) -> Sequence[Filtered]: ...

    def left_of(self, groups: Sequence[Sequence[Effect]]) -> Iterator[Left]:
        """What each filter leaves of the columns of groups of effects."""
        ...

    def left_of_columns(self, columns: Array) -> Iterator[Left]:
        """The same of columns (k, N + ties)."""
        ...


def solved(triangle: Array, columns: Array) -> Array:
    """Solution of a lower triangular system."""
    from scipy.linalg import solve_triangular

    return np.asarray(solve_triangular(triangle, columns, lower=True, check_finite=False))


class FromBasis:
    """A linear model behind filters, made of its orthonormal basis."""

    def __init__(self, linear: LinearModel, noises: Sequence[Noise | None]) -> None:
        self._linear, self._noises = linear, noises
        self._edges = series_edges(linear.index)
        both = np.vstack([linear.basis.T, linear.residual])
        self.filtered = [self._made(both, noise) for noise in noises]

    def _made(self, both: Array, noise: Noise | None) -> Filtered:
        freedom = self._linear.freedom
        if noise is None:
            return Filtered.of(np.eye(len(both) - 1), np.zeros(len(both) - 1), self._linear.square, freedom)
        white = noise.whitened(both, self._edges)
        whole: Array = white @ white.T
        triangle = np.asarray(np.linalg.cholesky(whole[:-1, :-1]), float)
        return Filtered.of(triangle, whole[-1, :-1], float(whole[-1, -1]), freedom)

    def left_of(self, groups: Sequence[Sequence[Effect]]) -> Iterator[Left]:
        columns = [np.vstack([self._linear.columns(e)[0] for e in group]) for group in groups]
        ends = np.cumsum([0, *map(len, columns)]).tolist()
        return self._left(np.vstack(columns), [slice(*ends[k : k + 2]) for k in range(len(columns))])

    def left_of_columns(self, columns: Array) -> Iterator[Left]:
        return self._left(columns, [slice(len(columns))])

    def _left(self, columns: Array, parts: Sequence[slice]) -> Iterator[Left]:
        linear = self._linear
        for noise, behind in zip(self._noises, self.filtered, strict=True):
            if noise is None:
                weighed, inner = columns, columns @ linear.basis
            else:
                weighed = noise.weighed(columns, self._edges)
                inner = solved(behind.triangle, (weighed @ linear.basis).T).T
            slopes = weighed @ linear.residual - inner @ behind.taken
            grams = [weighed[own] @ columns[own].T - inner[own] @ inner[own].T for own in parts]
            yield Left(grams, slopes, np.einsum("kn,kn->k", weighed, columns))


class DependentError(Exception):
    """The columns of a model's effects are too alike for their products to tell them apart."""


class FromProducts:
    """A linear model behind filters, put together of products that models of the same geometry share.

    The first noise is white.

    Raises
    ------
    DependentError
        Products are not exact enough for what these effects leave of each other.
    """

    def __init__(self, linear: LinearModel, products: WeighedProducts) -> None:
        assert linear.lineage is not None
        self._numbers = [GEOMETRY, *map(products.number, linear.lineage.effects)]
        parts = [products.part(n) for n in self._numbers]
        self._free = [part.free for part in parts]
        ends = np.cumsum([0, *map(len, self._free)]).tolist()
        self._places = [slice(*ends[k : k + 2]) for k in range(len(parts))]
        size = parts[0].left.shape[1]
        seen, tied = linear.residual[:size], linear.residual[size:]
        whole = self._whole(products)
        self._weighed = products.weighed(seen[None])[:, 0]  # the residual
        along, squares = np.empty(whole.shape[:2]), self._weighed @ seen + tied @ tied
        diagonal, at = np.einsum("nkk->nk", whole), 0
        for part, hold, own in zip(parts, (np.zeros(0), *linear.holds), self._places, strict=True):
            along[:, own] = self._weighed @ part.left[part.free].T
            if len(hold):
                diagonal[:, own] += hold**2
                along[:, own] += hold * tied[at : at + len(hold)]
                at += len(hold)
        diagonal[:, diagonal[0] <= 0] = 1.0  # a column of which the geometry leaves nothing: its coefficient is 0
        scale = np.sqrt(diagonal[0])
        for k in range(len(whole)):
            whole[k] /= scale[:, None] * scale
        some = _independent(whole[0], linear.basis.shape[1])
        if len(some) < len(scale):
            whole, along, scale = whole[:, some[:, None], some], along[:, some], scale[some]
        self._some, self._scale = some, scale
        lengths, self.filtered = 0.0, list[Filtered]()
        for k, own in enumerate(whole):
            triangle = _triangle(own)
            if not k:
                lengths = float(np.log(np.diag(triangle)).sum())
            self.filtered.append(
                Filtered.of(triangle, along[k] / self._scale, float(squares[k]), linear.freedom, lengths)
            )
        self._products = products

    def _whole(self, products: WeighedProducts) -> Array:
        """Products (noises, r, r) of all columns that are free; zero above the diagonal."""
        found = products.between(self._numbers, self._numbers)
        rank = self._places[-1].stop
        whole = np.zeros((len(products.noises), rank, rank))
        for k, (one, rows) in enumerate(zip(self._numbers, self._places, strict=True)):
            for n, columns in enumerate(self._places[: k + 1]):
                whole[:, rows, columns] = _part(found[one, self._numbers[n]], self._free[k], self._free[n])
        return whole

    def left_of(self, groups: Sequence[Sequence[Effect]]) -> Iterator[Left]:
        numbers = [[self._products.number(e) for e in group] for group in groups]
        every = list(dict.fromkeys(n for group in numbers for n in group))
        crossed = self._products.between(every, self._numbers)
        geometry = self._products.between([GEOMETRY], [GEOMETRY])[GEOMETRY, GEOMETRY]
        inner, slopes, squares = dict[int, Array](), dict[int, Array](), dict[int, Array]()
        for n in every:
            part, along = self._products.part(n), crossed[n, GEOMETRY]
            inner[n] = self._inner([crossed[one, n] for one in self._numbers])
            own = self._products.between([n], [n])[n, n]
            # what the geometry has taken is part of the columns' own lengths
            further = np.einsum("nkr,kr->nk", 2 * along + part.taken @ geometry, part.taken)
            squares[n] = np.einsum("nkk->nk", own) + further
            slopes[n] = self._slopes(self._weighed @ part.left.T, inner[n])
        grams = [self._grams(group, inner) for group in numbers]
        order = [n for group in numbers for n in group]
        sides = [np.concatenate([own[n] for n in order], axis=1) for own in (slopes, squares)]
        for k in range(len(self.filtered)):
            yield Left([gram[k] for gram in grams], sides[0][k], sides[1][k])

    def _grams(self, group: Sequence[int], inner: Mapping[int, Array]) -> Array:
        """Products (noises, k, k) of what is left of the columns of a group."""
        own, along = self._products.between(group, group), np.concatenate([inner[n] for n in group], axis=2)
        whole = np.concatenate([np.concatenate([own[a, b] for b in group], axis=2) for a in group], axis=1)
        return np.asarray(whole - along.transpose(0, 2, 1) @ along)

    def left_of_columns(self, columns: Array) -> Iterator[Left]:
        seen = columns[:, : self._weighed.shape[1]]
        weighed = self._products.weighed(seen)
        parts = [self._products.part(n).left for n in self._numbers]
        inner = self._inner([p @ weighed.transpose(0, 2, 1) for p in parts])
        slopes = self._slopes(self._weighed @ seen.T, inner)
        for own, along, slope in zip(weighed, inner, slopes, strict=True):
            yield Left([own @ seen.T - along.T @ along], slope, np.einsum("kn,kn->k", own, seen))

    def _inner(self, crossed: Sequence[Array]) -> Array:
        """Filtered columns along the orthonormal ones of the model, (noises, r, k), from products (noises, ., k)."""
        free = [own[:, rows] for own, rows in zip(crossed, self._free, strict=True)]
        out: Array = np.concatenate(free, axis=1)[:, self._some] / self._scale[:, None]
        for own, behind in zip(out, self.filtered, strict=True):
            own[:] = solved(behind.triangle, own)
        return out

    def _slopes(self, slopes: Array, inner: Array) -> Array:
        """Products (noises, k) of what is left of columns with the residual; `slopes` of the columns themselves."""
        return np.array([s - b.taken @ i for s, b, i in zip(slopes, self.filtered, inner, strict=True)])


def _part(block: Array, rows: Index, columns: Index) -> Array:
    """Some rows and columns of products (noises, k, l)."""
    if len(rows) < block.shape[1]:
        block = block[:, rows]
    return block if len(columns) == block.shape[2] else block[:, :, columns]


def _independent(whole: Array, rank: int) -> Index:
    """Numbers of so many columns of unit length that do not depend on each other, from their products.

    Raises
    ------
    DependentError
        There are more or fewer.
    """
    from scipy.linalg.lapack import dpstrf

    if rank == len(whole):
        return np.arange(rank)
    _, order, found, _ = dpstrf(whole, tol=ROUNDED, lower=True)
    if found != rank:
        raise DependentError
    return np.sort(order[:rank] - 1)


def _triangle(whole: Array) -> Array:
    """Cholesky factor of products of columns of unit length, in their place; those above the diagonal are not read.

    Raises
    ------
    DependentError
        A column depends on others.
    """
    from scipy.linalg.lapack import dpotrf

    upper, failed = dpotrf(whole.T, lower=False, clean=True, overwrite_a=True)
    if failed or np.diag(upper).min(initial=1.0) < APART:
        raise DependentError
    return np.asarray(upper.T)
