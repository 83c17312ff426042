"""Blocks of proposals that have as many parameters, scored as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Columns, Index, Mask
from errormodel.effects.base import Effect
from identification.diagnosis.search.blocks import SINGLE, Block, Vectors, products


@dataclass(frozen=True)
class AlikeBlocks:
    """Proposals with the same number of parameters, all of them random effects or none.

    Attributes
    ----------
    numbers, gram, slope, square : of all blocks (`Block`), one after the other; `places`: where each of them is.
    """

    random: bool
    numbers: Index
    empirical: Mask
    gram: Array
    slope: Array
    square: Array
    places: dict[int, slice]

    @classmethod
    def of(cls, effects: Sequence[Effect], blocks: Sequence[Block], random: bool, some: Sequence[int]) -> AlikeBlocks:
        """Of some blocks."""
        own = [blocks[k] for k in some]
        ends = np.cumsum([0, *(len(b.numbers) for b in own)]).tolist()
        numbers, gram, slope, square = (
            np.concatenate([getattr(b, name) for b in own]) for name in ("numbers", "gram", "slope", "square")
        )
        places = {k: slice(*ends[n : n + 2]) for n, k in enumerate(some)}
        return cls(random, numbers, np.array([effects[n].empirical for n in numbers]), gram, slope, square, places)


def products_of(alike: Sequence[AlikeBlocks], blocks: Sequence[Block], vectors: Vectors) -> list[Columns]:
    """Products (m, k, r) of each list's columns with vectors (N, r): those of random effects in double precision."""
    place = {k: (n, rows) for n, own in enumerate(alike) for k, rows in own.places.items()}
    out = [np.empty((*own.slope.shape, vectors.count), float if own.random else SINGLE) for own in alike]
    for k, product in enumerate(products(blocks, vectors)):
        n, rows = place[k]
        out[n][rows] = product
    return out
