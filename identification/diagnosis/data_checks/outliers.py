"""Gross outliers: rows whose distance exceeds a quantile of the noise distribution, found round by round."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from errormodel.arrays import Array, Mask
from errormodel.surveys.observations import observed
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog
from identification.estimation.result import Fit

GROSS = 10.0  # standard deviations of one component: Gaussian noise never gets there, knees and local defects rarely
MOST = 0.15  # of the rows: more is not a handful of accidents; of all squares: one row that holds more is one
# degrees of freedom of Student's noise; the last is Gaussian
TAILS = (2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 12.0, 30.0, 1000.0)
NEARLY = 2.0  # log-likelihood by which a heavier tail may be less likely
CHANCE = 0.02  # rows of a survey that noise with such tails throws as far as what is called gross


def gross_rows(fit: Fit, log: DecisionLog = UNRECORDED) -> Mask:
    """Mask (n,) of rows whose residual vector is longer than the noise, with the tails it has, ever makes one."""
    gross = _gross(fit, fit.residuals, log)
    if fit.readings is not None:
        names = observed(fit.survey.table)
        for label in fit.survey.observations:  # each has a noise of its own
            own = np.where(names == label, fit.readings.fitted, np.nan)
            gross |= _gross(fit, own[:, None], log)
    return gross


def masked_rows(fit: Fit, robust: Callable[[], Fit | None], log: DecisionLog = UNRECORDED) -> Mask:
    """Mask (n,) of gross rows that pull the fit so far that none stands out: those far from a `robust` fit.

    It is asked for where one row holds a share of all squared residuals that only accidents have.
    """
    square = np.nansum(np.square(fit.residuals), axis=1)
    if not square.max(initial=0.0) > MOST * square.sum() or (other := robust()) is None or other.sorting is None:
        return np.zeros(len(square), dtype=bool)
    return _gross(other, other.sorting.residuals, log)


def _gross(fit: Fit, residuals: Array, log: DecisionLog) -> Mask:
    """The same of residuals (n, k), NaN where not measured: three coordinates, or one reading, of the same noise."""
    measured = np.isfinite(residuals).sum(axis=1)
    seen = measured > 0
    if not seen.any():
        return np.zeros(len(seen), dtype=bool)
    square = np.nansum(np.square(residuals), axis=1)[seen] / measured[seen]
    gross: Mask = np.zeros_like(seen)
    farthest = _farthest(square, round(float(measured[seen].mean())))
    gross[seen] = square > farthest
    few = gross.sum() <= MOST * seen.sum()
    for row, far in zip(fit.survey.table["row"].to_numpy()[gross], square[gross[seen]], strict=True):
        log.add("gross-outlier", "found", f"row {row}", 1e3 * float(np.sqrt(far)), 1e3 * float(np.sqrt(farthest)))
    if not gross.any():
        largest = 1e3 * float(np.sqrt(square.max()))
        log.add("gross-outlier", "passed", "rows", largest, 1e3 * float(np.sqrt(farthest)))
    if not few:
        log.add("outlier-share", "refused", "rows", float(gross.sum() / seen.sum()), MOST)
    return gross if few else np.zeros_like(gross)


def _farthest(square: Array, components: int) -> float:
    """The largest mean square of a row's components that its noise explains, by the squares (n,) of all rows.

    The noise is a Student's: its size is that of the median, its tail the heaviest that suits the rows not far out.
    """
    from scipy.special import betainc, betaincinv, betaln

    k, middle = components, max(float(np.median(square)), 1e-18)

    def quantile(free: Array, p: float | Array) -> Array:
        """Of the ratio F of `k` and `free` degrees of freedom; `p` from above."""
        share = betaincinv(free / 2, k / 2, p)
        return np.asarray(free / k * (1 - share) / share)

    free = np.array(TAILS)
    size = middle / quantile(free, 0.5)
    gaussian = float(size[-1])
    least = GROSS**2 / k * gaussian
    near = square[square < least]
    x = np.maximum(near, 1e-12 * middle)[:, None] / size
    density = (k / 2 - 1) * np.log(x) - (k + free) / 2 * np.log1p(k * x / free)
    density += k / 2 * np.log(k / free) - betaln(k / 2, free / 2) - np.log(size)
    edge = least / size
    inside = np.log(betainc(k / 2, free / 2, k * edge / (k * edge + free)))
    likelihood = density.sum(axis=0) - len(near) * inside
    heaviest = int(np.argmax(likelihood > likelihood.max() - NEARLY))
    tail = size[heaviest] * quantile(free[heaviest], CHANCE / len(square))
    return max(least, float(tail))
