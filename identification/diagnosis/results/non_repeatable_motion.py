"""Non-repeatable motion (ISO 230-7): what no clock, path or sensor shows, such as a seat with two states.

A motion that takes another value in every row leaves residuals along its effect on the point, whose variance grows with
its lever squared. Its variance and that of the noise beside it are estimated by maximum likelihood. Noise of an
instrument is alike in all directions, or has one covariance for all rows; in one direction it is seldom much larger.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.conventions import FRAME, MOTIONS
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.results.resampling import CLIP, robust_scale
from identification.diagnosis.search.instrument_noise import CLEAR, FEWEST, gain_of_covariance
from identification.diagnosis.search.scoring import DETECT

LARGE = 0.5  # of the variance: an instrument that is twice as bad in one direction as in others has as much there
RATIOS = np.logspace(-2, 4, 61)  # of the variance that a motion makes in a row to that of one coordinate's noise


@dataclass(frozen=True)
class NonRepeatable:
    """A motion that varies from row to row.

    Attributes
    ----------
    element, motion : which.
    gain : log likelihood ratio to noise that is equal in all directions.
    gain_over_covariance : the same to noise of one covariance, which knows no lever.
    variance : of a row's residual (three coordinates, whitened) that the motion makes; `share` of all of it.
    tried : number of motions.
    """

    element: str
    motion: str
    gain: float
    gain_over_covariance: float
    variance: float
    share: float
    tried: int

    @property
    def p_value(self) -> float:
        """Bound of the chance that noise gains as much: one over the likelihood ratio."""
        return float(np.exp(-self.gain))


def non_repeatable_motion(
    linear: LinearModel, log: DecisionLog = UNRECORDED, left: bool = False
) -> NonRepeatable | None:
    """The motion that varies most from row to row; None where noise does as much, or rows have too few components.

    Parameters
    ----------
    left : whether it is known that the residuals are no noise: then one direction is enough.
    """
    if (found := _largest(linear)) is None:
        return None
    beside, clear = f"{found.motion} of {found.element}", found.gain > CLEAR
    log.add("non-repeatable-motion", "found" if clear else "passed", "residuals", found.gain, CLEAR, beside=beside)
    if not clear or left or found.gain_over_covariance > DETECT + np.log(found.tried):
        return found if clear else None
    large = found.share > LARGE
    log.add("non-repeatable-direction", "found" if large else "passed", "residuals", found.share, LARGE, beside=beside)
    return found if large else None


def _largest(linear: LinearModel) -> NonRepeatable | None:
    """The motion with the largest gain."""
    rows = _whole_rows(linear)
    if len(rows) < FEWEST or linear.exact:
        return None
    residual = linear.residual[rows]
    farthest = CLIP * robust_scale(residual)
    residual = np.clip(residual, -farthest, farthest)  # by coordinate: a direction of its own is not to come of tails
    levers = {
        (element, motion): lever[rows]
        for element, own in linear.levers.items()
        if element != FRAME  # how the instrument's rays turn
        for motion, lever in zip(MOTIONS, own, strict=False)
        if lever[rows].any()
    }
    if not residual.any() or not levers:
        return None
    every, names = np.array([*levers.values()]), [*levers]
    length, along = np.sum(every**2, axis=2), np.sum(every * residual, axis=2)
    whole = length.mean(axis=1, keepdims=True)
    length, along = length / whole, along / np.sqrt(whole)
    square, n = float(np.sum(residual**2)), residual.size
    left = np.array([square - np.sum(r * along**2 / (1 + r * length), axis=1) for r in RATIOS])
    gains = -n / 2 * np.log(left / square) - 0.5 * np.array([np.log1p(r * length).sum(axis=1) for r in RATIOS])
    gains *= _independent(along)
    k, j = np.unravel_index(int(gains.argmax()), gains.shape)
    ratio, gain = float(RATIOS[k]), float(gains[k, j])
    variance, share = ratio * float(left[k, j]) / n, ratio / (ratio + residual.shape[1])
    return NonRepeatable(*names[j], gain, gain - gain_of_covariance(residual), variance, share, len(names))


def independent_along_rows(linear: LinearModel, element: str, motion: str) -> float:
    """One-sided p-value of a motion that takes a value in each row of its own against one that goes on to the next.

    Products of neighbours have mean zero then, whatever their variances: their sum over the root of that of their
    squares is normal (the ratio of J. von Neumann, 1941, for unequal variances). 0 where rows have no three
    components.
    """
    from scipy.stats import norm

    rows = _whole_rows(linear)
    if len(rows) < FEWEST:
        return 0.0
    residual, lever = linear.residual[rows], linear.levers[element][MOTIONS.index(motion)][rows]
    farthest = CLIP * robust_scale(residual)
    along = np.sum(np.clip(residual, -farthest, farthest) * lever, axis=1)
    along -= along.mean()
    products = along[1:] * along[:-1]
    return float(norm.sf(products.sum() / np.sqrt(np.square(products).sum())))


def _whole_rows(linear: LinearModel) -> Index:
    """Observations (rows, 3) of each row that has three components, in the order of the rows; of a pose its position.

    A pose has six: its position comes before its orientation.
    """
    order = np.argsort(linear.index, kind="stable")
    _, first, counts = np.unique(linear.index[order], return_index=True, return_counts=True)
    whole = first[(counts == len("xyz")) | (counts == len(MOTIONS))]
    return np.asarray(order[whole[:, None] + np.arange(len("xyz"))])


def _independent(series: Array) -> Array:
    """Of series (m, n) the share of rows (m,) that are independent as to their variance, by their autocorrelation.

    What goes on from row to row is large in one direction by chance; n over 1 + 2 sum of squared correlations (M. S.
    Bartlett, 1935).
    """
    count = series.shape[1]
    whole = series - series.mean(axis=1, keepdims=True)
    spectrum = np.square(np.abs(np.fft.rfft(whole, 2 * count, axis=1)))
    own = np.fft.irfft(spectrum, axis=1)[:, : count // 4]
    squares = np.square(own[:, 1:] / np.maximum(own[:, :1], 1e-300)) - 1 / count
    return np.asarray(1 / (1 + 2 * np.maximum(squares, 0.0).sum(axis=1)))
