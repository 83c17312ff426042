"""Normal equations of weighted least squares, accumulated block by block over the rows of the views.

M is the design matrix, W the inverse covariance of the observations, r the residual; units mm and rad, whitened.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.kernel import Kernel, compiled
from identification.observation.models import GapView, Kind, View, anywhere

Selector = tuple[Index, Array]
FULL_POSES = 200  # random poses that stand for the full travels
RANK_SAMPLE_ROWS = 400  # rows of a view on which the rank is decided first, before all are checked: saves time


@dataclass
class Sums:
    """``M'WM``, ``M'Wr``, ``r'Wr`` and the number of scalar observations."""

    gram: Array  # (p, p)
    slope: Array  # (p,)
    square: float = 0.0
    count: int = 0

    @classmethod
    def zero(cls, p: int) -> Sums:
        """Empty sums over `p` unknowns."""
        return cls(np.zeros((p, p)), np.zeros(p))

    def moved(self, base: Index, step: Array) -> Sums:
        """The sums after a small step of the `base` unknowns, by linear algebra without a pass over the rows."""
        along = self.gram[:, base] @ step
        square = self.square - 2 * float(step @ self.slope[base]) + float(step @ along[base])
        return Sums(self.gram, self.slope - along, square, self.count)


def accumulate(
    views: Sequence[View],
    unknowns: Mapping[str, int],
    values: Array,
    held: Array,
    *,
    exact: bool = True,
    at: Array | None = None,
    gram: bool = True,
    taken: Array | None = None,
) -> dict[Kind, Sums]:
    """Normal equations of each kind of observation.

    Parameters
    ----------
    unknowns : index of each unknown; columns of a view that are not named are held fixed.
    values : (unknowns,)
        Point at which the residual is evaluated, mm and rad.
    held : (chain parameters,)
        Values of the parameters that are not unknown.
    exact : bool
        Residual of the exact kinematics, or of the linear model ``gap(held) - M values``.
    at : (unknowns,)
        Point at which M is evaluated; None: at zero errors, which is cheaper and nearly always accurate enough.
    gram : bool
        False leaves ``M'WM`` out (it does not change while M does not).
    taken : (unknowns,)
        Values whose contribution the gaps of `GapView`s no longer contain; afterwards these are `values`.
    """
    sums: dict[Kind, Sums] = {}
    for view in views:
        local = np.array([k for k, c in enumerate(view.columns) if c in unknowns], dtype=np.intp)
        places = np.array([unknowns[view.columns[k]] for k in local], dtype=np.intp)
        fresh = values if taken is None or not isinstance(view, GapView) else values - taken
        linear = fresh[places] * (np.array([exact and k < view.exact_columns for k in local]) == 0)
        p = view.vector(unknowns if exact else {}, values, held)
        here = None if at is None else view_vector(view, unknowns, at, held)
        own = _Task(view, local, linear if linear.any() else None, p, here, gram).run()
        whole = sums.setdefault(view.kind, Sums.zero(len(unknowns)))
        whole.gram[np.ix_(places, places)] += own.gram
        whole.slope[places] += own.slope
        whole.square += own.square
        whole.count += view.count
    return sums


def total(sums: Mapping[Kind, Sums], sigma: Mapping[Kind, float]) -> tuple[Array, Array]:
    """``M'WM`` and ``M'Wr`` summed over all kinds, each divided by the square of its noise level `sigma`."""
    parts = [(s, 1 / sigma[kind] ** 2) for kind, s in sums.items()]
    size = len(parts[0][0].slope)
    gram, slope = np.zeros((size, size)), np.zeros(size)
    for own, weight in parts:
        gram += weight * own.gram
        slope += weight * own.slope
    return gram, slope


def view_vector(view: View, unknowns: Mapping[str, int], values: Array, held: Array) -> Array:
    """Scalars of a view's kernels: held values, replaced by `values` where a column is unknown."""
    return view.vector(unknowns, values, held)


