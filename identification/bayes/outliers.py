"""Bayesian outlier model: a row has the common noise, or noise many times as wide, with unknown share and width.

Only rows whose residual is in the tail of the noise can change their class with the parameters; they keep their own
equations. The other rows stay in the sufficient statistics, and the mixture's correction for them, which depends on
noise level, share and width only, is computed from a histogram of their residuals. The cost of a log-probability grows
with the number of doubtful rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Mask
from identification.bayes.hyperparameters import Coordinate
from identification.bayes.statistics import RowsApart, kind_with_outliers, posed
from identification.estimation.result import Fit
from identification.observation.normal_equations import view_vector

DOUBT_TAIL_PROBABILITY = 0.01  # rows beyond this tail probability of the noise keep their own equations
GROSS_SIGMA = 4.0  # standard deviations beyond which a row counts as an outlier in the starting values
RESIDUAL_BINS = 60  # bins of equal numbers in the histogram of the other rows, for each number of components
LEAST_OUTLIER_WIDTH = 3.0  # smallest width of the outliers, in standard deviations of the noise; by judgement
WIDEST_OUTLIER_RATIO = 10.0  # largest width of the outliers over the largest residual, by judgement
FEWEST_OUTLIERS, LARGEST_OUTLIER_SHARE = 0.1, 0.5  # bounds of the prior: expected outliers; share of the rows


@dataclass(frozen=True)
class Mixture:
    """Mixture model: equations of the doubtful rows, and a histogram of the residuals of the others.

    Attributes
    ----------
    apart : rows that keep their equations.
    square, seen, number : (b,) mean squared residual, in units of the whitener, number of components, and number of
        rows of each bin of the others.
    coordinates : share of outliers, and their width in standard deviations of the noise.
    """

    apart: RowsApart
    square: Array
    seen: Array
    number: Array
    coordinates: tuple[Coordinate, Coordinate]

    def log_likelihood(self, points: Array, level: Array, extended: Array) -> Array:
        """Log-likelihood (n,) of the doubtful rows, plus the mixture's correction for the others.

        Parameters
        ----------
        points : (n, 2) natural logarithms of share and width.
        level : (n,) inverse noise variances of the kind of observation.
        extended : (n, e) extended unknowns, see `identification.bayes.statistics.Statistics`.
        """
        share, width = np.exp(points).T[:, :, None]
        gaps = self.apart.gap - np.tensordot(extended, self.apart.design, axes=(1, 2))
        distance = level[:, None] * np.einsum("nmc,nmc->nm", gaps, gaps)
        seen = self.apart.seen
        far = np.logaddexp(np.log1p(-share) - distance / 2, self._other(share, width, distance, seen))
        odds = self._other(share, width, self.square * level[:, None], self.seen)
        odds = odds - np.log1p(-share) + self.square * level[:, None] / 2
        near = np.log1p(-share[:, 0]) * self.number.sum() + np.logaddexp(0.0, odds) @ self.number
        return np.asarray(far.sum(axis=1) + near + 0.5 * np.log(level) * seen.sum())

    def probability(self, points: Array, level: Array, extended: Array) -> Array:
        """Probability (n, m) of each doubtful row to be an outlier."""
        share, width = np.exp(points).T[:, :, None]
        gaps = self.apart.gap - np.tensordot(extended, self.apart.design, axes=(1, 2))
        distance = level[:, None] * np.einsum("nmc,nmc->nm", gaps, gaps)
        other = self._other(share, width, distance, self.apart.seen)
        return np.asarray(np.exp(other - np.logaddexp(np.log1p(-share) - distance / 2, other)))

    @staticmethod
    def _other(share: Array, width: Array, distance: Array, seen: Array) -> Array:
        """Log density of being an outlier, up to the constant of the noise's density."""
        return np.asarray(np.log(share) - seen * np.log(width) - distance / (2 * width**2))


def squares_of(fit: Fit) -> tuple[Array, Array]:
    """Squared whitened residuals (rows,), NaN where there are none, and numbers of components (rows,).

    They are of positions or, without any, of the one kind of reading.
    """
    problem, kind = posed(fit, fit.chain.machine), kind_with_outliers(fit)
    square, seen = np.full(len(fit.survey), np.nan), np.zeros(len(fit.survey))
    zero = np.zeros(len(fit.chain.ids))
    for view in problem.views:
        if view.kind == kind:
            vector = view_vector(view, fit.problem.place(), fit.solution.values, zero)
            gap = np.hstack([view.whiten(part, g) for part, g in view.gaps(vector)])
            square[view.index] = np.square(gap).sum(axis=0)
            seen[view.index] = view.components.sum(axis=1)
    return square, seen


def in_doubt(square: Array, seen: Array, sigma: float) -> Mask:
    """Mask (rows,) of rows beyond the tail probability `DOUBT_TAIL_PROBABILITY` of the noise `sigma`."""
    from scipy.stats import chi2

    return np.asarray(square > sigma**2 * chi2.isf(DOUBT_TAIL_PROBABILITY, np.maximum(seen, 1)))


def _between(name: str, low: float, high: float, start: float, count: int) -> Coordinate:
    """A hyperparameter with a prior flat in the logarithm; `count` observations set the scale of its start."""
    spread = float(np.log(high / low))
    scale = min((count + 1) ** -0.5, spread / 4)
    return Coordinate(name, "1", float(np.log(np.clip(start, 1.1 * low, high / 1.1))), scale, low, high)


def mixture_of(apart: RowsApart, square: Array, seen: Array, sigma: float) -> Mixture:
    """The mixture model of a fit.

    Parameters
    ----------
    apart : equations of the doubtful rows.
    square, seen : (rows,) as :func:`squares_of` returns them.
    sigma : noise level of these rows, in units of the whitener.
    """
    own = np.isfinite(square)
    own[apart.index] = False
    order = np.argsort(square[own])
    # bins of equal numbers of rows, each with one number of components
    bins = [
        part
        for count in np.unique(seen[own])
        for part in np.array_split(order[seen[own][order] == count], RESIDUAL_BINS)
        if len(part)
    ]
    distance = (
        np.sqrt(square[np.isfinite(square)] / np.maximum(seen[np.isfinite(square)], 1)) / sigma
    )  # rms per component
    rows, gross = len(distance), distance[distance > GROSS_SIGMA]
    number = len(gross)
    share = _between(
        "outliers.share", FEWEST_OUTLIERS / (rows + 1), LARGEST_OUTLIER_SHARE, (number + 0.5) / (rows + 1), number
    )
    size = float(np.sqrt(np.mean(gross**2))) if number else np.sqrt(LEAST_OUTLIER_WIDTH * WIDEST_OUTLIER_RATIO)
    width = _between(
        "outliers.width",
        LEAST_OUTLIER_WIDTH,
        WIDEST_OUTLIER_RATIO * max(1.0, float(distance.max(initial=1.0))),
        size,
        6 * number,
    )
    return Mixture(
        apart,
        np.array([square[own][b].mean() for b in bins]),
        np.array([seen[own][b[0]] for b in bins]),
        np.array([float(len(b)) for b in bins]),
        (share, width),
    )
