"""The rows of a survey behind the observations of a linear model.

A channel has one value a row, and an effect's motion too; the row's coordinates differ by their levers only. What is
the same for all of them is computed once, and products with columns of one lever are sums over rows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Columns, Index


@dataclass(frozen=True, eq=False)
class SurveyRows:
    """Rows with observations.

    Attributes
    ----------
    number : (N,) number, from 0, of each observation's row.
    table : channel -> (rows,) its values.
    slots : (most, rows) the observations of each row; N where a row has fewer.
    """

    number: Index
    table: Mapping[str, Array]
    slots: Index

    @classmethod
    def of(cls, number: Index, table: Mapping[str, Array]) -> SurveyRows:
        """From the number of each observation's row."""
        counts = np.bincount(number)
        order = np.argsort(number, kind="stable")
        within = np.arange(len(number)) - np.repeat(np.cumsum(counts) - counts, counts)
        slots = np.full((counts.max(initial=0), len(counts)), len(number))
        slots[within, number[order]] = order
        return cls(number, table, slots)

    def gathered(self, vectors: Columns) -> Columns:
        """Vectors (N, r) as (most, rows, r): each row's observations, zero where it has fewer."""
        size = len(self.number)
        out = vectors[np.minimum(self.slots, size - 1)]
        out[self.slots == size] = 0.0
        return np.asarray(out)

    def summed(self, lever: Array, gathered: Columns) -> Columns:
        """Sums (rows, r) over the observations of each row of a lever (N,) times vectors as they are `gathered`."""
        weight = np.append(lever, 0.0).astype(gathered.dtype)[self.slots]
        total = weight[0, :, None] * gathered[0]
        product = np.empty_like(total)
        for own, vectors in zip(weight[1:], gathered[1:], strict=True):
            total += np.multiply(own[:, None], vectors, out=product)
        return np.asarray(total)
