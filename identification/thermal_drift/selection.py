"""Forward selection of lagged temperatures for an error motion by cross-validated ridge regression.

Structures respond to a surface temperature with a delay. Each candidate is a sensor after a first-order lag, times
Legendre polynomials of the position up to some order. A normal prior about zero (ridge) keeps nearly collinear sensors
from large coefficients of opposite sign. The candidate with the smallest cross-validation error is added as long as it
lowers the error enough. Folds are stretches of time and, in turn, whole recordings (other positions, mostly in other
cycles). The width of the prior is chosen by the same error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from errormodel.arrays import Array, Index

# All by judgement
STRETCHES_PER_RECORDING = 5  # consecutive parts of each recording that are left out in turn
LEAST_ERROR_REDUCTION = 0.003  # relative reduction of the cross-validated mean square error by one more temperature
MOST_TEMPERATURES = 12  # temperatures per error motion
PRIOR_WIDTHS = (0.05, 0.2, 0.8)  # standard deviations of the prior, in the motion's rms drift per kelvin
EQUAL_ERROR_SHARE = 0.02  # relative difference of errors within which the narrower prior is preferred
GRAM_ROUND_OFF = 1e-10  # ridge relative to the largest squared column norm: keeps Gram matrices invertible


@dataclass(frozen=True)
class Choice:
    """The selected temperatures of an error motion.

    Attributes
    ----------
    picked : (candidate, order along the travel), in the order of selection.
    width : standard deviation of the prior, in the motion's unit per kelvin.
    error : root mean square of the cross-validation residuals, in the motion's unit.
    """

    picked: tuple[tuple[int, int], ...]
    width: float
    error: float


def choose(columns: Array, values: Array, series: Index, most_order: int, noise: float) -> Choice:
    """Select candidates and the width of the prior by cross-validation.

    Parameters
    ----------
    columns : (n, candidates, orders) of all candidates, K over 20 degC times a polynomial.
    values : (n,) of the error motion, mm or rad.
    series : (n,) numbers of recording and position: each has its own zero of the instrument.
    most_order : largest order that the number of positions determines.
    noise : standard deviation of one value, mm or rad.
    """
    warmth = np.sqrt(np.mean(np.square(centred(columns[:, :, 0], series))))
    usual = np.sqrt(np.mean(np.square(centred(values, series)))) / max(warmth, 1e-9)
    if usual == 0:  # no drift
        return Choice((), 0.0, 0.0)
    folds = _folds(columns, values, series)
    tries = [_grow(folds, most_order, width * usual, noise) for width in PRIOR_WIDTHS]
    best = min(choice.error for choice in tries)
    return next(choice for choice in tries if choice.error <= (1 + EQUAL_ERROR_SHARE) * best)


def centred(values: Array, series: Index) -> Array:
    """Values (n, ...) minus the mean of their series."""
    flat = values.reshape(len(values), -1)
    sums = np.zeros((int(series.max(initial=0)) + 1, flat.shape[1]))
    np.add.at(sums, series, flat)
    means = sums / np.maximum(np.bincount(series, minlength=len(sums)), 1)[:, None]
    return (flat - means[series]).reshape(values.shape)


@dataclass(frozen=True)
class _Folds:
    """Gram matrices (folds, columns + 1, columns + 1) of all columns, with the values as the last one.

    `fit` is of the rows fitted, `left` of those left out; `own` and `held` (folds, candidates, orders, orders) are
    their diagonal blocks for each candidate.
    """

    fit: Array
    left: Array
    own: Array
    held: Array
    blocks: Index  # (candidates, orders) of the columns
    rows: int  # left out, of all folds


def _folds(columns: Array, values: Array, series: Index) -> _Folds:
    """Gram matrices of all folds (stretches of time, then whole recordings), from the sums of each stretch."""
    _, candidates, orders = columns.shape
    flat = columns.reshape(len(values), -1)
    labels = np.unique(series)
    cells: dict[tuple[int, int], tuple[Array, Array, int]] = {}
    both = np.column_stack([flat, values])
    both = both - both.mean(axis=0)  # against cancellation
    for s in labels:
        for k, rows in enumerate(np.array_split(np.flatnonzero(series == s), STRETCHES_PER_RECORDING)):
            part = both[rows]
            cells[int(s), k] = (part.T @ part, part.sum(axis=0), len(part))

    def gram(keys: Sequence[tuple[int, int]]) -> Array:
        out = np.zeros((both.shape[1],) * 2)
        for s in {s for s, _ in keys}:
            own = [cells[key] for key in keys if key[0] == s]
            count, total = sum(c for *_, c in own), np.sum([t for _, t, _ in own], axis=0)
            out += np.sum([g for g, *_ in own], axis=0) - np.outer(total, total) / max(count, 1)
        return out

    sets = [[key for key in cells if key[1] == k] for k in range(STRETCHES_PER_RECORDING)]
    sets += [[key for key in cells if key[0] == s] for s in labels] if len(labels) > 2 else []
    fit = np.array([gram([key for key in cells if key not in out]) for out in sets])
    left = np.array([gram(out) for out in sets])
    blocks = np.arange(candidates * orders).reshape(candidates, orders)
    pairs = (slice(None), blocks[:, :, None], blocks[:, None, :])
    own = fit[pairs] + GRAM_ROUND_OFF * float(np.diagonal(fit, axis1=1, axis2=2).max()) * np.eye(orders)
    return _Folds(fit, left, own, left[pairs], blocks, sum(cells[key][2] for out in sets for key in out))


def _grow(folds: _Folds, most_order: int, width: float, noise: float) -> Choice:
    """Forward selection of temperatures at one width of the prior."""
    tie = (noise / width) ** 2
    picked: list[tuple[int, int]] = []
    error = float(folds.left[:, -1, -1].sum())
    while len(picked) < min(MOST_TEMPERATURES, len(folds.blocks)):
        tries = _errors(folds, picked, most_order, tie)
        tries[[c for c, _ in picked]] = np.inf
        candidate = int(np.argmin(tries.min(axis=1)))
        # the lowest order among those with nearly the same error
        order = int(np.flatnonzero(tries[candidate] <= tries[candidate].min() + LEAST_ERROR_REDUCTION * error)[0])
        if not tries[candidate, order] < (1 - LEAST_ERROR_REDUCTION) * error:
            break
        error = float(tries[candidate, order])
        picked.append((candidate, order))
    return Choice(tuple(picked), width, float(np.sqrt(max(error, 0.0) / folds.rows)))


def _errors(folds: _Folds, picked: Sequence[tuple[int, int]], most_order: int, tie: float) -> Array:
    """Cross-validation sum of squares (candidates, orders) with each candidate and order added to those picked."""
    shape = folds.blocks.shape
    active = [int(folds.blocks[c, k]) for c, order in picked for k in range(order + 1)]
    fit, left = folds.fit[:, active], folds.left[:, active]

    def apart(rows: Any) -> Array:
        return np.asarray(rows[:, :, :-1].reshape(len(rows), len(active), *shape))

    # eliminate the picked columns from all others and from the values (Schur complement)
    among, last = left[:, :, active], left[:, :, -1]
    mix = np.linalg.solve(fit[:, :, active] + tie * np.eye(len(active)), fit)
    columns, value = apart(mix), mix[:, :, -1]
    own = folds.own + tie * np.eye(shape[1]) - np.einsum("fkco,fkcp->fcop", apart(fit), columns)
    product = folds.fit[:, :-1, -1] - np.einsum("fkn,fk->fn", fit[:, :, :-1], value)
    cross = np.einsum("fkco,fkcp->fcop", apart(left), columns)
    moved = (among @ mix[:, :, :-1]).reshape(columns.shape)
    held = folds.held - cross - cross.transpose(0, 1, 3, 2) + np.einsum("fkco,fkcp->fcop", columns, moved)
    rest = last - np.einsum("fkl,fl->fk", among, value)
    against = folds.left[:, :-1, -1] - np.einsum("fkn,fk->fn", left[:, :, :-1], value)
    against -= np.einsum("fkn,fk->fn", mix[:, :, :-1], rest)
    square = float((folds.left[:, -1, -1] - np.einsum("fk,fk->f", last + rest, value)).sum())
    out = np.full(shape, np.inf)
    for order in range(most_order + 1):
        use = slice(0, order + 1)
        own_part, columns_part = own[:, :, use, use], folds.blocks[:, use]
        found = np.linalg.solve(own_part, product[:, columns_part, None])[..., 0]
        quadratic = np.einsum("fco,fcop,fcp->c", found, held[:, :, use, use], found)
        out[:, order] = square - 2 * np.sum(found * against[:, columns_part], axis=(0, 2)) + quadratic
    return out
