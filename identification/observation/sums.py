"""Sums of one pass over the rows of one view: products of the functions of M with each other and with residuals.

Blocks of rows go through NumPy, or strips of them through compiled loops; positions with one weight a row are summed in
the axes in which M has the fewest functions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial, reduce

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.kernel import KERNEL_BLOCK_ROWS, Kernel, compiled, in_all
from identification.observation.models import GapView, View
from identification.observation.stored_design import StoredDesign
from identification.runtime.parallel import parallel_map

Selector = tuple[Index, Array]
RANGE_ROWS = 1 << 17  # rows at most whose sums are taken one after the other, and then added to those of other ranges
HELD_BYTES, FEWEST_ROWS = 40_000_000, 512  # of the functions of a block; rows for which a call is worth it
SHORTEST_ROWS, RANGES = 1 << 14, 16  # a call for so many rows is worth it; so many calls keep many cores busy
TURNED_ROWS = 100_000  # rows from which other axes are worth the 0.03 s of their own kernel


@dataclass
class Sums:
    """``M'WM``, ``M'Wr``, ``r'Wr``, the number of scalar observations, and lengths of residuals if asked for."""

    gram: Array  # (p, p)
    slope: Array  # (p,)
    square: float = 0.0
    count: int = 0
    length: float = np.nan  # of the weighted residuals, summed over the rows
    longest: float = np.nan

    @classmethod
    def zero(cls, p: int) -> Sums:
        """Empty sums over `p` unknowns."""
        return cls(np.zeros((p, p)), np.zeros(p))

    def moved(self, base: Index, step: Array) -> Sums:
        """The sums after a small step of the `base` unknowns, by linear algebra without a pass over the rows."""
        along = self.gram[:, base] @ step
        square = self.square - 2 * float(step @ self.slope[base]) + float(step @ along[base])
        return replace(self, slope=self.slope - along, square=square)


@dataclass(frozen=True)
class Pass:
    """One pass over one view; `some`: columns whose products with all are wanted, where it is not those of all."""

    view: View
    columns: Index
    linear: Array | None
    p: Array
    at: Array | None
    gram: bool
    lengths: bool = False
    some: Index | None = None

    def run(self) -> Sums:
        """All sums: of ranges of rows, which are added up in their order.

        Compiled loops work on all cores; threads of short NumPy steps wait for the interpreter longer than they gain.
        """
        stored = self.view.known_design if self.at is None and self.view.whitener.ndim == 1 else None
        if stored is not None and not isinstance(self.view, GapView):
            return self.of_stored(stored)
        work, rows = self.work(), len(self.view)
        size = min(range_rows(rows), RANGE_ROWS) if work.compiled else rows_held(work.kernel)
        spans = [slice(k, k + size) for k in range(0, rows, size)] or [slice(0)]
        jobs = [partial(work.sums, span) for span in spans]
        parts = parallel_map(jobs) if work.compiled else (job() for job in jobs)
        return work.total(reduce(_Products.added, parts))

    def of_stored(self, design: StoredDesign) -> Sums:
        """All sums, with motions that are stored: in a block of rows, products of the columns that are not zero."""
        view, columns = self.view, self.columns
        weights, sums = view.whitener, Sums.zero(len(columns))
        left = np.hstack([gap for _, gap in view.gaps(self.p)])
        if self.linear is not None:
            left -= design.moved(columns, self.linear, view.outputs)
        left *= weights
        sums.slope, sums.square = design.along(columns, left * weights, view.outputs), float(np.vdot(left, left))
        for part, seen, block in design.blocks(view.outputs, columns) if self.gram else ():
            white = (block * weights[part, None]).reshape(-1, len(seen))
            if self.some is None:
                sums.gram[np.ix_(seen, seen)] += white.T @ white
            else:
                own = np.isin(seen, self.some)
                sums.gram[np.ix_(seen[own], seen)] += white[:, own].T @ white
        if self.lengths:
            lengths = np.sqrt(np.square(left).sum(axis=0))
            sums.length, sums.longest = float(lengths.sum()), float(lengths.max(initial=0.0))
        return sums

    def work(self) -> _Alike:
        """How the sums are taken."""
        view, columns = self.view, self.columns
        kept = isinstance(view, GapView) and self.linear is not None  # its gaps are overwritten, in their own axes
        if self.some is None and self.at is None and view.any_axes and not kept and in_all(len(view)) >= TURNED_ROWS:
            kernel, rows = view.in_other_axes(self.p)
            if self.few(kernel.n_functions - 3):
                return _Turned(self, kernel, selectors_of(kernel, 3, columns), rows)
        kernel = view.design(linearised=self.at is not None)
        alike = view.whitener.ndim == 1 and self.some is None and self.few(kernel.n_functions)
        kind = _Alike if alike else _Directed
        return kind(self, kernel, selectors_of(kernel, len(view.outputs), columns))

    def few(self, functions: int) -> bool:
        """Whether products of the functions are fewer than those of the columns."""
        return not self.gram or functions**2 < 2 * len(self.view.outputs) * len(self.columns) ** 2


