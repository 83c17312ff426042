"""Normal equations of all rows near the values at which they were summed up, without a further pass over the rows.

What is linear comes from the sums over all rows. The small rest (the second order of the kinematics, and the change of
M with the errors) comes from a sample of the rows, on which it is computed exactly, times the rows that each row of the
sample stands for. If the sample is all rows, nothing is approximate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.exceptions import InputError
from identification.estimation.least_squares import Solver, observed
from identification.estimation.scaled_equations import scaled_inverse, scaled_solve
from identification.observation.assembly import Problem, group_order
from identification.observation.identifiability import Groups
from identification.observation.models import Kind, View
from identification.observation.normal_equations import accumulate
from identification.observation.sums import Sums

KIND = "position"
FRAME_STEPS = 6  # each leaves the share of the last by which M changes, 1e-3 or less: to round-off


@dataclass(frozen=True)
class Expansion:
    """Sums of all rows at `values`, and those of a sample of them there.

    Attributes
    ----------
    shift : (unknowns,) what the frames of `views` have moved by since, as values of the frames' parameters.
    views : of the sample, its frames moved.
    """

    whole: Sums
    sample: Sums
    values: Array
    shift: Array
    views: Sequence[View]
    place: dict[str, int]
    held: Array

    @property
    def each(self) -> float:
        """Rows of the survey for each row of the sample."""
        return self.whole.count / self.sample.count

    def at(self, values: Array) -> Sums:
        """Sums of all rows at other values."""
        step = values - self.values + self.shift
        out = self.whole.moved(np.arange(len(step)), step)
        slope, square = self.rest(values, step)
        return Sums(out.gram, out.slope + slope, out.square + square, out.count)

    def rest(self, values: Array, step: Array) -> tuple[Array, float]:
        """What is not linear of the slope and of the sum of squares."""
        here = accumulate(self.views, self.place, values, self.held, gram=False)[KIND]
        linear = self.sample.moved(np.arange(len(step)), step)
        return self.each * (here.slope - linear.slope), self.each * (here.square - linear.square)

    def doubt(self, values: Array, base: Index, sigma: float) -> float:
        """Error of the solution `values` from sampling the rest, in standard uncertainties (Mahalanobis distance)."""
        if self.whole.count == self.sample.count:
            return 0.0
        slope = self.rest(values, values - self.values + self.shift)[0][base]
        step = scaled_solve(self.whole.gram[np.ix_(base, base)], slope)
        return float(np.sqrt(max(float(step @ slope), 0.0) / self.sample.count) / sigma)


class ExpandedSolver(Solver):
    """Least squares on an expansion in place of all rows; `further` are views of rows outside the sample."""

    def __init__(self, problem: Problem, beforehand: Array, expansion: Expansion, further: Sequence[View]) -> None:
        views, unknowns, declared = expansion.views, problem.unknowns, problem.declared
        super().__init__(problem.chain, views, unknowns, None, declared, True, None, beforehand)
        self.expansion, self.further, self.each = expansion, further, expansion.each

    def pass_(self, values: Array, at: Array | None, gram: bool) -> dict[Kind, Sums]:
        self.taken = values
        return {KIND: self.expansion.at(values)}

    def observed(self, thorough: bool) -> tuple[Array, Sequence[str], Array, list[int]]:
        if not self.further:
            return super().observed(thorough)
        views, held = [*self.views, *self.further], np.diag(np.sqrt(self.precision))[self.precision > 0]
        factor, unknowns, norms = observed(self.chain, views, self.unknowns, True)
        norms = np.sqrt(np.square(norms) + self.precision)
        return np.vstack([factor, held]), unknowns, norms, group_order(self.chain, self.unknowns)

    def covariance(self, groups: Groups, sums: dict[Kind, Sums]) -> Array:
        gram, _ = self.total(sums)
        return scaled_inverse(gram[np.ix_(groups.base, groups.base)])

    def by_factor(self, groups: Groups, sums: dict[Kind, Sums]) -> tuple[Array, dict[Kind, Sums], int, bool]:
        found = f"a condition number of {groups.condition:.1g}, for which sums over the rows keep too few digits"
        raise InputError("survey", found, "Declare fewer errors in machine.yaml, or leave out --stream")


def frame_sums(expansion: Expansion, columns: Sequence[int], slope: Array, square: float, count: int) -> Expansion:
    """The expansion of the frames' parameters alone at zero errors, from their own sums there.

    Parameters
    ----------
    columns : places of the frames' parameters among all unknowns.
    slope, square, count : of all rows, for these parameters in this order.
    """
    pick = np.ix_(columns, columns)
    names = {n: k for k, c in enumerate(columns) for n, place in expansion.place.items() if place == c}
    zero = np.zeros(len(columns))
    sample = accumulate(expansion.views, names, zero, expansion.held, gram=False)[KIND]
    return Expansion(
        Sums(expansion.whole.gram[pick], slope, square, count),
        Sums(expansion.sample.gram[pick], sample.slope, sample.square, sample.count),
        zero, zero, expansion.views, names, expansion.held,
    )  # fmt: skip


def best_frames(of_frames: Expansion, free: Sequence[str]) -> tuple[Array, float]:
    """Parameters of the frames that fit the machine without errors best, by `place`, and the sum of squares there."""
    values = np.zeros(len(of_frames.place))
    base = np.array([of_frames.place[name] for name in free], dtype=np.intp)
    for _ in range(FRAME_STEPS):
        sums = of_frames.at(values)
        values[base] += scaled_solve(sums.gram[np.ix_(base, base)], sums.slope[base])
    return values, of_frames.at(values).square
