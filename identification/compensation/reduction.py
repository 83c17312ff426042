"""The error model reduced to what a controller's tables can express: least worst error, then least mean square.

The tables are linear in their values: at a pose the tip's error is ``e + J c(v) - G g``, with ``c`` the correction of
the axes, ``J`` the motion of the tip per unit of each and ``G g`` a small motion of the workpiece's frame, which
costs nothing. First the least worst error is found (a second-order cone programme in CVXPY), then the least mean
square near it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.base import Controller
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Table, Tables, Term

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

MOST_CONES = 1600  # values up to which the cone programme is solved; larger lattices are reweighted least squares
SHARE = 0.25  # of what least squares leave above the least worst error, given up for the mean
RIDGE = 1e-8  # of the mean square, for values that no pose determines
NEAR = 1e-4  # of the mean square, that keeps the cone programme near the least squares where nothing else decides
SMOOTH = 0.1  # of the mean square, for kinks: what few poses determine goes on straight
IDLE = 1e-3  # of the largest: a table that moves less is left out
ROUNDS = 12


@dataclass(frozen=True)
class Sample:
    """Poses that stand for the volume, in the controller's units.

    Attributes
    ----------
    q, direction : (n, axes)
    errors : (n, 3) actual minus nominal, mm.
    motion : (n, 3, movers) mm of the nominal tip per unit of each mover (the actual tip's would let millimetres of a
        shift of the frame turn the axes' own errors into corrections).
    frame : (n, 3, 6) mm of the tip per unit of the frame's motions; (n, 3, 0) where the frame is fixed.
    """

    q: Array
    direction: Array
    errors: Array
    motion: Array
    frame: Array


def frame_motion(points: Array, free: bool) -> Array:
    """(n, 3, 6): what small motions of the frame do at points (n, 3); (n, 3, 0) where it is not free."""
    n = len(points)
    if not free:
        return np.zeros((n, 3, 0))
    out = np.zeros((n, 3, 6))
    out[:, :, :3] = np.eye(3)
    turn = -np.cross(points - points.mean(axis=0), np.eye(3)[:, None, :])  # (3, n, 3): e_k x r
    out[:, :, 3:] = turn.transpose(1, 2, 0)
    return out


def reduce(
    controller: Controller, setup: Setup, terms: Sequence[Term], sample: Sample, most_tables: int | None = None
) -> Tables:
    """The best tables of these terms for a sample of the volume; those that move next to nothing are left out."""
    while True:
        values = _solve(controller, setup, terms, sample, exact=False)
        moved = [_moves(controller, setup, t, v, sample) for t, v in zip(terms, values, strict=True)]
        keep = [k for k, m in enumerate(moved) if m > IDLE * max(moved)]
        if most_tables is not None and len(keep) > most_tables:
            keep = sorted(sorted(keep, key=lambda k: -moved[k])[:most_tables])
        if len(keep) == len(terms) or not keep:
            values = _solve(controller, setup, terms, sample, exact=True)
            return tuple(Table(t, v) for t, v in zip(terms, values, strict=True))
        terms = [terms[k] for k in keep]


def leftover(controller: Controller, setup: Setup, tables: Tables, sample: Sample) -> float:
    """Worst error (mm) that tables leave over a sample, to first order and after the best frame."""
    left = sample.errors.copy()
    for table in tables:
        for k, column in enumerate(_column(controller, setup, table.term, sample)):
            left[:, k] += column @ table.values.ravel()
    frame = sample.frame.reshape(left.size, -1)
    if frame.shape[1]:
        left = left - (frame @ np.linalg.lstsq(frame, left.ravel(), rcond=1e-9)[0]).reshape(left.shape)
    return float(np.linalg.norm(left, axis=1).max())


def _moves(controller: Controller, setup: Setup, term: Term, values: Array, sample: Sample) -> float:
    """Root mean square of what a table does at the tip, mm."""
    effect = _column(controller, setup, term, sample)
    return float(np.sqrt(np.mean([np.square(a @ values.ravel()).sum() for a in effect])))


def _column(controller: Controller, setup: Setup, term: Term, sample: Sample) -> list[csr_matrix]:
    """Three (n, size): motion of the tip along x, y, z per unit of each value."""
    from scipy.sparse import diags

    weights = term.weights(setup, sample.q, sample.direction)
    tip = np.einsum("nim,nm->ni", sample.motion, controller.influence(setup, term.output, sample.q))
    return [(diags(tip[:, k]) @ weights).tocsr() for k in range(3)]


def _solve(controller: Controller, setup: Setup, terms: Sequence[Term], sample: Sample, exact: bool) -> list[Array]:
    """Values of each term, of its shape; not `exact`: by least squares, to see which terms matter."""
    from scipy.sparse import csr_matrix, diags, hstack

    columns = [_column(controller, setup, t, sample) for t in terms]
    frame = [csr_matrix(-sample.frame[:, k, :]) for k in range(3)]
    design = [hstack([*(c[k] for c in columns), frame[k]], format="csr") for k in range(3)]
    square = np.sum([np.asarray(d.multiply(d).sum(axis=0)).ravel() for d in design], axis=0)
    size = np.sqrt(square)
    # a value that hardly any pose sees keeps the scale of the others: what is next to it decides it
    scale = 1 / np.maximum(size, 0.03 * np.median(size[size > 0]) if (size > 0).any() else 1.0)
    scaled = [(d @ diags(scale)).tocsr() for d in design]
    equal, steep = _limits(controller, setup, terms, scale)
    unit = float(np.sqrt(np.mean(np.square(sample.errors)))) or 1.0
    goal = sample.errors / unit
    kinks = _kinks(terms, scale)
    x = _least(scaled, goal, equal, kinks)
    if exact and scaled[0].shape[1] <= MOST_CONES:
        x = _cones(scaled, goal, x, equal, [(m, b / unit) for m, b in steep], kinks)
    elif exact:
        x = _reweighted(scaled, goal, x, equal, kinks)
    flat, out, start = unit * scale * x, [], 0
    for term in terms:
        out.append(flat[start : start + term.size].reshape(term.shape))
        start += term.size
    return out


def _limits(
    controller: Controller, setup: Setup, terms: Sequence[Term], scale: Array
) -> tuple[csr_matrix, list[tuple[csr_matrix, float]]]:
    """Rows that must be zero (tables at the reference point), and differences of neighbours with their bounds."""
    from scipy.sparse import coo_matrix, csr_matrix, diags, vstack

    start, total = 0, len(scale)
    zero, steep = [], []
    for term in terms:
        if term.zero:
            at = np.array([[min(max(0.0, g[0]), g[-1]) for g in term.grids]])
            full = np.zeros((1, len(setup.axes)))
            full[0, [setup.place(i) for i in term.inputs]] = at
            row = term.weights(setup, full, np.full_like(full, float(term.direction or 1)))
            zero.append(csr_matrix((row.data, row.indices + start, row.indptr), shape=(1, total)))
        bound = controller.most_slope(setup, term)
        index = start + np.arange(term.size).reshape(term.shape)
        for axis, grid in enumerate(term.grids if bound is not None else ()):
            lower = np.moveaxis(index, axis, 0)[:-1].reshape(len(grid) - 1, -1)
            upper = np.moveaxis(index, axis, 0)[1:].reshape(len(grid) - 1, -1)
            rows = np.arange(lower.size)
            step = np.repeat(np.diff(grid), lower.shape[1])
            matrix = coo_matrix(
                (
                    np.concatenate([-1 / step, 1 / step]),
                    (np.tile(rows, 2), np.concatenate([lower.ravel(), upper.ravel()])),
                ),
                shape=(lower.size, total),
            )
            if lower.size and bound is not None:
                steep.append(((matrix.tocsr() @ diags(scale)).tocsr(), bound))
        start += term.size
    nothing = csr_matrix((0, total))
    return (vstack([nothing, *zero]) @ diags(scale)).tocsr(), steep


def _kinks(terms: Sequence[Term], scale: Array) -> csr_matrix:
    """Second differences along every grid, in units of the values' own effect."""
    from scipy.sparse import coo_matrix, csr_matrix, vstack

    total, start = len(scale), 0
    parts = [csr_matrix((0, total))]
    for term in terms:
        own = scale[start : start + term.size]
        middle = float(np.median(own))
        index = start + np.arange(term.size).reshape(term.shape)
        for axis, grid in enumerate(term.grids):
            if len(grid) < 3:
                continue
            slabs = np.moveaxis(index, axis, 0).reshape(len(grid), -1)
            three = [slabs[k : len(grid) - 2 + k].ravel() for k in range(3)]
            rows = np.tile(np.arange(len(three[0])), 3)
            value = np.concatenate([f * np.ones(len(three[0])) for f in (1.0, -2.0, 1.0)])
            columns = np.concatenate(three)
            shape = (len(three[0]), total)
            parts.append(coo_matrix((value * scale[columns] / middle, (rows, columns)), shape).tocsr())
        start += term.size
    return vstack(parts).tocsr()


def _least(
    design: list[csr_matrix], errors: Array, equal: csr_matrix, kinks: csr_matrix, weight: Array | None = None
) -> Array:
    """Weighted least squares with slight penalties and equality rows."""
    from scipy.sparse import bmat, diags, identity
    from scipy.sparse.linalg import splu

    w = np.ones(len(errors)) if weight is None else weight
    gram = sum((d.T @ diags(w) @ d for d in design[1:]), design[0].T @ diags(w) @ design[0])
    slope: Array = np.sum([d.T @ (w * errors[:, k]) for k, d in enumerate(design)], axis=0)
    size = gram.shape[0]
    gram = gram + RIDGE * identity(size) + SMOOTH * kinks.T @ kinks
    if equal.shape[0]:
        gram = bmat([[gram, equal.T], [equal, -1e-12 * identity(equal.shape[0])]])
        slope = np.concatenate([slope, np.zeros(equal.shape[0])])
    x: Array = -splu(gram.tocsc()).solve(slope)[:size]
    return x


def _residual(design: list[csr_matrix], errors: Array, x: Array) -> Array:
    return np.column_stack([errors[:, k] + d @ x for k, d in enumerate(design)])


def _reweighted(design: list[csr_matrix], errors: Array, x: Array, equal: csr_matrix, kinks: csr_matrix) -> Array:
    """Towards the least worst error by weights that grow with the residuals (Lawson)."""
    best, least = x, np.inf
    weight = np.ones(len(errors))
    for _ in range(ROUNDS):
        length = np.linalg.norm(_residual(design, errors, x), axis=1)
        if length.max() < least:
            best, least = x, length.max()
        weight = weight * (0.1 + length / length.mean())
        weight = weight / weight.mean()
        x = _least(design, errors, equal, kinks, weight)
    return best


def _cones(
    design: list[csr_matrix],
    errors: Array,
    start: Array,
    equal: csr_matrix,
    steep: list[tuple[csr_matrix, float]],
    kinks: csr_matrix,
) -> Array:
    """The least worst error, then the least mean square `SHARE` of the way to the least squares' own worst."""
    import cvxpy

    cp: Any = cvxpy  # it names its functions without types
    x, worst = cp.Variable(len(start)), cp.Variable()
    residual = cp.vstack([errors[:, k] + d @ x for k, d in enumerate(design)])
    rules: list[Any] = [equal @ x == 0] if equal.shape[0] else []
    rules += [cp.abs(m @ x) <= b for m, b in steep]
    lengths = cp.norm(residual, axis=0)
    slight = NEAR * cp.sum_squares(x - start) + SMOOTH * cp.sum_squares(kinks @ x)
    first = _optimum(cp.Problem(cp.Minimize(worst + NEAR * slight), [lengths <= worst, *rules]), x)
    if first is None:
        return start
    least, usual = (float(np.linalg.norm(_residual(design, errors, v), axis=1).max()) for v in (first, start))
    bound = least + max(SHARE * (usual - least), 1e-4 * least)
    second = _optimum(cp.Problem(cp.Minimize(cp.sum_squares(residual) + slight), [lengths <= bound, *rules]), x)
    return first if second is None else second


def _optimum(problem: Any, x: Any) -> Array | None:
    import warnings

    import cvxpy as cp

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a solution less exact than asked for: it is checked by its residuals
        try:
            problem.solve(solver=cp.CLARABEL)
        except cp.error.SolverError:
            return None
    return None if x.value is None or not np.isfinite(x.value).all() else np.asarray(x.value)