@dataclass
class _Products:
    """Products of functions and residuals (the same, the same), summed over rows; sum and largest of their lengths.

    Without a Gram matrix their last columns, those with the residuals, may be all that there is.
    """

    sums: Array
    length: float = 0.0
    longest: float = 0.0

    def added(self, other: _Products) -> _Products:
        """Those of the rows of both, in the place of the first."""
        self.sums += other.sums  # of a thousand functions a new one takes as long as their products
        return _Products(self.sums, self.length + other.length, max(self.longest, other.longest))

    def add_lengths(self, left: Array) -> None:
        """Take in the lengths of residuals (components, m)."""
        squares = np.square(left)
        lengths = np.sqrt(sum(squares[1:], start=squares[0]))
        self.length += float(lengths.sum())
        self.longest = max(self.longest, float(lengths.max(initial=0.0)))


@dataclass(frozen=True)
class _Alike:
    """Sums for one weight per row: one Gram matrix of the distinct functions serves all components.

    Products are those of the functions and, below them, of the residual's components.
    """

    task: Pass
    kernel: Kernel
    selectors: list[Selector]

    @property
    def compiled(self) -> bool:
        """Whether the sums are taken by compiled loops."""
        return False

    @property
    def size(self) -> int:
        """Number of distinct functions of M."""
        return self.kernel.n_functions

    @cached_property
    def slopes(self) -> Array | None:
        """Slopes (components, functions) of what is taken from the gaps; an odd number of rows has one more, of zeros.

        OpenBLAS takes half as long for four rows as for three.
        """
        linear, n = self.task.linear, self.size
        if linear is None:
            return None
        own = [np.bincount(k, s * linear, n) for k, s in self.selectors]
        return np.array(own if len(own) == 1 or len(own) % 2 == 0 else [*own, np.zeros(n)])

    def blocks(self, span: slice) -> Iterator[tuple[slice, Array, Array]]:
        """Blocks of rows: slice in the view, distinct functions and residual."""
        task, view = self.task, self.task.view.part(span)
        design = self.kernel.blocks(view.rows, task.p if task.at is None else task.at)
        for (part, functions), (_, gap) in zip(design, view.gaps(task.p), strict=True):
            block, own = np.asarray(functions), slice(span.start + part.start, span.start + part.stop)
            if self.slopes is None:
                yield own, block, gap
            else:  # stored gaps are overwritten by the residual
                kept = gap if isinstance(view, GapView) else None
                yield own, block, np.subtract(gap, (self.slopes @ block)[: len(gap)], out=kept)

    @property
    def weight(self) -> float | None:
        """The weight of all rows, where it is one."""
        return self.task.view.weight

    def sums(self, span: slice) -> _Products:
        """Products of a range of rows; those of residuals in the last columns."""
        n, c, whitener = self.size, len(self.selectors), self.task.view.whitener
        out = _Products(np.zeros((n + c, n + c if self.task.gram else c)))
        for part, functions, gap in self.blocks(span):
            one = self.weight is not None
            white, left = (functions, gap) if one else (functions * whitener[part], gap * whitener[part])
            if self.task.gram:
                out.sums[:n, :n] += white @ white.T
            out.sums[:n, -c:] += white @ left.T
            out.sums[range(n, n + c), range(-c, 0)] += np.vecdot(left, left)
            if self.task.lengths:
                out.add_lengths(left)
        return out

    def total(self, products: _Products) -> Sums:
        """Sums over the columns, from the products."""
        n, c, task, own = self.size, len(self.selectors), self.task, products.sums
        level = 1.0 if self.weight is None else self.weight
        sums = Sums.zero(len(task.columns))
        for k, (place, factor) in enumerate(self.selectors):
            if task.gram:
                sums.gram += level**2 * np.outer(factor, factor) * own[np.ix_(place, place)]
            sums.slope += level**2 * factor * own[place, k - c]
            sums.square += level**2 * float(own[n + k, k - c])
        sums.length, sums.longest = level * products.length, level * products.longest
        return sums


