"""Gross outliers: rows whose distance exceeds a quantile of the noise distribution, found round by round.

Where all that has a cause is explained, smaller ones are told from heavy tails too (`contaminated_noise`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from errormodel.arrays import Array, Mask
from errormodel.surveys.observations import observed
from identification.diagnosis.data_checks.contaminated_noise import (
    TAILS,
    contaminated,
    log_student,
    quantile_of_student,
)
from identification.diagnosis.decisions.constants import DECISIVE_ODDS, LEAST_EVIDENCE
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog
from identification.estimation.result import Fit, turned_residuals
from identification.observation.models import PositionView

GROSS = 10.0  # standard deviations of one component: Gaussian noise never gets there, knees and local defects rarely
MOST = 0.15  # of the rows: more is not a handful of accidents; of all squares: one row that holds more is one
NEARLY = 2.0  # log-likelihood by which a heavier tail may be less likely
FEWEST = 50  # rows that show a distribution
MOST_USED = 5000  # rows of which the distribution is taken: more take time
CHANCE = 0.02  # rows of a survey that noise with such tails throws as far as what is called gross


def gross_rows(fit: Fit, log: DecisionLog = UNRECORDED, *, earlier: Mask | None = None) -> Mask:
    """Mask (n,) of rows whose residual vector is longer than the noise, with the tails it has, ever makes one.

    Parameters
    ----------
    earlier : outliers that were left out before all that has a cause was in the fit, as it is now: then rows that
        contaminate normal noise are outliers too. That some do is a new finding only where there were none.
    """
    least = np.inf if earlier is None else np.log(DECISIVE_ODDS) if earlier.any() else LEAST_EVIDENCE
    gross = _gross(fit, of_one_noise(fit, fit.residuals), log, least)
    if fit.readings is not None:
        names = observed(fit.survey.table)
        for label in fit.survey.observations:  # each has a noise of its own
            own = np.where(names == label, fit.readings.fitted, np.nan)
            gross |= _gross(fit, own[:, None], log, least)
    return gross | gross_orientations(fit, log, least=least)


def gross_orientations(fit: Fit, log: DecisionLog = UNRECORDED, *, least: float = np.inf) -> Mask:
    """The same of measured orientations; `least` as of `_gross`."""
    if fit.sigma_rad is None:
        return np.zeros(fit.rows, dtype=bool)
    return _gross(fit, turned_residuals(fit), log, least, "orientation of row", 1e6)


def far_turned(fit: Fit, bad: Mask) -> str:
    """Beside how far the points of some rows lie, how far their orientations do, where these are gross."""
    turned = bad & gross_orientations(fit)
    if not turned.any():
        return ""
    return f" and {1e6 * np.linalg.norm(turned_residuals(fit)[turned], axis=1).max():.0f} urad"


def masked_rows(fit: Fit, robust: Callable[[], Fit | None], log: DecisionLog = UNRECORDED) -> Mask:
    """Mask (n,) of gross rows that pull the fit so far that none stands out: those far from a `robust` fit.

    It is asked for where one row holds a share of all squared residuals that only accidents have.
    """
    square = np.nansum(np.square(of_one_noise(fit, fit.residuals)), axis=1)
    if not square.max(initial=0.0) > MOST * square.sum() or (other := robust()) is None or other.sorting is None:
        return np.zeros(len(square), dtype=bool)
    return _gross(other, of_one_noise(other, other.sorting.residuals), log)


def of_one_noise(fit: Fit, residuals: Array) -> Array:
    """Residuals of positions (n, 3), mm, as of one noise: each in its declared uncertainty, times the mean one.

    What is less certain than the rest (far from a tracker, along its angles) is no tail of the noise.
    """
    out = residuals.copy()
    for view in fit.problem.views:
        if isinstance(view, PositionView):
            own, weight = np.nan_to_num(residuals[view.index]), view.whitener
            white = own * weight[:, None] if weight.ndim == 1 else np.einsum("mij,mj->mi", weight, own)
            out[view.index] = white * (fit.sigma_mm / fit.solution.sigma[view.kind])
    return np.where(np.isnan(residuals), np.nan, out)


def mean_squares(residuals: Array) -> tuple[Mask, Array, int]:
    """Rows (n,) of residuals (n, k) that were measured, the mean squares of their components, and the usual number."""
    measured = np.isfinite(residuals).sum(axis=1)
    seen = measured > 0
    square = np.nansum(np.square(residuals), axis=1)[seen] / measured[seen]
    return seen, square, round(float(measured[seen].mean())) if seen.any() else 0


def _gross(
    fit: Fit, residuals: Array, log: DecisionLog, least: float = np.inf, name: str = "row", shown: float = 1e3
) -> Mask:
    """The same of residuals (n, k), NaN where not measured: three components, or one reading, of the same noise.

    `least`: log likelihood ratio of contaminated normal noise against one of heavy tails from which rows that
    contaminate it are gross; `name`, `shown`: what the log calls a row, and the factor of its numbers.
    """
    seen, square, components = mean_squares(residuals)
    if not seen.any():
        return np.zeros(len(seen), dtype=bool)
    gross: Mask = np.zeros_like(seen)
    farthest = _farthest(square, components, len(square))
    near = residuals[seen][square < _least(square, components)]
    single = np.square(near[np.isfinite(near)])  # the components of a row may have tails each for itself
    if len(single):
        farthest = max(farthest, _farthest(single[:: len(single) // MOST_USED + 1], 1, len(single)) / components)
    if np.isfinite(least) and len(square) > FEWEST:
        lead, edge = contaminated(square[:: len(square) // MOST_USED + 1], components)  # evenly over the survey
        log.add("contaminated-noise", "found" if lead > least else "passed", "rows", lead, least)
        farthest = min(farthest, edge) if lead > least else farthest
    gross[seen] = square > farthest
    few = gross.sum() <= MOST * seen.sum()
    for row, far in zip(fit.survey.table["row"].to_numpy()[gross], square[gross[seen]], strict=True):
        log.add(
            "gross-outlier", "found", f"{name} {row}", shown * float(np.sqrt(far)), shown * float(np.sqrt(farthest))
        )
    if not gross.any():
        largest = shown * float(np.sqrt(square.max()))
        log.add("gross-outlier", "passed", f"{name}s", largest, shown * float(np.sqrt(farthest)))
    if not few:
        log.add("outlier-share", "refused", "rows", float(gross.sum() / seen.sum()), MOST)
    return gross if few else np.zeros_like(gross)


def _least(square: Array, components: int) -> float:
    """The mean square of so many components that Gaussian noise whose median is that of the squares never has."""
    middle = max(float(np.median(square)), 1e-18)
    return GROSS**2 / components * middle / float(quantile_of_student(np.array(TAILS[-1]), 0.5, components))


def _farthest(square: Array, components: int, number: int) -> float:
    """The largest mean square of so many components that the noise explains in a `number` of them, by squares (n,).

    The noise is a Student's: its size is that of the median, its tail the heaviest that suits the rows not far out.
    """
    from scipy.special import betainc

    k, middle = components, max(float(np.median(square)), 1e-18)
    free = np.array(TAILS)
    size = middle / quantile_of_student(free, 0.5, k)
    least = _least(square, k)
    near = square[square < least]
    x = np.maximum(near, 1e-12 * middle)[:, None] / size
    edge = least / size
    inside = np.log(betainc(k / 2, free / 2, k * edge / (k * edge + free)))
    likelihood = (log_student(x, free, k) - np.log(size)).sum(axis=0) - len(near) * inside
    heaviest = int(np.argmax(likelihood > likelihood.max() - NEARLY))
    tail = size[heaviest] * quantile_of_student(free[heaviest], CHANCE / number, k)
    return max(least, float(tail))
