"""Products of all proposals with the columns of effects that were fitted, of which those with a model's basis follow.

A search asks for the basis of model after model, with and without this finding or that. All of these span columns of
the few effects that were ever fitted. Proposals' products with these are made once; a triangular system turns them into
those with an orthonormal basis, in fewer operations than the products with that basis where rows are many.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Columns
from errormodel.effects.base import Effect
from identification.diagnosis.linear.known_models import Latest, Lineage, of_any_size
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search.alike_blocks import AlikeBlocks, products_of
from identification.diagnosis.search.blocks import COLUMNS, SINGLE, Block, Vectors
from identification.estimation.orthonormal_basis import LEFT

# of a column's length, left by those before it: below, products in single precision do not tell what is left of others
APART = 1e-3


@dataclass(frozen=True, eq=False)
class KnownEffect:
    """What the geometry leaves of an effect's columns, and products of proposals with it.

    Attributes
    ----------
    left : (k, N) of unit length; of random effects zero where the geometry spans a column, others have none then.
    lengths : (k,) that they had.
    products : (m, w, k) of the columns of blocks that are alike with them.
    """

    left: Array
    lengths: Array
    products: tuple[Columns, ...]

    @property
    def nbytes(self) -> int:
        """Bytes that it takes up."""
        return self.left.nbytes + sum(own.nbytes for own in self.products)


@dataclass(frozen=True, eq=False)
class KnownProducts:
    """Products of blocks with a model.

    Attributes
    ----------
    effects : the model's, and products with their columns.
    triangle : Cholesky factor of the products of these columns, which makes them orthonormal.
    slopes : (m, k) of each list of blocks that are alike, with the residual.
    """

    effects: Sequence[KnownEffect]
    triangle: Array
    slopes: Sequence[Array]

    def with_basis(self, number: int) -> Iterator[tuple[slice, Columns]]:
        """Products (m, k, r) of some of a list of blocks with the model's basis beyond the geometry.

        The basis is another one of the same span.
        """
        from scipy.linalg.blas import dtrsm, strsm

        parts = [own.products[number] for own in self.effects]
        count, width, _ = parts[0].shape
        solve = strsm if parts[0].dtype == SINGLE else dtrsm
        triangle, most = self.triangle.astype(parts[0].dtype, order="F"), max(COLUMNS // width, 1)
        for first in range(0, count, most):
            rows = slice(first, first + most)
            own = np.concatenate([part[rows] for part in parts], axis=2)
            solved = solve(1.0, triangle, own.reshape(-1, len(triangle)).T, lower=1, overwrite_b=1)
            yield rows, solved.T.reshape(own.shape)


def known_products(
    kept: Latest, alike: Sequence[AlikeBlocks], blocks: Sequence[Block], linear: LinearModel
) -> KnownProducts | None:
    """Those with a model's effects; None where these are too alike.

    Parameters
    ----------
    kept : of effects that were asked for before; those that are new are kept as well.
    """
    from scipy.linalg.lapack import dpotrf

    assert linear.lineage is not None
    rank, (size, _) = blocks[0].rank, linear.plain or linear.basis.shape
    effects = linear.lineage.effects
    known: dict[Effect, KnownEffect] = {e: own for e in effects if (own := kept.find(of_any_size(e))) is not None}
    left = {e: _without_geometry(linear, e, size, rank) for e in effects if e not in known}
    vectors = Vectors(np.vstack([linear.residual[:size], *(columns for columns, _ in left.values())]).T)
    made, first = products_of(alike, blocks, vectors), 1
    for effect, (columns, lengths) in left.items():
        own = slice(first, first := first + len(columns))
        known[effect] = KnownEffect(columns, lengths, tuple(p[..., own].copy() for p in made))
        kept.keep(of_any_size(effect), known[effect], known[effect].nbytes)
    parts = [known[e] for e in effects]
    columns = np.vstack([part.left for part in parts])
    if len(columns) != linear.basis.shape[1] - rank:
        return None
    ties = [h / p.lengths if len(h) else np.zeros(len(p.left)) for h, p in zip(linear.holds, parts, strict=True)]
    triangle, failed = dpotrf(columns @ columns.T + np.diag(np.concatenate(ties) ** 2), lower=True)
    if failed or np.diag(triangle).min() < APART:
        return None
    return KnownProducts(parts, triangle, [own[..., 0].astype(float) for own in made])


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


def _without_geometry(linear: LinearModel, effect: Effect, size: int, rank: int) -> tuple[Array, Array]:
    """What the geometry leaves of an effect's columns (k, size), of unit length, and the lengths (k,) that they had."""
    columns, basis = linear.columns(effect)[0][:, :size], linear.basis[:size, :rank]
    left = columns
    for _ in range(2):
        left = left - (left @ basis) @ basis.T
    lengths = np.linalg.norm(left, axis=1)
    seen = lengths > LEFT * np.linalg.norm(columns, axis=1)
    left[~seen], lengths[~seen] = 0.0, 1.0
    left /= lengths[:, None]
    return (left, lengths) if effect.random else (left[seen], lengths[seen])
