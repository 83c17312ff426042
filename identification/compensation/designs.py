"""Design of a reduction to tables: what each table value does at the poses, limits of the format, and factors of both.

Nothing here depends on the errors: states of a machine (temperatures, times) whose poses are the same share it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.arrays import Array, Mask
from errormodel.controllers.base import Controller
from errormodel.controllers.grids import hats, nodes
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Term
from identification.compensation.minimax import Ball, Slopes
from identification.compensation.sample import Sample

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix, csr_matrix

MOST_CONE_VALUES = 5000  # table values: larger problems get the least-squares solution only, for time
RIDGE_WEIGHT = 1e-8  # penalty on scaled values, so that values without poses are determined
# The same on motions of the frame from where the errors are least without tables: those are what tables turn and shift
# the machine's coordinates by. Tables of a rotary table can move the workpiece as the frame does, and would follow it
# by millimetres for the sake of nanometres. By judgement: a turn as large as the errors then costs a thousandth of
# their squares, and a shift, which every zero that is set anew takes off, a hundredth of that.
FRAME_WEIGHT = 1e-3
SHIFT_SHARE = 0.01
MOST_TURN_WEIGHT = 1e6  # up to which turns are made dearer: there is then nothing of them left
KINK_WEIGHT = 0.1  # penalty on second differences: values with few poses continue their neighbours straight
SLACK = 1e-12  # of equality constraints, so that those which others imply do no harm
# A curve leaves least squares in at most so many straight pieces, of two intervals at least, though in no fewer than
# LEAST_CURVE_PIECES: otherwise the last value alone would follow the pose in the corner. By judgement.
CURVE_PIECES = 8
LEAST_CURVE_PIECES = 3
# pieces of a lattice along an axis with two directions of approach: nearly all poses are then active
LATTICE_PIECES = 2


@dataclass(frozen=True)
class Design:
    """The tables in scaled values: a pose's error changes by ``matrix @ x``, all x rows, then y, then z.

    Attributes
    ----------
    terms : tables whose values `x` holds one after the other, followed by the frame's motions.
    matrix : (3 n, size).
    scale : (size,) values of unit effect.
    equal : linear functions that must be zero; `slopes` : bounds of others, per mm; `kinks` : second differences.
    sides : 2 where the poses have two directions of approach.
    """

    terms: tuple[Term, ...]
    matrix: csr_matrix
    scale: Array
    equal: csr_matrix
    slopes: Slopes
    kinks: csr_matrix
    sides: int

    @classmethod
    def of(cls, controller: Controller, setup: Setup, columns: Mapping[Term, csr_matrix], sample: Sample) -> Design:
        from scipy.sparse import csr_matrix, diags, hstack

        terms = tuple(columns)
        frame = csr_matrix(-sample.frame.transpose(1, 0, 2).reshape(sample.errors.size, -1))
        matrix = hstack([*columns.values(), frame], format="csr")
        size = np.sqrt(np.asarray(matrix.multiply(matrix).sum(axis=0)).ravel())
        # a value that hardly any pose depends on keeps the scale of the others: its neighbours determine it
        scale = 1 / np.maximum(size, 0.03 * np.median(size[size > 0]) if (size > 0).any() else 1.0)
        equal, slopes = _limits(controller, setup, terms, scale)
        return cls(terms, (matrix @ diags(scale)).tocsr(), scale, equal, slopes, _kinks(terms, scale), sample.sides)

    @property
    def values(self) -> int:
        """Number of table values; the frame's motions follow them."""
        return sum(t.size for t in self.terms)

    @property
    def _turns(self) -> Mask:
        """Which of the frame's motions are turns; shifts stand before them."""
        return np.arange(len(self.scale) - self.values) >= 3

    @cached_property
    def gram(self) -> csc_matrix:
        """Gram matrix of the design, with the penalties."""
        from scipy.sparse import csc_matrix, diags

        weights = np.full(self.matrix.shape[1], RIDGE_WEIGHT)
        weights[self.values :] = FRAME_WEIGHT * np.where(self._turns, 1.0, SHIFT_SHARE)
        slight = diags(weights) + KINK_WEIGHT * self.kinks.T @ self.kinks
        return csc_matrix(self.matrix.T @ self.matrix + slight)

    @cached_property
    def ball(self) -> Ball:
        """Neighbourhood of zero in which the minimax solution is sought about the least-squares one."""
        from scipy.sparse import csr_matrix, identity, vstack

        # the frame stays that of least squares: errors are assessed after it, and none follows the tables for one pose
        motions = self.matrix[:, self.values :]
        still = identity(len(self.scale), format="csr")[self.values :]
        held = csr_matrix(vstack([self.equal, motions.T @ self.matrix, still]))
        return Ball.of(np.zeros(len(self.scale)), self._root, held, self.moves())

    @cached_property
    def _root(self) -> Array:
        """Lower triangular Cholesky factor (size, size) of the gram matrix, which is nearly full."""
        from scipy.linalg import cholesky

        return np.asarray(cholesky(self.gram.toarray(), lower=True, overwrite_a=True), np.float64)

    @cached_property
    def _seen(self) -> Array:
        """Equality constraints as functions (size, rows) of `z`, where the gram matrix is the identity."""
        from scipy.linalg import solve_triangular

        return np.asarray(solve_triangular(self._root, self.equal.T.toarray(), lower=True), np.float64)

    @cached_property
    def _factor(self) -> Any:
        """Factors of a large gram matrix with the equality constraints."""
        from scipy.sparse import csc_matrix, hstack, identity, vstack
        from scipy.sparse.linalg import splu

        below = hstack([self.equal, csc_matrix(-SLACK * identity(self.equal.shape[0]))])
        return splu(csc_matrix(vstack([hstack([self.gram, self.equal.T]), below])))

    def least(self, errors: Array) -> Array:
        """Least-squares solution (size,) for errors (3 n,), with the equality constraints."""
        return self._solved(-self.matrix.T @ errors)

    def _solved(self, goal: Array) -> Array:
        """Solutions (size, ...) of the normal equations for right-hand sides (size, ...)."""
        from scipy.linalg import solve_triangular

        size, rows = self.matrix.shape[1], self.equal.shape[0]
        if size > MOST_CONE_VALUES:
            below = np.zeros((rows, *goal.shape[1:]))
            return np.asarray(self._factor.solve(np.concatenate([goal, below]))[:size], np.float64)
        z = solve_triangular(self._root, goal, lower=True)
        if rows:
            z -= self._seen @ np.linalg.solve(self._seen.T @ self._seen + SLACK * np.eye(rows), self._seen.T @ z)
        return np.asarray(solve_triangular(self._root, z, lower=True, trans="T"), np.float64)

    @cached_property
    def _steered(self) -> Array:
        """Solutions (size, motions) of unit right-hand sides at the frame's motions."""
        return self._solved(np.eye(len(self.scale))[:, self.values :])

    def stillest(self, least: Array, room: float) -> Array:
        """Solution (size,) that turns the frame least while the sum of squares exceeds that of `least` by `room`.

        Its shifts are free: a zero that is set anew takes them off, and a value that is tied to the machine's zero
        would jump to where the measured rows begin. In an infinite room the frame does not turn.

        The values follow a given motion g of the frame linearly, and the sum of squares exceeds its minimum, at g0, by
        ``(g - g0)^T H (g - g0)``. The weight on turns that uses the room up is found by bisection.
        """
        first, turns = least[self.values :], np.diag(np.where(self._turns, 1.0, 0.0))
        if not first[self._turns].any() or room <= 0:
            return least
        curved = np.linalg.inv(self._steered[self.values :])

        def at(weight: float) -> tuple[Array, float]:
            away = np.linalg.solve(curved + weight * turns, curved @ first) - first
            return away, float(away @ curved @ away)

        if np.isinf(room):
            return np.asarray(least + self._steered @ (curved @ at(MOST_TURN_WEIGHT)[0]), np.float64)
        low, high = -12.0, float(np.log10(MOST_TURN_WEIGHT))
        for _ in range(40):
            middle = (low + high) / 2
            low, high = (middle, high) if at(10**middle)[1] <= room else (low, middle)
        return np.asarray(least + self._steered @ (curved @ at(10**low)[0]), np.float64)

    def moves(self) -> csr_matrix | None:
        """Basis (size, m) of departures from least squares, on coarser grids; None: any departure."""
        from scipy.sparse import block_diag, csr_matrix, diags, identity

        coarse = [self._coarse(t) for t in self.terms]
        if all(c == t.grids for c, t in zip(coarse, self.terms, strict=True)):
            return None
        parts = [hats(c, nodes(t.grids)) if c else identity(1) for c, t in zip(coarse, self.terms, strict=True)]
        frame = csr_matrix((len(self.scale) - self.values, 0))
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


