"""A motion that varies from row to row: what no clock, path or sensor shows, such as a seat with two states.

A motion that takes another value in every row leaves residuals along its effect on the point, whose variance grows with
its lever squared. Its variance and that of the noise beside it are estimated by maximum likelihood. Noise of an
instrument is alike in all directions, or has one covariance for all rows; in one direction it is seldom much larger.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from errormodel.conventions import FRAME, MOTIONS
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.results.resampling import CLIP
from identification.diagnosis.search.instrument_noise import CLEAR, FEWEST, gain_of_covariance
from identification.diagnosis.search.scoring import DETECT

LARGE = 0.5  # of the variance: an instrument that is twice as bad in one direction as in others has as much there
GAUSSIAN = 0.6745  # median size of a standard normal deviate
RATIOS = np.logspace(-2, 4, 61)  # of the variance that a motion makes in a row to that of one coordinate's noise


@dataclass(frozen=True)
class Unsteady:
    """A motion that varies from row to row.

    Attributes
    ----------
    element, motion : which.
    gain : log likelihood ratio to noise that is equal in all directions.
    gain_over_covariance : the same to noise of one covariance, which knows no lever.
    variance : of a row's residual (three coordinates, whitened) that the motion makes; `share` of all of it.
    """

    element: str
    motion: str
    gain: float
    gain_over_covariance: float
    variance: float
    share: float

    @property
    def p_value(self) -> float:
        """Bound of the chance that noise gains as much: one over the likelihood ratio."""
        return float(np.exp(-self.gain))


def unsteady_motion(linear: LinearModel, log: DecisionLog = UNRECORDED, left: bool = False) -> Unsteady | None:
    """The motion that varies most from row to row; None where noise does as much, or rows have too few components.

    Parameters
    ----------
    left : whether it is known that the residuals are no noise: then one direction is enough.
    """
    found, tried = _largest(linear)
    if found is None:
        return None
    beside, clear = f"{found.motion} of {found.element}", found.gain > CLEAR
    log.add("unsteady-motion", "found" if clear else "passed", "residuals", found.gain, CLEAR, beside=beside)
    if not clear or left or found.gain_over_covariance > DETECT + np.log(tried):
        return found if clear else None
    large = found.share > LARGE
    log.add("unsteady-direction", "found" if large else "passed", "residuals", found.share, LARGE, beside=beside)
    return found if large else None


def _largest(linear: LinearModel) -> tuple[Unsteady | None, int]:
    """The motion with the largest gain, and how many were tried."""
    seen = len(linear.index)
    order = np.argsort(linear.index, kind="stable")
    _, counts = np.unique(linear.index, return_counts=True)
    rows = order[np.repeat(counts == len("xyz"), counts)].reshape(-1, len("xyz"))
    if len(rows) < FEWEST or linear.exact:
        return None, 0
    residual = linear.residual[:seen][rows]
    farthest = CLIP / GAUSSIAN * float(np.median(np.abs(residual)))
    residual = np.clip(residual, -farthest, farthest)  # by coordinate: a direction of its own is not to come of tails
    if not residual.any():
        return None, 0
    names, levers = list[tuple[str, str]](), list[Array]()
    for element, own in linear.levers.items():
        if element != FRAME:  # how the instrument's rays turn
            moving = {m: lever[:seen][rows] for m, lever in zip(MOTIONS, own, strict=False)}
            names += [(element, m) for m, lever in moving.items() if lever.any()]
            levers += [lever for lever in moving.values() if lever.any()]
    if not names:
        return None, 0
    every = np.array(levers)
    length = np.sum(every**2, axis=2)
    whole = length.mean(axis=1, keepdims=True)
    length, along = length / whole, np.sum(every * residual, axis=2) ** 2 / whole
    square, n = float(np.sum(residual**2)), residual.size
    left = np.array([square - np.sum(r * along / (1 + r * length), axis=1) for r in RATIOS])
    gains = -n / 2 * np.log(left / square) - 0.5 * np.array([np.log1p(r * length).sum(axis=1) for r in RATIOS])
    gains *= _independent(np.sum(every * residual, axis=2) / np.sqrt(whole))
    k, j = np.unravel_index(int(gains.argmax()), gains.shape)
    ratio, gain = float(RATIOS[k]), float(gains[k, j])
    share = ratio / (ratio + residual.shape[1])
    return Unsteady(*names[j], gain, gain - gain_of_covariance(residual), ratio * float(left[k, j]) / n, share), len(
        names
    )


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
