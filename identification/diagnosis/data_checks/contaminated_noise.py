"""Normal noise of which a few rows are contaminated, told from noise with heavy tails by its likelihood.

J. W. Tukey, A survey of sampling from contaminated distributions, in Contributions to Probability and Statistics, 1960.
"""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array
from identification.diagnosis.decisions.constants import DECISIVE_ODDS

# degrees of freedom of Student's noise; the last is Gaussian
TAILS = (2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 12.0, 30.0, 1000.0)
SIZES = np.array([0.85, 0.92, 1.0, 1.08, 1.17])  # times the variance that the median shows
WIDER = np.array([16.0, 36.0, 81.0, 169.0])  # times its variance has a contaminated row: 4 to 13 standard deviations
SHARES = (0.005, 0.01, 0.02, 0.04)  # of the rows that are contaminated


def quantile_of_student(free: Array, p: float | Array, components: int) -> Array:
    """Of the mean square of so many components of Student's noise of unit size; `p` from above."""
    from scipy.special import betaincinv

    share = betaincinv(free / 2, components / 2, p)
    return np.asarray(free / components * (1 - share) / share)


def log_student(x: Array, free: Array, components: int) -> Array:
    """Log density of the mean square `x` of so many components of Student's noise of unit size (F distribution)."""
    from scipy.special import betaln

    k = components
    out = (k / 2 - 1) * np.log(x) - (k + free) / 2 * np.log1p(k * x / free)
    return np.asarray(out + k / 2 * np.log(k / free) - betaln(k / 2, free / 2))


def contaminated(square: Array, components: int) -> tuple[float, float]:
    """Log likelihood ratio of contaminated normal against Student's noise, and from where on a row is contaminated.

    Parameters
    ----------
    square : (n,) mean squares of the `components` of rows.

    Returns
    -------
    The ratio, of both at their best; and the mean square from which the odds of a contaminated row are decisive.
    """
    k, free = components, np.array(TAILS)
    middle = max(float(np.median(square)), 1e-18)
    square = np.maximum(square, 1e-12 * middle)
    sizes = middle / quantile_of_student(free, 0.5, k) * SIZES[:, None]  # (s, f)
    student = np.sum(log_student(square[:, None, None] / sizes, free, k) - np.log(sizes), axis=0).max()
    narrow = sizes[:, -1:]
    both = [_log_normal(square[:, None, None], size, k) for size in (narrow, narrow * WIDER)]
    every = np.array([np.logaddexp(both[0] + np.log1p(-e), both[1] + np.log(e)).sum(axis=0) for e in SHARES])
    share, size, wider = np.unravel_index(np.argmax(every), every.shape)
    ratio, part = WIDER[wider], SHARES[share]
    needed = np.log(DECISIVE_ODDS * (1 - part) / part) + k / 2 * np.log(ratio)
    return float(every.max() - student), float(2 * narrow[size, 0] / (k * (1 - 1 / ratio)) * needed)


def _log_normal(square: Array, size: Array, components: int) -> Array:
    """Log density of the mean square of so many components of normal noise with a variance, but for a constant."""
    return log_student(square / size, np.array(TAILS[-1]), components) - np.log(size)