@dataclass
class Designs:
    """What the states of one machine share; designs and columns are made anew where the poses are others.

    Attributes
    ----------
    states : how many there are.
    rank : of the structure of tables that the first state decided for; None before.
    """

    states: int = 1
    rank: int | None = None
    poses: Sample | None = None
    columns: dict[Term, csr_matrix] = field(default_factory=dict)
    designs: dict[tuple[Term, ...], Design] = field(default_factory=dict)

    def column(self, controller: Controller, setup: Setup, term: Term, sample: Sample) -> csr_matrix:
        """(3 n, size): motion of the tip along x, then y, then z, per unit of each value."""
        self._of(sample)
        if term not in self.columns:
            self.columns[term] = _column(controller, setup, term, sample)
        return self.columns[term]

    def design(self, controller: Controller, setup: Setup, terms: Sequence[Term], sample: Sample) -> Design:
        key = tuple(terms)
        columns = {t: self.column(controller, setup, t, sample) for t in terms}
        if key not in self.designs:
            self.designs[key] = Design.of(controller, setup, columns, sample)
        return self.designs[key]

    def _of(self, sample: Sample) -> None:
        if self.poses is sample:
            return
        if self.poses is None or not self.poses.moves_as(sample):
            self.columns, self.designs = {}, {}
        self.poses = sample


def _column(controller: Controller, setup: Setup, term: Term, sample: Sample) -> csr_matrix:
    """(3 n, size): motion of the tip along x, then y, then z, per unit of each value."""
    from scipy.sparse import csr_matrix, vstack

    weights = term.weights(setup, sample.q, sample.direction)
    tip = np.einsum("nim,nm->ni", sample.motion, controller.influence(setup, term.output, sample.q))
    tip = np.repeat(tip, np.diff(weights.indptr), axis=0)
    parts = [csr_matrix((weights.data * tip[:, k], weights.indices, weights.indptr), weights.shape) for k in range(3)]
    return csr_matrix(vstack(parts))


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


def kink_count(term: Term) -> int:
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
