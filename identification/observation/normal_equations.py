"""Normal equations of weighted least squares, accumulated block by block over the rows of the views.

M is the design matrix, W the inverse covariance of the observations, r the residual; units mm and rad, whitened.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.kernel import Kernel
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
        kernel = self.view.design(linearised=self.at is not None)
        selectors = selectors_of(kernel, len(self.view.outputs), self.columns)
        components, columns = len(selectors), len(self.columns)
        few = not self.gram or kernel.n_functions**2 < 2 * components * columns**2
        alike = self.view.whitener.ndim == 1 and few
        return self._alike(kernel, selectors) if alike else self._directed(kernel, selectors)

    def _blocks(self, kernel: Kernel, selectors: list[Selector]) -> Iterator[tuple[slice, Array, Array]]:
        """Blocks of rows: slice, distinct functions and residual."""
        design = kernel.blocks(self.view.rows, self.p if self.at is None else self.at)
        n = kernel.n_functions
        slopes = None if self.linear is None else np.array([np.bincount(k, s * self.linear, n) for k, s in selectors])
        for (part, functions), (_, gap) in zip(design, self.view.gaps(self.p), strict=True):
            block = np.asarray(functions)
            kept = gap if isinstance(self.view, GapView) else None  # stored gaps are overwritten by the residual
            yield part, block, gap if slopes is None else np.subtract(gap, slopes @ block, out=kept)

    def _alike(self, kernel: Kernel, selectors: list[Selector]) -> Sums:
        """Sums for one weight per row: one Gram matrix of the distinct functions serves all components."""
        n, c = kernel.n_functions, len(selectors)
        gram, slope, square = np.zeros((n, n)), np.zeros((n, c)), np.zeros(c)
        whitener = self.view.whitener
        same = len(whitener) > 0 and bool((whitener == whitener[0]).all())
        for part, functions, gap in self._blocks(kernel, selectors):
            white, left = (functions, gap) if same else (functions * whitener[part], gap * whitener[part])
            if self.gram:
                gram += white @ white.T
            slope += white @ left.T
            square += np.einsum("cm,cm->c", left, left)
        weight = float(whitener[0]) ** 2 if same else 1.0
        sums = Sums.zero(len(self.columns))
        sums.square = weight * float(square.sum())
        for k, (place, factor) in enumerate(selectors):
            if self.gram:
                sums.gram += weight * np.outer(factor, factor) * gram[np.ix_(place, place)]
            sums.slope += weight * factor * slope[place, k]
        return sums

    def _directed(self, kernel: Kernel, selectors: list[Selector]) -> Sums:
        """Sums for a covariance per row, or where columns share few functions: M is expanded and whitened."""
        sums = Sums.zero(len(self.columns))
        for part, functions, gap in self._blocks(kernel, selectors):
            white = self.view.whiten(part, _expanded(functions, selectors)).reshape(len(self.columns), gap.size)
            flat = self.view.whiten(part, gap).ravel()
            if self.gram:
                sums.gram += white @ white.T
            sums.slope += white @ flat
            sums.square += float(flat @ flat)
        return sums


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
    return float(np.square(view.whitener).reshape(len(view), -1).max(axis=1).sum())


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
