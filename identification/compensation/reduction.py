"""Reduction of the error model to a controller's tables: minimax error at nearly the least-squares residual.

The tables are linear in their values: at a pose the tip's error is ``e + J c(v) - G g``, with ``c`` the correction of
the axes, ``J`` the motion of the tip per unit of each and ``G g`` a small rigid motion of the workpiece's frame, which
is free. Least squares give the smallest root mean square error of the structure; among tables close to it that keep
the format's slopes, a second-order cone programme (CVXPY) finds those with the smallest maximum error. The maximum
alone is not minimised: where a structure can remove little, it would cost much mean square for one pose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.base import Controller
from errormodel.controllers.grids import hats, nodes
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Table, Tables, Term
from identification.compensation.minimax import Ball, Slopes, least_worst

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix, csr_matrix

MOST_CONE_VALUES = 5000  # table values: larger problems get the least-squares solution only, for time
GIVEN_UP_SHARE = 0.02  # of the removable RMS error, permitted as loss for a smaller maximum; by judgement
MOST_RMS_INCREASE = 0.05  # of the least-squares residual RMS: upper bound of that loss; by judgement
RIDGE_WEIGHT = 1e-8  # penalty on scaled values, so that values without poses are determined
KINK_WEIGHT = 0.1  # penalty on second differences: values with few poses continue their neighbours straight
# A curve leaves least squares in at most so many straight pieces, of two intervals at least, though in no fewer than
# LEAST_CURVE_PIECES: otherwise the last value alone would follow the pose in the corner. By judgement.
CURVE_PIECES = 8
LEAST_CURVE_PIECES = 3
# pieces of a lattice along an axis with two directions of approach: nearly all poses are then active
LATTICE_PIECES = 2
IDLE_TABLE_SHARE = 1e-3  # of the largest table's RMS effect: smaller tables are left out; by judgement


@dataclass(frozen=True)
class Sample:
    """Sample of poses of the volume, in the controller's units (mm, deg).

    Attributes
    ----------
    q, direction : (n, axes) commands, and directions of approach (+-1).
    errors : (n, 3) actual minus nominal, mm.
    motion : (n, 3, movers) mm of the nominal tip per unit of each mover (the actual tip's would let millimetres of a
        shift of the frame turn the axes' own errors into corrections).
    frame : (n, 3, 6) mm of the tip per mm or rad of the frame's motions; (n, 3, 0) where the frame is fixed.
    sides : 2 where the second half repeats the first with the opposite directions of approach.
    """

    q: Array
    direction: Array
    errors: Array
    motion: Array
    frame: Array
    sides: int = 1


def frame_motion(points: Array, free: bool, turns: bool = True) -> Array:
    """Jacobian (n, 3, 6) of points (n, 3) by small motions of the frame: shifts, then rotations about the centroid.

    (n, 3, 0) where the frame is not `free`; (n, 3, 3), shifts only, without `turns`.
    """
    n = len(points)
    if not free:
        return np.zeros((n, 3, 0))
    if not turns:
        return np.tile(np.eye(3), (n, 1, 1))
    out = np.zeros((n, 3, 6))
    out[:, :, :3] = np.eye(3)
    turn = -np.cross(points - points.mean(axis=0), np.eye(3)[:, None, :])  # (3, n, 3): e_k x r
    out[:, :, 3:] = turn.transpose(1, 2, 0)
    return out


def reduce(
    controller: Controller, setup: Setup, terms: Sequence[Term], sample: Sample, most_tables: int | None = None
) -> Tables:
    """Fit the tables of given terms to a sample of the volume; tables without effect are left out.

    Parameters
    ----------
    controller, setup : the format, and the machine as its axes.
    terms : structure: output, inputs and grids of each table.
    sample : poses with their errors.
    most_tables : number of tables that the format takes at most; the ones with the largest effect are kept.
    """
    columns = {t: _column(controller, setup, t, sample) for t in terms}
    while True:
        task = _Task.of(controller, setup, {t: columns[t] for t in terms}, sample)
        values = task.split(task.least)
        moved = [_moves(columns[t], v, sample.frame) for t, v in zip(terms, values, strict=True)]
        keep = [k for k, m in enumerate(moved) if m > IDLE_TABLE_SHARE * max(moved)]
        if most_tables is not None and len(keep) > most_tables:
            keep = sorted(sorted(keep, key=lambda k: -moved[k])[:most_tables])
        if len(keep) == len(terms) or not keep:
            return tuple(Table(t, v) for t, v in zip(terms, task.split(task.best()), strict=True))
        terms = [terms[k] for k in keep]


def leftover(controller: Controller, setup: Setup, tables: Tables, sample: Sample) -> float:
    """Largest residual error (mm) over a sample, to first order and after the best-fit frame."""
    left = sample.errors.copy()
    for table in tables:
        left += (_column(controller, setup, table.term, sample) @ table.values.ravel()).reshape(3, -1).T
    return float(np.linalg.norm(_framed(left, sample.frame), axis=1).max())


def _framed(errors: Array, frame: Array) -> Array:
    """Errors (n, 3) after the least-squares motion of the frame."""
    flat = frame.reshape(errors.size, -1)
    if not flat.shape[1]:
        return errors
    return errors - (flat @ np.linalg.lstsq(flat, errors.ravel(), rcond=1e-9)[0]).reshape(errors.shape)


def _moves(column: csr_matrix, values: Array, frame: Array) -> float:
    """RMS effect of a table at the tip beyond any motion of the frame, mm."""
    return float(np.sqrt(np.mean(np.square(_framed((column @ values.ravel()).reshape(3, -1).T, frame)))))


def _column(controller: Controller, setup: Setup, term: Term, sample: Sample) -> csr_matrix:
    """(3 n, size): motion of the tip along x, then y, then z, per unit of each value."""
    from scipy.sparse import csr_matrix, diags, vstack

    weights = term.weights(setup, sample.q, sample.direction)
    tip = np.einsum("nim,nm->ni", sample.motion, controller.influence(setup, term.output, sample.q))
    return csr_matrix(vstack([diags(tip[:, k]) @ weights for k in range(3)]))


@dataclass(frozen=True)
class _Task:
    """One reduction in scaled values: the residual is ``errors + design @ x``, all x rows, then y, then z.

    Attributes
    ----------
    terms : tables whose values `x` holds one after the other, followed by the frame's motions.
    design, errors : (3 n, size) and (3 n,), in multiples of `unit` (mm).
    before : root of the sum of squares without tables, after the best-fit frame.
    scale : (size,) values of unit effect.
    equal : linear functions that must be zero; `kinks` : second differences.
    """

    terms: tuple[Term, ...]
    design: csr_matrix
    errors: Array
    before: float
    unit: float
    scale: Array
    equal: csr_matrix
    slopes: Slopes
    kinks: csr_matrix
    sides: int

    @classmethod
    def of(cls, controller: Controller, setup: Setup, columns: Mapping[Term, csr_matrix], sample: Sample) -> _Task:
        from scipy.sparse import csr_matrix, diags, hstack

        terms = tuple(columns)
        frame = csr_matrix(-sample.frame.transpose(1, 0, 2).reshape(sample.errors.size, -1))
        design = hstack([*columns.values(), frame], format="csr")
        size = np.sqrt(np.asarray(design.multiply(design).sum(axis=0)).ravel())
        # a value that hardly any pose depends on keeps the scale of the others: its neighbours determine it
        scale = 1 / np.maximum(size, 0.03 * np.median(size[size > 0]) if (size > 0).any() else 1.0)
        unit = float(np.sqrt(np.mean(np.square(sample.errors)))) or 1.0
        equal, slopes = _limits(controller, setup, terms, scale)
        return cls(
            terms,
            (design @ diags(scale)).tocsr(),
            sample.errors.T.ravel() / unit,
            float(np.linalg.norm(_framed(sample.errors, sample.frame))) / unit,
            unit,
            scale,
            equal,
            Slopes(slopes.rows, slopes.bounds / unit),
            _kinks(terms, scale),
            sample.sides,
        )

    def split(self, x: Array) -> list[Array]:
        """Values of each term in mm or deg, in the shape of its grid."""
        parts = np.split(self.unit * self.scale * x, np.cumsum([t.size for t in self.terms]))
        return [p.reshape(t.shape) for p, t in zip(parts, self.terms, strict=False)]

    @cached_property
    def gram(self) -> csc_matrix:
        """Gram matrix of the design, with the penalties."""
        from scipy.sparse import csc_matrix, identity

        slight = RIDGE_WEIGHT * identity(self.design.shape[1]) + KINK_WEIGHT * self.kinks.T @ self.kinks
        return csc_matrix(self.design.T @ self.design + slight)

    @cached_property
    def least(self) -> Array:
        """Least-squares solution with the equality constraints."""
        from scipy.linalg import solve
        from scipy.sparse import csc_matrix, hstack, identity, vstack
        from scipy.sparse.linalg import splu

        size, rows = self.design.shape[1], self.equal.shape[0]
        goal = np.concatenate([-self.design.T @ self.errors, np.zeros(rows)])
        below = hstack([self.equal, csc_matrix(-1e-12 * identity(rows))])
        full = csc_matrix(vstack([hstack([self.gram, self.equal.T]), below]))
        dense = size <= MOST_CONE_VALUES  # the matrix is nearly full, so a dense solver is faster
        x: Array = solve(full.toarray(), goal, assume_a="sym") if dense else splu(full).solve(goal)
        return x[:size]

    def best(self) -> Array:
        """Minimax solution within the permitted loss of mean square."""
        if len(self.least) > MOST_CONE_VALUES:
            return self.least
        from scipy.sparse import csr_matrix, vstack

        # the frame stays that of least squares, since errors are assessed after it
        motions = self.design[:, sum(t.size for t in self.terms) :]
        held = csr_matrix(vstack([self.equal, motions.T @ self.design]))
        ball = Ball.of(self.least, self.gram.toarray(), held, self.moves())
        bends = self._bends()
        limits = Slopes(
            csr_matrix(vstack([self.slopes.rows, bends.rows])), np.concatenate([self.slopes.bounds, bends.bounds])
        )
        return least_worst(self.design, self.errors, ball, limits, self._room)

    def _bends(self) -> Slopes:
        """Second differences of curves over one axis, none larger than the curve's largest by least squares.

        Otherwise a curve would run away in its last interval for the sake of one pose in a corner, and that value would
        hold beyond.
        """
        now, start = np.abs(self.kinks @ self.least), 0
        rows, bounds = list[int](), list[float]()
        for term in self.terms:
            count = _kink_count(term)
            if len(term.grids) == 1 and count:
                rows += range(start, start + count)
                bounds += [float(now[start : start + count].max())] * count
            start += count
        return Slopes(self.kinks[rows], np.array(bounds))

    def moves(self) -> csr_matrix | None:
        """Basis (size, m) of departures from least squares, on coarser grids; None: any departure."""
        from scipy.sparse import block_diag, diags, identity

        coarse = [self._coarse(t) for t in self.terms]
        if all(c == t.grids for c, t in zip(coarse, self.terms, strict=True)):
            return None
        parts = [hats(c, nodes(t.grids)) if c else identity(1) for c, t in zip(coarse, self.terms, strict=True)]
        frame = identity(len(self.scale) - sum(t.size for t in self.terms))
        return (diags(1 / self.scale) @ block_diag([*parts, frame])).tocsr()

    def _coarse(self, term: Term) -> tuple[tuple[float, ...], ...]:
        if len(term.grids) > 1 and self.sides == 1:
            return term.grids
        out = []
        for grid in term.grids:
            most = len(grid) - 1
            pieces = (
                min(CURVE_PIECES, max(most // 2, LEAST_CURVE_PIECES), most)
                if len(term.grids) == 1
                else min(LATTICE_PIECES, most)
            )
            at = np.unique(np.rint(np.linspace(0, most, pieces + 1)).astype(int))
            out.append(tuple(grid[k] for k in at))
        return tuple(out)

    def _room(self, x: Array) -> float:
        """Permitted increase of the sum of squares over that of `x`, the least-squares solution within the slopes."""
        least = float(np.linalg.norm(self.errors + self.design @ x))
        given = min(GIVEN_UP_SHARE * max(self.before - least, 0.0), MOST_RMS_INCREASE * least)
        return (least + given) ** 2 - least**2


def _limits(controller: Controller, setup: Setup, terms: Sequence[Term], scale: Array) -> tuple[csr_matrix, Slopes]:
    """Equality constraints (zero at the reference point, one value at both ends of a turn), slopes and their bounds."""
    from scipy.sparse import coo_matrix, csr_matrix, diags, vstack

    start, total = 0, len(scale)
    zero: list[csr_matrix] = []
    steep, bounds = [csr_matrix((0, total))], [np.zeros(0)]
    for term in terms:
        if term.zero:
            at = np.array([[min(max(0.0, g[0]), g[-1]) for g in term.grids]])
            full = np.zeros((1, len(setup.axes)))
            full[0, [setup.place(i) for i in term.inputs]] = at
            row = term.weights(setup, full, np.full_like(full, float(term.direction or 1)))
            zero.append(csr_matrix((row.data, row.indices + start, row.indptr), shape=(1, total)))
        zero += _closed(setup, term, start, total)
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
            steep.append(matrix.tocsr())
            bounds.append(np.full(lower.size, bound))
        start += term.size
    scaled = [(vstack([csr_matrix((0, total)), *rows]) @ diags(scale)).tocsr() for rows in (zero, steep)]
    return scaled[0], Slopes(scaled[1], np.concatenate(bounds))


def _closed(setup: Setup, term: Term, start: int, total: int) -> list[csr_matrix]:
    """Differences of a table's values at both ends of axes that go round, which are the same place."""
    from scipy.sparse import coo_matrix

    index = start + np.arange(term.size).reshape(term.shape)
    out = []
    for axis, name in enumerate(term.inputs):
        if setup.axis(name).turns and len(term.grids[axis]) > 2:
            ends = np.moveaxis(index, axis, 0)
            first, last = ends[0].ravel(), ends[-1].ravel()
            rows, ones = np.arange(len(first)), np.ones(len(first))
            matrix = coo_matrix(
                (np.concatenate([ones, -ones]), (np.tile(rows, 2), np.concatenate([first, last]))),
                shape=(len(first), total),
            )
            out.append(matrix.tocsr())
    return out


def _kink_count(term: Term) -> int:
    """Number of second differences along all grids of a term."""
    return sum(max(n - 2, 0) * (term.size // n) for n in term.shape)


def _kinks(terms: Sequence[Term], scale: Array) -> csr_matrix:
    """Second differences along every grid, in units of the median effect of the values."""
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
