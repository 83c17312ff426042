"""M at zero errors and the exact kinematics of some rows, from how far each parameter moves its own element there.

These motions are stored by those that are not zero: of curves of splines a row has four of a hundred. M is their
products with the levers of the elements; the tool's pose is that of the elements moved by their sums. A fit asks for
both of the same rows again and again, where the expressions of many parameters take longer than all products.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from errormodel.arrays import Array, Index, Rows
from errormodel.chain import Chain
from errormodel.kernel import Kernel

MANY = 150  # columns from which what is stored is quicker than the expression (200 of an arm: twice as quick)
MOST_SHARE = 0.25  # of entries that are not zero: more take more memory than they save time
MADE_ROWS = 1024  # rows that are stored at a time: limits the memory
BLOCK_ROWS = 512  # rows that are expanded at a time: few curves are not zero in all of them


@dataclass(frozen=True)
class StoredDesign:
    """Motions of the elements of a chain, in some rows.

    Attributes
    ----------
    rows : the rows; of a view that has others, M is another one.
    fixed : channels that are equal in all of them.
    own : numbers of the columns' parameters in the chain.
    matrix : (n, entries) sparse, row by row: motion of an element per unit of a parameter, mm or rad.
    column, motion : (entries,) rising number of the column, and the number among `motions`.
    motions : (g,) six times the number of the element, and the number of its motion.
    levers : (g, 6, n) displacement and rotation of the tool by each of these motions, in the reference's axes.
    """

    chain: Chain
    rows: list[Array]
    fixed: Mapping[str, float]
    own: Index
    matrix: Any
    column: Index
    motion: Index
    motions: Index
    levers: Array

    @classmethod
    def of(
        cls, chain: Chain, ids: tuple[str, ...], rows: list[Array], fixed: Mapping[str, float]
    ) -> StoredDesign | None:
        """The motions by some parameters; None where too many entries are not zero."""
        from scipy.sparse import csr_array, vstack

        kernel, zero = chain.kernel("terms", ids, fixed), np.zeros(len(chain.ids))
        entries = np.flatnonzero(kernel.coefficient[: 6 * len(ids)])
        place, factor, column = kernel.index[entries], kernel.coefficient[entries], entries // 6
        made = list[Any]()
        for start in range(0, len(rows[0]), MADE_ROWS):
            functions = kernel.functions([c[start : start + MADE_ROWS] for c in rows], zero)
            made.append(csr_array((factor[:, None] * functions[place]).T))
            if made[-1].nnz > MOST_SHARE * functions.shape[1] * len(ids):
                return None
        if not made:
            return None
        elements = np.array([chain.term(name)[0] for name in ids])
        motions, motion = np.unique(6 * elements[column] + entries % 6, return_inverse=True)
        levers = chain.kernel("levers", (), fixed)(rows, zero).reshape(-1, 6, len(rows[0]))[motions]
        own = np.array([chain.index[name] for name in ids])
        return cls(chain, rows, fixed, own, vstack(made, format="csr"), column, motion, motions, levers)

    def __len__(self) -> int:
        return int(self.matrix.shape[0])

    def of_view(self, chain: Chain, ids: tuple[str, ...], rows: list[Array]) -> StoredDesign | None:
        """The same for a view that has these rows and parameters as well; None where others."""
        alike = chain is self.chain and tuple(chain.ids[k] for k in self.own) == ids
        if not alike or not all(map(np.array_equal, rows, self.rows)):
            return None
        return replace(self, rows=rows)

    def part(self, some: Rows, rows: list[Array]) -> StoredDesign:
        """That of a part, which are these `rows`."""
        return replace(self, rows=rows, matrix=self.matrix[some], levers=self.levers[..., some])

    def blocks(self, outputs: Sequence[int], columns: Index) -> Iterator[tuple[slice, Index, Array]]:
        """Blocks of rows: slice, which of some columns of M are not zero in it, and these (outputs, m, .)."""
        place = np.full(len(self.own), -1)
        place[columns] = np.arange(len(columns))
        for start in range(0, len(self), BLOCK_ROWS):
            part = slice(start, min(start + BLOCK_ROWS, len(self)))
            block = self.matrix[part]
            entries = np.unique(block.indices)
            entries = entries[place[self.column[entries]] >= 0]
            seen, first = np.unique(self.column[entries], return_index=True)
            dense, motion = block[:, entries].toarray(), self.motion[entries]
            out = np.empty((len(outputs), len(dense), len(seen)))
            for own, k in zip(out, outputs, strict=True):
                moved = dense * self.levers[:, k, part].T[:, motion]
                own[:] = moved if len(seen) == len(entries) else np.add.reduceat(moved, first, axis=1)
            yield part, place[seen], out

    def along(self, columns: Index, vectors: Array, outputs: Sequence[int]) -> Array:
        """Products (columns,) of some columns of M with a vector (outputs, n)."""
        pulls = np.einsum("gon,on->ng", self.levers[:, outputs], vectors)
        rows, entries = self._places()
        products = np.bincount(entries, self.matrix.data * pulls[rows, self.motion[entries]], len(self.column))
        return np.asarray(np.bincount(self.column, products, len(self.own))[columns])

    def moved(self, columns: Index, values: Array, outputs: Sequence[int]) -> Array:
        """The product (outputs, n) of some columns of M with their values."""
        every = np.zeros(len(self.own))
        every[columns] = values
        return np.asarray(np.einsum("gon,gn->on", self.levers[:, outputs], self._motions(every)))

    def pose(self, p: Array, outputs: tuple[int, ...]) -> Iterator[tuple[slice, Array]] | None:
        """Outputs of the exact pose at the chain's parameters, block by block; None where others than these are set."""
        others = p.copy()
        others[self.own] = 0.0
        if others.any():
            return None
        kernel = moved_kernel(self.chain, tuple(self.motions.tolist()), tuple(sorted(self.fixed.items())), outputs)
        rows = [*self.rows, *self._motions(p[self.own])]
        return ((part, kernel.expand(functions)) for part, functions in kernel.blocks(rows))

    def _motions(self, values: Array) -> Array:
        """The motions (g, n) of the elements by values (columns,) of the parameters."""
        rows, entries = self._places()
        places = self.motion[entries] * len(self) + rows
        made = np.bincount(places, self.matrix.data * values[self.column[entries]], len(self.motions) * len(self))
        return np.asarray(made.reshape(len(self.motions), -1))

    def _places(self) -> tuple[Index, Index]:
        """Row and column in the matrix of what is stored."""
        return np.repeat(np.arange(len(self)), np.diff(self.matrix.indptr)), self.matrix.indices


@lru_cache(maxsize=8)
def moved_kernel(
    chain: Chain, motions: tuple[int, ...], fixed: tuple[tuple[str, float], ...], outputs: tuple[int, ...]
) -> Kernel:
    """Kernel of the exact pose by the channels and, behind them, some motions of the elements.

    Parameters
    ----------
    motions : as `StoredDesign.motions`; all others are zero.
    outputs : rows of the pose as ``actual`` has it.
    """
    symbols, own = ca.SX.sym("m", len(motions)), ca.SX.zeros(6 * len(chain.element_names))
    for k, place in enumerate(motions):
        own[place] = symbols[k]
    point, turn = chain.pose([own[k : k + 6] for k in range(0, own.numel(), 6)])
    expression = ca.vertcat(point, ca.vec(turn))[list(outputs), :]
    return chain.folded(expression, ca.vertcat(chain.rows, symbols), fixed)