@dataclass(frozen=True)
class _Task:
    """One pass over one view."""

    view: View
    columns: Index
    linear: Array | None
    p: Array
    at: Array | None
    gram: bool

    def run(self) -> Sums:
        """All sums, on one core: threads of short NumPy steps wait for the interpreter longer than they gain."""
        kernel = self.view.design(linearised=self.at is not None)
        selectors = selectors_of(kernel, len(self.view.outputs), self.columns)
        components, columns = len(selectors), len(self.columns)
        few = not self.gram or kernel.n_functions**2 < 2 * components * columns**2
        kind = _Alike if self.view.whitener.ndim == 1 and few else _Directed
        work = kind(self, kernel, selectors, compiled(len(self.view)))
        return work.total(work.sums())


@dataclass(frozen=True)
class _Alike:
    """Sums for one weight per row: one Gram matrix of the distinct functions serves all components.

    Products are those of the functions and, below them, of the residual's components.
    """

    task: _Task
    kernel: Kernel
    selectors: list[Selector]
    loops: ModuleType | None

    @cached_property
    def slopes(self) -> Array | None:
        """Slopes (components, functions) of what is taken from the gaps; an odd number of rows has one more, of zeros.

        OpenBLAS takes half as long for four rows as for three.
        """
        linear, n = self.task.linear, self.kernel.n_functions
        if linear is None:
            return None
        own = [np.bincount(k, s * linear, n) for k, s in self.selectors]
        return np.array(own if len(own) == 1 or len(own) % 2 == 0 else [*own, np.zeros(n)])

    def blocks(self) -> Iterator[tuple[slice, Array, Array]]:
        """Blocks of rows: slice in the view, distinct functions and residual."""
        task, view = self.task, self.task.view
        design = self.kernel.blocks(view.rows, task.p if task.at is None else task.at, loops=self.loops)
        for (part, functions), (_, gap) in zip(design, view.gaps(task.p), strict=True):
            block = np.asarray(functions)
            if self.slopes is None:
                yield part, block, gap
            else:  # stored gaps are overwritten by the residual
                kept = gap if isinstance(view, GapView) else None
                yield part, block, np.subtract(gap, (self.slopes @ block)[: len(gap)], out=kept)

    @cached_property
    def weight(self) -> float | None:
        """The weight of all rows, where it is one."""
        whitener = self.task.view.whitener
        return float(whitener[0]) if len(whitener) and bool((whitener == whitener[0]).all()) else None

    @cached_property
    def tiles(self) -> tuple[Index, Index]:
        """Rows in the order of the components that have them, and the tiles with products that sums are made of."""
        assert self.loops is not None
        n, size = self.kernel.n_functions, self.loops.TILE
        has = np.zeros((len(self.selectors), n + len(self.selectors)), dtype=bool)
        for k, (place, factor) in enumerate(self.selectors):
            has[k, place[factor != 0]] = True
            has[k, n + k] = True
        order = np.lexsort(has)
        order = np.append(order, np.repeat(order[-1:], -len(order) % size))
        near = has[:, order].reshape(len(has), -1, size).any(axis=2)
        wanted = np.tril(np.einsum("ci,cj->ij", near, near))
        return order, np.argwhere(wanted)

    def sums(self) -> Array:
        """Products (functions and residuals, the same) of all rows; those of residuals in the last columns."""
        n, c, whitener = self.kernel.n_functions, len(self.selectors), self.task.view.whitener
        out = np.zeros((n + c, n + c))
        order, tiles = self.tiles if self.loops is not None and self.task.gram else (np.zeros(0, np.intp), None)
        tiled = np.zeros((len(order), len(order)))
        for part, functions, gap in self.blocks():
            one = self.weight is not None
            white, left = (functions, gap) if one else (functions * whitener[part], gap * whitener[part])
            if self.loops is not None and tiles is not None:
                self.loops.products(white, np.ascontiguousarray(left), order, tiles, tiled)
                continue
            if self.task.gram:
                out[:n, :n] += white @ white.T
            out[:n, n:] += white @ left.T
            out[range(n, n + c), range(n, n + c)] += np.vecdot(left, left)
        if tiles is not None:  # rows that fill the last tile are not wanted
            own = order[: n + c]
            out[np.ix_(own, own)] = (np.tril(tiled) + np.tril(tiled, -1).T)[: n + c, : n + c]
        return out

    def total(self, products: Array) -> Sums:
        """Sums over the columns, from the products."""
        n, task = self.kernel.n_functions, self.task
        weight = 1.0 if self.weight is None else self.weight**2
        sums = Sums.zero(len(task.columns))
        for k, (place, factor) in enumerate(self.selectors):
            if task.gram:
                sums.gram += weight * np.outer(factor, factor) * products[np.ix_(place, place)]
            sums.slope += weight * factor * products[place, n + k]
            sums.square += weight * float(products[n + k, n + k])
        return sums


