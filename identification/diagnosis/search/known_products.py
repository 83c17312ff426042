"""Products of all proposals with a basis of the directions that were asked for, of which others are combinations.

A search asks for the residual and the basis of model after model, with and without this finding or that. All of these
are combinations of the few columns that were ever fitted, so that a proposal's products with them are, too: hundreds of
numbers are combined where there are thousands of observations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from errormodel.arrays import Array, Columns
from errormodel.effects.base import Effect
from identification.diagnosis.linear.known_models import Latest, Lineage
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.linear.orthonormal_basis import APART, LEFT
from identification.diagnosis.search.alike_blocks import AlikeBlocks, products_of
from identification.diagnosis.search.blocks import SINGLE, Block, Vectors

BEYOND = 1e-9  # of vectors of unit length: less is left by rounding
PART = 256  # directions of a part: a copy of few is no work, and the products of many are as quick as those of all
MOST_SHARE = 0.25  # of the observations: with more directions the products themselves are as quick


@dataclass(frozen=True, eq=False)
class KnownProducts:
    """The directions whose products with some blocks are known.

    Attributes
    ----------
    directions : (N, q) orthonormal.
    products : (m, k, .) of the columns of blocks that are alike with them: one product for all of these is quicker. In
        parts along the directions, which searches that go on from here share.
    effects : of those that were fitted, what the geometry leaves of their columns (k, .) along the directions.
    """

    directions: Array
    products: tuple[tuple[Columns, ...], ...]
    effects: Mapping[Effect, Array] = field(default_factory=dict)

    @classmethod
    def of(cls, alike: Sequence[AlikeBlocks], size: int) -> KnownProducts:
        """None yet, for vectors with so many observations."""
        return cls(np.empty((size, 0)), tuple((np.empty((*own.slope.shape, 0), SINGLE),) for own in alike))

    def of_model(
        self, alike: Sequence[AlikeBlocks], blocks: Sequence[Block], linear: LinearModel
    ) -> tuple[KnownProducts, Array, Array]:
        """The directions of a linear model as well; along them its basis (q, r) beyond the geometry, and its residual.

        The basis is another one of the same span.
        """
        rank, (size, _) = blocks[0].rank, linear.plain or linear.basis.shape
        residual = linear.residual[:size]
        beyond = linear.basis[:size, rank:]
        effects = linear.lineage.effects if linear.lineage is not None else ()
        new = [e for e in effects if e not in self.effects]
        wanted = [residual[:, None]]
        left = {e: _without_geometry(linear, e, size, rank) for e in new}
        wanted += [own.T for own in left.values()] if linear.lineage is not None else [beyond]
        known = self._with(alike, blocks, np.hstack(wanted))
        if known.directions.shape[1] > max(MOST_SHARE * size, 2 * linear.basis.shape[1]) and self.effects:
            return self.of(alike, size).of_model(alike, blocks, linear)
        along = {e: own @ known.directions for e, own in left.items()}
        known = KnownProducts(known.directions, known.products, {**self.effects, **along})
        basis = known._basis(linear, rank) if linear.lineage is not None else None
        if basis is None:
            basis = known.directions.T @ beyond
        return known, basis, known.directions.T @ residual

    def _with(self, alike: Sequence[AlikeBlocks], blocks: Sequence[Block], vectors: Array) -> KnownProducts:
        """With what some vectors (N, r) of any length have beyond the directions."""
        lengths = np.linalg.norm(vectors, axis=0)
        left = self._beyond(self._beyond(vectors[:, lengths > 0] / lengths[lengths > 0]))
        along, sizes, _ = np.linalg.svd(left, full_matrices=False)
        if not (sizes > BEYOND).any():
            return self
        new = np.linalg.qr(self._beyond(along[:, sizes > BEYOND]))[0]  # what was little is to be orthogonal, too
        made = products_of(alike, blocks, Vectors(new), SINGLE)
        joined = tuple(_with_part(parts, part) for parts, part in zip(self.products, made, strict=True))
        return KnownProducts(np.hstack([self.directions, new]), joined, self.effects)

    def _beyond(self, vectors: Array) -> Array:
        return np.asarray(vectors - self.directions @ (self.directions.T @ vectors))

    def _basis(self, linear: LinearModel, rank: int) -> Array | None:
        """The basis of a model's effects along the directions; None where these are too alike for their products."""
        from scipy.linalg.blas import dtrsm
        from scipy.linalg.lapack import dpotrf

        assert linear.lineage is not None
        count, places = self.directions.shape[1], list[Array]()
        for own in (self.effects[effect] for effect in linear.lineage.effects):
            place = np.zeros((len(own), count))
            place[:, : own.shape[1]] = own
            places.append(place)
        columns = np.vstack(places)
        holds = np.concatenate([h if len(h) else np.zeros(len(p)) for h, p in zip(linear.holds, places, strict=True)])
        lengths = np.hypot(np.linalg.norm(columns, axis=1), holds)
        kept = lengths > 0
        if kept.sum() != linear.basis.shape[1] - rank:
            return None
        columns, holds = columns[kept] / lengths[kept, None], holds[kept] / lengths[kept]
        triangle, failed = dpotrf(columns @ columns.T + np.diag(holds**2), lower=True)
        if failed or np.diag(triangle).min(initial=1.0) < APART:
            return None
        return np.asarray(dtrsm(1.0, triangle, columns.T, side=1, lower=1, trans_a=1))


def combined(parts: Sequence[Columns], rows: slice, weights: Columns) -> Columns:
    """The products (m, k, r) of some `rows` of blocks with combinations (q, r) of the directions."""
    count, width, _ = parts[0][rows].shape
    total: Columns = np.zeros((count, width, weights.shape[1]), SINGLE)
    first = 0
    for part in parts:
        own = part.shape[2]
        made = part[rows].reshape(count * width, own) @ weights[first : first + own]
        total += made.reshape(total.shape)
        first += own
    return total


def _with_part(parts: tuple[Columns, ...], more: Columns) -> tuple[Columns, ...]:
    """The parts and one more, joined to the last one as long as that is small."""
    *others, last = parts
    if last.shape[2] and last.shape[2] + more.shape[2] > PART:
        return (*parts, more)
    return (*others, np.concatenate([last, more], axis=2))


def begun_with(kept: Latest, lineage: Lineage | None) -> tuple[list[Array], int] | None:
    """What is kept of the longest model whose effects this one begins with: products, and a number of columns.

    Products of projected columns with each other; columns of that model's basis beyond the geometry.
    """
    if lineage is None:
        return None
    begun = (kept.find(lineage.effects[:count]) for count in range(len(lineage.effects), 0, -1))
    return next((found for found in begun if found is not None), None)


def keep_begun(kept: Latest, lineage: Lineage | None, grams: list[Array], columns: int) -> None:
    """Keep these for models that begin with the same effects: only what later ones take is to be computed then."""
    if lineage is not None:
        kept.keep(lineage.effects, (grams, columns), sum(g.nbytes for g in grams))


def _without_geometry(linear: LinearModel, effect: Effect, size: int, rank: int) -> Array:
    """What the geometry leaves of an effect's columns (k, size); nothing of those that it spans."""
    columns, basis = linear.columns(effect)[0][:, :size], linear.basis[:size, :rank]
    left = columns
    for _ in range(2):
        left = left - (left @ basis) @ basis.T
    spanned = np.linalg.norm(left, axis=1) <= LEFT * np.linalg.norm(columns, axis=1)
    left[spanned] = 0.0
    return left
