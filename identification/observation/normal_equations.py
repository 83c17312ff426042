"""Normal equations of weighted least squares, accumulated block by block over the rows of the views.

M is the design matrix, W the inverse covariance of the observations, r the residual; units mm and rad, whitened.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

from errormodel.arrays import Array, Index
from identification.observation.models import GapView, Kind, View, anywhere
from identification.observation.sums import Pass, Sums, expanded, selectors_of

V = TypeVar("V", bound=View)

FULL_POSES = 200  # random poses that stand for the full travels
RANK_SAMPLE_ROWS = 400  # rows of a view on which the rank is decided first, before all are checked: saves time


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
    lengths: bool = False,
    products_of: Index | None = None,
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
    lengths : bool
        Sum and largest of the residuals' lengths are wanted, too.
    products_of : unknowns whose rows of ``M'WM`` are all that is wanted of it; None: of all.
    """
    sums: dict[Kind, Sums] = {}
    for view in views:
        local = np.array([k for k, c in enumerate(view.columns) if c in unknowns], dtype=np.intp)
        places = np.array([unknowns[view.columns[k]] for k in local], dtype=np.intp)
        fresh = values if taken is None or not isinstance(view, GapView) else values - taken
        linear = fresh[places] * (np.array([exact and k < view.exact_columns for k in local]) == 0)
        p = view.vector(unknowns if exact else {}, values, held)
        here = None if at is None else view_vector(view, unknowns, at, held)
        some = None if products_of is None else np.flatnonzero(np.isin(places, products_of))
        own = Pass(view, local, linear if linear.any() else None, p, here, gram, lengths, some).run()
        whole = sums.setdefault(view.kind, Sums.zero(len(unknowns)))
        whole.gram[np.ix_(places, places)] += own.gram
        whole.slope[places] += own.slope
        whole.square += own.square
        whole.count += view.count
        if lengths:
            whole.length = np.nansum([whole.length, own.length])
            whole.longest = np.fmax(whole.longest, own.longest)
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


def sampled(view: V, most: int) -> V:
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
    if view.weight is not None:
        return len(view) * view.weight**2
    square = np.square(view.whitener)
    return float((square if square.ndim == 1 else square.reshape(len(view), -1).max(axis=1)).sum())


def design_rows(view: View, unknowns: Mapping[str, int], most: int = RANK_SAMPLE_ROWS) -> Array:
    """Whitened rows of M, dense, of at most `most` of the view's rows, evenly spread: (rows * components, unknowns)."""
    view = sampled(view, most)
    local = np.array([k for k, c in enumerate(view.columns) if c in unknowns], dtype=np.intp)
    places = [unknowns[view.columns[k]] for k in local]
    out = np.zeros((len(view) * len(view.outputs), len(unknowns)))
    if (stored := view.known_design) is not None and view.whitener.ndim == 1:
        for part, seen, block in stored.blocks(view.outputs, local):
            out.reshape(len(view.outputs), len(view), -1)[:, part, np.array(places)[seen]] = block
        out *= np.tile(view.whitener, len(view.outputs))[:, None]
        return out
    kernel = view.design(linearised=False)
    selectors = selectors_of(kernel, len(view.outputs), local)
    # in one expression, as no array of this size is to be kept longer than it is needed
    white = view.whiten(slice(None), expanded(kernel.functions(view.rows, view.at_zero), selectors))
    out[:, places] = white.reshape(len(local), len(out)).T
    return out
