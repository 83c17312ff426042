"""Noise that is correlated from row to row: white plus first-order, and what it does to standard uncertainties.

Moving air and a drifting instrument give neighbouring rows much of the same error. Least squares still estimates
without bias, but what varies slowly along the survey (a frame, a zero, a rarely moved joint) is known less well than
independent rows would make it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from errormodel.arrays import Array
from identification.fit.least_squares import Solution
from identification.problem import Problem
from identification.sums import design_rows, view_vector
from identification.views import PositionView

LENGTHS = (2.0, 6.0, 20.0, 60.0, 200.0)  # rows over which the correlation falls to 1/e
PARTS = (0.1, 0.4, 1.5, 6.0)  # variance of the correlated part, in variances of the white one
CLEAR = 8.0  # nats by which correlated noise must be likelier than white
MOST = 20_000_000  # numbers of M held at a time: longer surveys are judged by as many rows from their middle


@dataclass(frozen=True)
class Noise:
    """White noise of variance 1 and first-order noise of variance `part`, correlated over `length` rows.

    Their sum is an ARMA(1,1) process, whose innovations are a filter of two coefficients. Series are rows in order.
    """

    length: float
    part: float

    @property
    def kept(self) -> float:
        """Of the correlated part, from row to row."""
        return float(np.exp(-1 / self.length))

    def whitened(self, columns: Array, edges: Array) -> Array:
        """Innovations of series (k, N) between `edges`, to one common variance; what lies behind the last stays."""
        from scipy.signal import lfilter

        phi = self.kept
        ratio = phi / (1 + phi**2 + self.part * (1 - phi**2))  # theta / (1 + theta^2), from the first autocovariance
        theta = (1 - np.sqrt(1 - 4 * ratio**2)) / (2 * ratio)
        first = np.sqrt(phi / theta / (1 + self.part))  # the first row has the process' whole variance
        out = columns.copy()
        for a, b in pairwise(edges):
            out[:, a:b] = lfilter([1.0, -phi], [1.0, -theta], columns[:, a:b], axis=1)
            out[:, a] *= first
        return out

    def spread(self, columns: Array, edges: Array) -> Array:
        """Covariance matrix of the noise, of unit variance, times series (k, N)."""
        from scipy.signal import lfilter

        out = columns / (1 + self.part)
        for a, b in pairwise(edges):
            before = lfilter([1.0], [1.0, -self.kept], columns[:, a:b], axis=1)
            after = lfilter([1.0], [1.0, -self.kept], columns[:, a:b][:, ::-1], axis=1)[:, ::-1]
            out[:, a:b] += self.part / (1 + self.part) * (before + after - columns[:, a:b])
        return out


def noises() -> Iterator[Noise]:
    """The grid over which the noise is fitted."""
    return (Noise(length, part) for length, part in product(LENGTHS, PARTS))


def likeliest(residual: Array, edges: Array) -> Noise | None:
    """The noise that a residual (N,) shows, or None where it is white."""
    values: list[tuple[float, Noise | None]] = [(len(residual) / 2 * float(np.log(residual @ residual)), None)]
    for noise in noises():
        white = noise.whitened(residual[None], edges)[0]
        values.append((CLEAR + len(residual) / 2 * float(np.log(white @ white)), noise))
    return min(values, key=lambda v: v[0])[1]


def correlated(problem: Problem, solution: Solution) -> tuple[Solution, Noise | None]:
    """The solution with the covariance that its residuals' correlation along the rows leaves, and that noise."""
    views = [v for v in problem.views if isinstance(v, PositionView)]
    base, place = solution.groups.base, problem.place()
    rows = sum(len(v) for v in views)
    if rows < 30 or not len(base):
        return solution, None
    share = min(1.0, MOST / (3 * rows * len(problem.unknowns)))
    level, zero = solution.sigma["position"], np.zeros(len(problem.chain.ids))
    designs, residuals, edges = [], [], [0]
    for whole in views:
        middle, half = len(whole) / 2, share * len(whole) / 2
        view = whole.part(slice(int(middle - half), max(int(middle + half), 1)))
        vector = view_vector(view, place, solution.values, zero)
        gap = np.hstack([view.whiten(part, g) for part, g in view.gaps(vector)])
        residuals.append(gap.ravel() / level)
        designs.append(design_rows(view, place, most=len(view))[:, base] / level)
        edges += [edges[-1] + k * len(view) for k in (1, 2, 3)]
    residual = np.concatenate(residuals)
    noise = likeliest(residual, np.array(edges))
    if noise is None:
        return solution, None
    design = np.vstack(designs).T
    extra = (design @ noise.spread(design, np.array(edges)).T - design @ design.T) / share
    covariance = solution.covariance + solution.covariance @ extra @ solution.covariance
    return replace(solution, covariance=(covariance + covariance.T) / 2), noise