@dataclass(frozen=True)
class _Turned(_Alike):
    """The same in the axes in which M has the fewest functions; the kernel's last three functions are the gap."""

    rows: Callable[[slice], list[Array]]

    @property
    def compiled(self) -> bool:
        return compiled(len(self.task.view))

    @cached_property
    def size(self) -> int:
        return self.kernel.n_functions - 3

    @cached_property
    def signs(self) -> Array:
        """Signs (3,) of the gap in the kernel."""
        return self.kernel.coefficient[-3:]

    @cached_property
    def slopes(self) -> Array | None:
        if self.task.linear is None:
            return None
        own = [np.bincount(k, s * self.task.linear, self.size) for k, s in self.selectors]
        return np.asarray(np.array([*own, np.zeros(self.size)]) * np.append(self.signs, 0.0)[:, None])  # four, as above

    @cached_property
    def tiles(self) -> tuple[Index, Index]:
        """Functions in the order of the components that have them, and the tiles with products that are wanted."""
        from errormodel.kernel_compiled import TILE

        n = self.size
        has = np.zeros((3, n + 3), dtype=bool)
        for k, (place, factor) in enumerate(self.selectors):
            has[k, place[factor != 0]] = True
            has[k, n + k] = True
        order = np.lexsort(has) if self.task.gram else np.arange(n + 3)
        order = np.append(order, np.repeat(order[-1:], -len(order) % TILE))
        near = has[:, order].reshape(3, -1, TILE).any(axis=2)
        wanted = np.tril(np.einsum("ci,cj->ij", near, near))
        if not self.task.gram:
            wanted[: n // TILE] = False
        return order, np.ascontiguousarray(np.argwhere(wanted))

    def sums(self, span: slice) -> _Products:
        n, weights = self.size, self.task.view.whitener[span]
        weights = np.zeros(0) if self.weight is not None else weights
        out = self._compiled(span, weights) if self.compiled else self._plain(span, weights)
        out.sums[:n, n:] *= self.signs
        return out

    def _compiled(self, span: slice, weights: Array) -> _Products:
        from errormodel.kernel_fused import fused

        slopes = np.zeros((3, 0)) if self.slopes is None else self.slopes[:3]
        order, tiles = self.tiles
        own, *lengths = fused(self.kernel).sums(
            self.rows(span), self.task.p, self.size, slopes, order, tiles, np.ascontiguousarray(weights),
            self.task.lengths,
        )  # fmt: skip
        out = _Products(np.zeros((self.size + 3, self.size + 3)), *lengths)
        order = order[: len(out.sums)]  # those that fill the last tile are not wanted
        out.sums[np.ix_(order, order)] = (np.tril(own) + np.tril(own, -1).T)[: len(order), : len(order)]
        return out

    def _plain(self, span: slice, weights: Array) -> _Products:
        n, spare = self.size, -self.kernel.n_functions % 4
        out = np.zeros((n + 3 + spare, n + 3 + spare))
        found = _Products(out[: n + 3, : n + 3])
        for part, block in self.kernel.blocks(self.rows(span), self.task.p, spare=spare):
            functions = np.asarray(block)
            left = functions[n : n + 3]
            if self.slopes is not None:
                left -= (self.slopes @ functions[:n])[:3]
            if len(weights):
                functions *= weights[part]
            if self.task.gram:
                out += functions @ functions.T
            else:
                out[:n, n:] += functions[:n] @ functions[n:].T
                out[range(n, n + 3), range(n, n + 3)] += np.vecdot(left, left)
            if self.task.lengths:
                found.add_lengths(left)
        return found


class _Directed(_Alike):
    """Sums for a covariance per row, or where columns share few functions: M is expanded and whitened.

    Products are those of the columns and, below them, of the residual.
    """

    def sums(self, span: slice) -> _Products:
        view, gram, columns = self.task.view, self.task.gram, len(self.task.columns)
        out = _Products(np.zeros((columns + 1, columns + 1)))
        for part, functions, gap in self.blocks(span):
            white = view.whiten(part, expanded(functions, self.selectors)).reshape(columns, gap.size)
            left = view.whiten(part, gap)
            flat = left.ravel()
            if gram and self.task.some is None:
                out.sums[:-1, :-1] += white @ white.T
            elif gram:
                out.sums[self.task.some, :-1] += white[self.task.some] @ white.T
            out.sums[:-1, -1] += white @ flat
            out.sums[-1, -1] += float(flat @ flat)
            if self.task.lengths:
                out.add_lengths(left)
        return out

    def total(self, products: _Products) -> Sums:
        own = products.sums
        square = float(own[-1, -1])
        return Sums(own[:-1, :-1], own[:-1, -1].copy(), square, 0, products.length, products.longest)


def rows_held(kernel: Kernel) -> int:
    """Rows of a range of steps in NumPy: fewer where a block would hold more than `HELD_BYTES` of functions."""
    held = HELD_BYTES // (8 * (kernel.n_functions + kernel.tape.registers))
    return RANGE_ROWS if held >= KERNEL_BLOCK_ROWS else max(FEWEST_ROWS, held)


def range_rows(rows: int) -> int:
    """Rows of a range of compiled loops: by the number of rows alone, so that results are the same on any cores."""
    return max(1, -(-rows // (RANGES * SHORTEST_ROWS))) * SHORTEST_ROWS


def selectors_of(kernel: Kernel, components: int, columns: Index) -> list[Selector]:
    """For each component c, the index and factor of the distinct function that makes each column of ``M_c``."""
    places = [columns * components + c for c in range(components)]
    return [
        (np.asarray(kernel.index[k], dtype=np.intp), np.asarray(kernel.coefficient[k], dtype=float)) for k in places
    ]


def expanded(functions: Array, selectors: list[Selector]) -> Array:
    """Columns of M (columns, components, m) from the distinct functions (functions, m)."""
    return np.array([factor[:, None] * functions[place] for place, factor in selectors]).transpose(1, 0, 2)
