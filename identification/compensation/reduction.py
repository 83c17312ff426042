"""Reduction of the error model to a controller's tables: minimax error at nearly the least-squares residual.

The tables are linear in their values: at a pose the tip's error is ``e + J c(v) - G g``, with ``c`` the correction of
the axes, ``J`` the motion of the tip per unit of each and ``G g`` a small rigid motion of the workpiece's frame, which
is free. Least squares give the smallest root mean square error of the structure; among tables close to it that keep
the format's slopes, a second-order cone programme (CVXPY) finds those with the smallest maximum error. The maximum
alone is not minimised: where a structure can remove little, it would cost much mean square for one pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.base import Controller
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Table, Tables, Term
from identification.compensation.designs import MOST_CONE_VALUES, Design, Designs, kink_count
from identification.compensation.minimax import Slopes, least_worst
from identification.compensation.sample import Sample, framed
from identification.compensation.selection import strongest

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

GIVEN_UP_SHARE = 0.02  # of the removable RMS error, permitted as loss for a smaller maximum; by judgement
STILL_SHARE = 0.02  # of the removable RMS error, permitted as loss for a smaller turn of the frame; by judgement
MOST_RMS_INCREASE = 0.05  # of the least-squares residual RMS: upper bound of that loss; by judgement
MOST_WORK = 1e6  # rows times unknowns of all programmes of a command, some 3 s of CPU, shared by the states
IDLE_TABLE_SHARE = 1e-3  # of the largest table's RMS effect: smaller tables are left out; by judgement


def reduce(
    controller: Controller,
    setup: Setup,
    terms: Sequence[Term],
    sample: Sample,
    most_tables: int | None = None,
    designs: Designs | None = None,
) -> Tables:
    """Fit the tables of given terms to a sample of the volume; tables without effect are left out.

    Parameters
    ----------
    controller, setup : the format, and the machine as its axes.
    terms : structure: output, inputs and grids of each table.
    sample : poses with their errors.
    most_tables : number of tables that the format takes at most; the ones with the largest effect are kept.
    designs : what other states of the machine with the same poses have in common; None: nothing.
    """
    designs = designs or Designs()
    while True:
        task = _Task.of(designs.design(controller, setup, terms, sample), sample, setup.aligned)
        values = task.split(task.least)
        columns = [designs.column(controller, setup, t, sample) for t in terms]
        moved = [_moves(c, v, sample.frame) for c, v in zip(columns, values, strict=True)]
        keep = [k for k, m in enumerate(moved) if m > IDLE_TABLE_SHARE * max(moved)]
        if most_tables is not None and len(keep) > most_tables:
            keep = sorted(sorted(keep, key=lambda k: -moved[k])[:most_tables])
        if setup.most_tables is not None and controller.used(terms) > setup.most_tables:
            keep = strongest(task.design, task.errors, setup.most_tables, controller.used, setup.aligned)
        if len(keep) == len(terms) or not keep:
            return tuple(
                Table(t, v) for t, v in zip(terms, task.split(task.best(MOST_WORK / designs.states)), strict=True)
            )
        terms = [terms[k] for k in keep]


def aligned(controller: Controller, setup: Setup, tables: Tables, designs: Designs) -> Tables | None:
    """Tables like these by least squares in a frame that does not turn; None: these were no reduction."""
    terms = tuple(t.term for t in tables)
    if designs.poses is None or terms not in designs.designs:
        return None
    task = _Task.of(designs.designs[terms], designs.poses, aligned=True)
    return tuple(Table(t, v) for t, v in zip(terms, task.split(task.least), strict=True))


def leftover(
    controller: Controller, setup: Setup, tables: Tables, sample: Sample, designs: Designs | None = None
) -> float:
    """Largest residual error (mm) over a sample, to first order and after the best-fit frame."""
    left, designs = sample.errors.copy(), designs or Designs()
    for table in tables:
        left += (designs.column(controller, setup, table.term, sample) @ table.values.ravel()).reshape(3, -1).T
    return float(np.linalg.norm(framed(left, sample.frame), axis=1).max())


def _moves(column: csr_matrix, values: Array, frame: Array) -> float:
    """RMS effect of a table at the tip beyond any motion of the frame, mm."""
    return float(np.sqrt(np.mean(np.square(framed((column @ values.ravel()).reshape(3, -1).T, frame)))))


@dataclass(frozen=True)
class _Task:
    """One reduction in scaled values: the residual is ``errors + design.matrix @ x``.

    Attributes
    ----------
    errors : (3 n,) in multiples of `unit` (mm), after the best-fit frame.
    before : root of the sum of squares without tables, after the best-fit frame.
    aligned : whether the frame must not turn.
    """

    design: Design
    errors: Array
    before: float
    unit: float
    aligned: bool = False

    @classmethod
    def of(cls, design: Design, sample: Sample, aligned: bool = False) -> _Task:
        # the frame starts where the errors are least: its motion is then what the tables turn and shift
        errors = framed(sample.errors, sample.frame)
        unit = float(np.sqrt(np.mean(np.square(errors)))) or 1.0
        return cls(design, errors.T.ravel() / unit, float(np.linalg.norm(errors)) / unit, unit, aligned)

    def split(self, x: Array) -> list[Array]:
        """Values of each term in mm or deg, in the shape of its grid."""
        terms = self.design.terms
        parts = np.split(self.unit * self.design.scale * x, np.cumsum([t.size for t in terms]))
        return [p.reshape(t.shape) for p, t in zip(parts, terms, strict=False)]

    @cached_property
    def least(self) -> Array:
        """Least-squares solution with the equality constraints, or one nearly as good that turns the frame less."""
        least = self.design.least(self.errors)
        return self.design.stillest(least, np.inf if self.aligned else self._room(least, STILL_SHARE))

    def best(self, work: float) -> Array:
        """Minimax solution within the permitted loss of mean square, and within some `work` of the programmes."""
        if len(self.least) > MOST_CONE_VALUES:
            return self.least
        from scipy.sparse import csr_matrix, vstack

        slopes, bends = self.design.slopes, self._bends()
        limits = Slopes(
            csr_matrix(vstack([slopes.rows, bends.rows])), np.concatenate([slopes.bounds / self.unit, bends.bounds])
        )
        ball = replace(self.design.ball, start=self.least)
        return least_worst(self.design.matrix, self.errors, ball, limits, self._room, work)

    def _bends(self) -> Slopes:
        """Second differences of curves over one axis, none larger than the curve's largest by least squares.

        Otherwise a curve would run away in its last interval for the sake of one pose in a corner, and that value would
        hold beyond.
        """
        kinks = self.design.kinks
        now, start = np.abs(kinks @ self.least), 0
        rows, bounds = list[int](), list[float]()
        for term in self.design.terms:
            count = kink_count(term)
            if len(term.grids) == 1 and count:
                rows += range(start, start + count)
                bounds += [float(now[start : start + count].max())] * count
            start += count
        return Slopes(kinks[rows], np.array(bounds))

    def _room(self, x: Array, share: float | None = None) -> float:
        """Permitted increase of the sum of squares over that of `x`, the least-squares solution within the slopes.

        `share` : of the removable RMS error that may be lost; None: `GIVEN_UP_SHARE`.
        """
        least = float(np.linalg.norm(self.errors + self.design.matrix @ x))
        given = min(
            (GIVEN_UP_SHARE if share is None else share) * max(self.before - least, 0.0), MOST_RMS_INCREASE * least
        )
        return (least + given) ** 2 - least**2
