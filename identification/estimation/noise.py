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
from identification.estimation.least_squares import Solution
from identification.observation.assembly import Problem
from identification.observation.models import PositionView
from identification.observation.normal_equations import design_rows, view_vector

LENGTHS = (2.0, 6.0, 20.0, 60.0, 200.0)  # rows over which the correlation falls to 1/e
PARTS = (0.1, 0.4, 1.5, 6.0)  # variance of the correlated part, in variances of the white one
FEWEST = 30  # rows
ROUND_OFF = 1e-10  # of the machine: residuals below are no noise
CLEAR = 8.0  # nats by which correlated noise must be likelier than white
MOST = 4000  # rows: longer surveys are judged by as many from their middle


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

    @property
    def moving(self) -> float:
        """Coefficient of the moving average, from the first autocovariance."""
        phi = self.kept
        ratio = phi / (1 + phi**2 + self.part * (1 - phi**2))
        return float((1 - np.sqrt(1 - 4 * ratio**2)) / (2 * ratio))

    @property
    def news(self) -> float:
        """Variance of an innovation, of the whole variance."""
        return self.kept / self.moving / (1 + self.part)

    def whitened(self, columns: Array, edges: Array) -> Array:
        """Innovations of series (k, N) between `edges`, to one common variance; what lies behind the last stays."""
        out = columns.copy()
        for a, b in pairwise(edges):
            change = columns[:, a:b].copy()
            change[:, 1:] -= self.kept * columns[:, a : b - 1]
            out[:, a:b] = _recursion(change, self.moving)
            out[:, a] *= np.sqrt(self.news)  # the first row has the process' whole variance
        return out

    def spread(self, columns: Array, edges: Array) -> Array:
        """Covariance matrix of the noise, of unit variance, times series (k, N)."""
        out = columns / (1 + self.part)
        for a, b in pairwise(edges):
            before = _recursion(columns[:, a:b], self.kept)
            after = _recursion(columns[:, a:b][:, ::-1], self.kept)[:, ::-1]
            out[:, a:b] += self.part / (1 + self.part) * (before + after - columns[:, a:b])
        return out


def _recursion(series: Array, kept: float) -> Array:
    """``y[k] = kept y[k-1] + x[k]`` along series (k, n), as a bidiagonal system."""
    from scipy.linalg.lapack import dtbtrs

    bands = np.vstack([np.ones(series.shape[1]), np.full(series.shape[1], -kept)])
    solved, _ = dtbtrs(bands, series.T, uplo="L", diag="U")
    return np.asarray(solved).T


def noises() -> Iterator[Noise]:
    """The grid over which the noise is fitted."""
    return (Noise(length, part) for length, part in product(LENGTHS, PARTS))


def likeliest(residual: Array, design: Array, edges: Array) -> tuple[Noise | None, float]:
    """The noise that the residual (N,) of a fit of columns (p, N) shows, None where it is white; and its variance.

    By restricted likelihood: what varies slowly has gone into the parameters, and is missing from the residual.
    """
    free = len(residual) - len(design)
    square = float(residual @ residual)
    best, least, variance = None, np.inf, square / free
    for noise in (None, *noises()):
        both = np.vstack([design, residual])
        both = both if noise is None else noise.whitened(both, edges)
        triangle = np.abs(np.diag(np.linalg.qr(both.T, mode="r")))
        minus = free * float(np.log(triangle[-1])) + float(np.log(triangle[:-1]).sum())
        # beforehand, any scale of length is as likely as any other: one as long as the run hardly shows in residuals
        minus += 0.0 if noise is None else CLEAR + float(np.log(noise.length))
        if minus < least:
            news = 1.0 if noise is None else noise.news
            # beyond the grid the innovations say too little: never less than the residual itself
            best, least, variance = noise, minus, max(float(triangle[-1]) ** 2 / news, square) / free
    return best, variance


def _uneven(residual: Array) -> bool:
    """Whether means of neighbouring rows scatter more than independent rows' would: else nothing need be fitted."""
    for size in (4, 16, 64):
        means = residual[: len(residual) // size * size].reshape(-1, size).mean(axis=1)
        if len(means) > 3 and size * np.var(means) > np.var(residual) * (1 + 2.5 * np.sqrt(2 / len(means))):
            return True
    return False


def correlated(problem: Problem, solution: Solution) -> tuple[Solution, Noise | None]:
    """The solution with the covariance that its residuals' correlation along the rows leaves, and that noise."""
    views = [v for v in problem.views if isinstance(v, PositionView)]
    base, place = solution.groups.base, problem.place()
    rows = sum(len(v) for v in views)
    if rows < FEWEST or not len(base) or solution.sigma["position"] < ROUND_OFF * problem.chain.size:
        return solution, None
    share = min(1.0, MOST / rows)
    level, zero = solution.sigma["position"], np.zeros(len(problem.chain.ids))
    parts, residuals, edges = [], [], [0]
    for whole in views:
        middle, half = len(whole) / 2, share * len(whole) / 2
        view = whole.part(slice(int(middle - half), max(int(middle + half), 1)))
        vector = view_vector(view, place, solution.values, zero)
        gap = np.hstack([view.whiten(part, g) for part, g in view.gaps(vector)])
        seen = np.abs(gap).max(axis=1, initial=0.0) > 0  # components that were measured
        residuals.append(gap[seen].ravel() / (level * np.sqrt(solution.kept)))
        parts.append((view, np.repeat(seen, len(view))))
        edges += [edges[-1] + k * len(view) for k in range(1, seen.sum() + 1)]
    residual = np.concatenate(residuals)
    if not _uneven(residual):
        return solution, None
    design = np.vstack([design_rows(v, place, most=len(v))[live][:, base] / level for v, live in parts]).T
    norms = np.linalg.norm(design, axis=1)
    free = (norms > 0) & (solution.precision[base] * np.diag(solution.covariance) < 0.5)  # known by the data
    noise, variance = likeliest(residual, design[free] / norms[free, None], np.array(edges))
    if noise is None:
        return solution, None
    extra = (variance * design @ noise.spread(design, np.array(edges)).T - design @ design.T) / share
    covariance = solution.covariance + solution.covariance @ extra @ solution.covariance
    return replace(solution, covariance=(covariance + covariance.T) / 2), noise
