"""M at zero errors, stored by its entries that are not zero: of curves of splines a row has four of a hundred.

A fit asks for M of the same rows again: in each step, in blocks that are left out, for leverages. Of many columns the
expression takes longer than all products with what is stored.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from errormodel.arrays import Array, Index, Rows
from errormodel.kernel import Kernel

MANY = 150  # columns from which what is stored is quicker than the expression (200 of an arm: twice as quick)
MOST_SHARE = 0.25  # of entries that are not zero: more take more memory than they save time
BLOCK_ROWS = 512  # rows that are stored, or expanded, at a time: limits the memory


@dataclass(frozen=True)
class StoredDesign:
    """M of some rows.

    Attributes
    ----------
    rows : the rows; of a view that has others, M is another one.
    matrix : (n * outputs, columns) sparse, row by row; not whitened, in the axes of the machine's reference.
    outputs : number of a row's components.
    """

    rows: list[Array]
    matrix: Any
    outputs: int

    @classmethod
    def of(cls, kernel: Kernel, rows: list[Array], at_zero: Array, outputs: int) -> StoredDesign | None:
        """M by its kernel; None where too many entries are not zero."""
        from scipy.sparse import csr_array, vstack

        made = list[Any]()
        for start in range(0, len(rows[0]), BLOCK_ROWS):
            full = _rows_of(kernel, [c[start : start + BLOCK_ROWS] for c in rows], at_zero, outputs)
            made.append(csr_array(full))
            if made[-1].nnz > MOST_SHARE * full.size:
                return None
        return cls(rows, vstack(made, format="csr"), outputs) if made else None

    def __len__(self) -> int:
        return int(self.matrix.shape[0]) // self.outputs

    def part(self, some: Rows, rows: list[Array]) -> StoredDesign:
        """That of a part, which are these `rows`."""
        if isinstance(some, slice):
            first, end, step = some.indices(len(self))
            if step == 1:
                return replace(self, rows=rows, matrix=self.matrix[first * self.outputs : end * self.outputs])
        index = np.arange(len(self))[some]
        places = (index[:, None] * self.outputs + np.arange(self.outputs)).ravel()
        return replace(self, rows=rows, matrix=self.matrix[places])

    def blocks(self, columns: Index, weights: Array) -> Iterator[Array]:
        """Blocks (m, columns) of some columns of M, each row times its weight."""
        for start in range(0, self.matrix.shape[0], BLOCK_ROWS * self.outputs):
            part = slice(start, start + BLOCK_ROWS * self.outputs)
            dense = self.matrix[part].toarray()
            dense *= weights[part, None]
            yield dense if len(columns) == dense.shape[1] else dense[:, columns]

    def write(self, columns: Index, out: Array, places: Sequence[int]) -> None:
        """Write some columns of M into places of (outputs, n, unknowns)."""
        for start in range(0, len(self), BLOCK_ROWS):
            part = slice(start, min(start + BLOCK_ROWS, len(self)))
            dense = self.matrix[part.start * self.outputs : part.stop * self.outputs].toarray()
            out[:, part, places] = (
                dense[:, columns].reshape(part.stop - part.start, self.outputs, -1).transpose(1, 0, 2)
            )


def _rows_of(kernel: Kernel, rows: list[Array], at_zero: Array, outputs: int) -> Array:
    """M (n * outputs, columns) of some rows, dense."""
    functions = kernel.functions(rows, at_zero)
    index, factor = kernel.index.reshape(-1, outputs), kernel.coefficient.reshape(-1, outputs)
    out = np.zeros((len(rows[0]), outputs, len(index)))
    for c in range(outputs):
        out[:, c] = (factor[:, c, None] * functions[index[:, c]]).T
    return out.reshape(-1, len(index))