class _Directed(_Alike):
    """Sums for a covariance per row, or where columns share few functions: M is expanded and whitened.

    Products are those of the columns and, below them, of the residual.
    """

    def sums(self) -> Array:
        view, gram, columns = self.task.view, self.task.gram, len(self.task.columns)
        out = np.zeros((columns + 1, columns + 1))
        for part, functions, gap in self.blocks():
            white = view.whiten(part, _expanded(functions, self.selectors)).reshape(columns, gap.size)
            flat = view.whiten(part, gap).ravel()
            if gram:
                out[:-1, :-1] += white @ white.T
            out[:-1, -1] += white @ flat
            out[-1, -1] += float(flat @ flat)
        return out

    def total(self, products: Array) -> Sums:
        return Sums(products[:-1, :-1], products[:-1, -1].copy(), float(products[-1, -1]))


def selectors_of(kernel: Kernel, components: int, columns: Index) -> list[Selector]:
    """For each component c, the index and factor of the distinct function that makes each column of ``M_c``."""
    places = [columns * components + c for c in range(components)]
    return [
        (np.asarray(kernel.index[k], dtype=np.intp), np.asarray(kernel.coefficient[k], dtype=float)) for k in places
    ]


def _expanded(functions: Array, selectors: list[Selector]) -> Array:
    """Columns of M (columns, components, m) from the distinct functions (functions, m)."""
    return np.array([factor[:, None] * functions[place] for place, factor in selectors]).transpose(1, 0, 2)


def sampled(view: View, most: int) -> View:
    """At most `most` of a view's rows, evenly spread."""
    return view if len(view) <= most else view.part(np.unique(np.linspace(0, len(view) - 1, most).astype(int)))


def full_norms(view: View, unknowns: Mapping[str, int]) -> Array:
    """Norms (unknowns,) of the view's columns for poses over the full travels and the longest lever."""
    lengths = anywhere(view, FULL_POSES).norms() * np.sqrt(weight_of(view))
    out = np.zeros(len(unknowns))
    for column, length in zip(view.columns, lengths, strict=True):
        if column in unknowns:
            out[unknowns[column]] = length
    return out


def weight_of(view: View) -> float:
    """Sum over a view's rows of the largest squared weight of their components."""
    square = np.square(view.whitener)
    return float((square if square.ndim == 1 else square.reshape(len(view), -1).max(axis=1)).sum())


def design_rows(view: View, unknowns: Mapping[str, int], most: int = RANK_SAMPLE_ROWS) -> Array:
    """Whitened rows of M, dense, of at most `most` of the view's rows, evenly spread: (rows * components, unknowns)."""
    view = sampled(view, most)
    kernel = view.design(linearised=False)
    local = np.array([k for k, c in enumerate(view.columns) if c in unknowns], dtype=np.intp)
    places = [unknowns[view.columns[k]] for k in local]
    selectors = selectors_of(kernel, len(view.outputs), local)
    functions = kernel.functions(view.rows, view.at_zero)
    design = _expanded(functions, selectors)
    out = np.zeros((len(view) * len(selectors), len(unknowns)))
    out[:, places] = view.whiten(slice(None), design).reshape(len(local), len(out)).T
    return out
