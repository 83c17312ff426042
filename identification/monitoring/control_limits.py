"""Control charts of monitored quantities: prediction intervals, a joint distance, and a drift chart.

The first and the last are exact for independent, normally distributed scatter between cycles, whatever their number;
the second is approximate, with a margin. The false alarm rate is divided: half to single quantities (Bonferroni),
a quarter to drift, a twentieth to the joint distance.

- Single quantity: prediction interval of the next value, Student's t with the degrees of freedom of the cycles; it is
  widened where the new cycle is more uncertain than the earlier ones.
- Joint distance: Mahalanobis distance in the covariance of the fits, relative to that of the cycles among themselves.
  With fewer cycles than quantities Hotelling's T^2 has no inverse; the ratio then follows F with the degrees of
  freedom that the cycles span (A. P. Dempster, 1958, with the conservative estimate).
- Drift: exponentially weighted moving average of each cycle's deviation from those before it, transformed to standard
  normal values (self-starting scheme of D. M. Hawkins, 1987), which needs no known mean or scatter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Mask
from identification.monitoring.quantities import Cycle

MIN_CYCLES = 3  # earlier cycles that a range needs: two degrees of freedom
USEFUL_CYCLES = 10  # earlier cycles: with fewer the t quantiles are wide; by judgement
FALSE_ALARM_RATE = 0.01  # false alarms per cycle, all charts together; convention
RATE_SHARES = {"range": 0.5, "drift": 0.25, "together": 0.05}  # their sum is below 1, since the joint F is approximate
EWMA_WEIGHT = 0.2  # weight of the newest cycle in the moving average; usual for such charts (0.05 to 0.25)
MOST_DRIFT_STEP = 4.0  # standard deviations: a cycle's contribution to the drift is clipped here, against outliers
LEAST_SPREAD = 1e-30  # any unit: avoids division by zero for values without scatter and uncertainty
RANK_TOLERANCE = 1e-9  # of the largest eigenvalue of a correlation matrix: smaller ones are linear dependences
LEAST_SCATTER_RATIO = 0.1  # scatter over standard uncertainty: smaller scatter is chance, or values without noise


@dataclass(frozen=True)
class Judged:
    """Control chart values of one cycle with k quantities.

    Attributes
    ----------
    count : (k,) earlier cycles that show the quantity.
    mean, low, high : (k,) the range; NaN while it is being learned.
    reach : (k,) distance of the value from the mean, as a share of the distance to the limit.
    p : (k,) two-sided p-value of the value, times the number of quantities tested (Bonferroni).
    drift, drift_limit : (k,) moving average in its standard deviations, and its limit.
    together : p-value of the joint distance, NaN where it is not defined.
    share : (k,) contributions to the joint distance, 0 to 1, with sum 1.
    rate : false alarms per cycle, all charts together.
    """

    count: Array
    mean: Array
    low: Array
    high: Array
    reach: Array
    p: Array
    drift: Array
    drift_limit: float
    together: float
    share: Array
    rate: float

    @property
    def learning(self) -> bool:
        return not np.isfinite(self.p).any()

    @property
    def p_limit(self) -> float:
        return RATE_SHARES["range"] * self.rate

    @property
    def together_limit(self) -> float:
        return RATE_SHARES["together"] * self.rate

    @property
    def beyond(self) -> Mask:
        """(k,) quantities outside their prediction interval."""
        return np.asarray(self.p < self.p_limit)

    @property
    def drifting(self) -> Mask:
        """(k,) quantities whose moving average is beyond its limit."""
        return np.asarray(np.abs(self.drift) > self.drift_limit)

    @property
    def flagged(self) -> Mask:
        """(k,) quantities in alarm by themselves."""
        return self.beyond | self.drifting

    @property
    def together_beyond(self) -> bool:
        return bool(self.together < self.together_limit)

    @property
    def alarm(self) -> bool:
        return bool(self.flagged.any() or self.together_beyond)


def judge(normal: list[Cycle], new: Cycle, rate: float = FALSE_ALARM_RATE) -> Judged:
    """Compute the charts of a new cycle.

    Parameters
    ----------
    normal : earlier cycles of the normal range, in the order of measurement.
    new : the cycle to be tested.
    rate : false alarms per cycle, all charts together.
    """
    from scipy.special import ndtri, stdtr, stdtrit

    past = _Past(len(new.values))
    for cycle in normal:
        past.learn(cycle)
    count, std = past.count.copy(), new.std
    looked = (count >= MIN_CYCLES) & np.isfinite(new.values)
    many, freedom = max(int(looked.sum()), 1), np.maximum(count - 1, 1)
    mean, spread = (np.where(looked, v, np.nan) for v in (past.mean, past.spread(std)))
    t = np.abs(new.values - mean) / spread
    half: Array = -spread * stdtrit(freedom, RATE_SHARES["range"] * rate / (2 * many))
    p = np.minimum(many * 2 * stdtr(freedom, -t), 1.0)
    past.learn(new)
    drift = np.where(looked, past.drift, np.nan)
    limit = float(-ndtri(RATE_SHARES["drift"] * rate / (2 * many)))
    together, share = _together(normal, new, looked & (count == len(normal)))
    low, high, reach = mean - half, mean + half, np.abs(new.values - mean) / half
    return Judged(count, mean, low, high, reach, p, drift, limit, together, share, rate)


class _Past:
    """Running mean, sum of squares and moving average of k quantities over the earlier cycles."""

    def __init__(self, k: int) -> None:
        self.count, self.mean, self.square, self.known = (np.zeros(k) for _ in range(4))
        self.state, self.variance = np.zeros(k), np.zeros(k)

    def spread(self, std: Array) -> Array:
        """(k,) standard deviation of the next value about the mean, if its standard uncertainty is `std`."""
        variance = np.maximum(self.square / np.maximum(self.count - 1, 1), LEAST_SCATTER_RATIO**2 * self.known)
        more = np.maximum(np.square(std) - self.known, 0.0)
        return np.asarray(np.sqrt(variance * (1 + 1 / np.maximum(self.count, 1)) + more) + LEAST_SPREAD)

    @property
    def drift(self) -> Array:
        """(k,) moving average of each cycle's deviation from those before it, in its own standard deviations."""
        return self.state / np.sqrt(np.where(self.variance > 0, self.variance, np.nan))

    def learn(self, cycle: Cycle) -> None:
        from scipy.special import ndtri, stdtr

        values, std, seen = cycle.values, cycle.std, np.isfinite(cycle.values)
        known = seen & (self.count >= 2)
        t = (values - self.mean)[known] / self.spread(std)[known]
        # the standard normal value of the same probability
        normal = -np.sign(t) * ndtri(stdtr(self.count[known] - 1, -np.abs(t)))
        surprise = EWMA_WEIGHT * np.clip(normal, -MOST_DRIFT_STEP, MOST_DRIFT_STEP)
        self.state[known] = (1 - EWMA_WEIGHT) * self.state[known] + surprise
        self.variance[known] = (1 - EWMA_WEIGHT) ** 2 * self.variance[known] + EWMA_WEIGHT**2
        self.count[seen] += 1
        step = (values - self.mean)[seen]
        self.mean[seen] += step / self.count[seen]
        self.square[seen] += step * (values - self.mean)[seen]
        self.known[seen] += (np.square(std[seen]) - self.known[seen]) / self.count[seen]


def _together(normal: list[Cycle], new: Cycle, which: Mask) -> tuple[float, Array]:
    """P-value of the joint distance of the new cycle, and the contribution of each quantity to it (k,)."""
    from scipy.special import fdtrc

    share = np.zeros(len(which))
    n = len(normal)
    if n < MIN_CYCLES or not which.any():
        return float("nan"), share
    pick = np.ix_(which, which)
    shape = np.mean([c.covariance[pick] for c in normal], axis=0)
    scale = np.sqrt(np.diag(shape))
    # the pseudo-inverse leaves out linearly dependent directions
    metric = np.linalg.pinv(shape / np.outer(scale, scale), rcond=RANK_TOLERANCE, hermitian=True) / np.outer(
        scale, scale
    )
    worse = max(float(np.trace(metric @ new.covariance[pick])) / float(np.trace(metric @ shape)), 1.0)
    values = np.array([c.values[which] for c in normal])
    centred = values - values.mean(axis=0)
    away = new.values[which] - values.mean(axis=0)
    among = centred @ metric @ centred.T  # (n, n)
    total = max(float(np.trace(among)), LEAST_SCATTER_RATIO**2 * (n - 1) * float(np.trace(metric @ shape)))
    freedom = float(np.clip(total**2 / max(float(np.sum(among**2)), 1e-300), 1.0, which.sum()))
    ratio = float(away @ metric @ away) / (1 + 1 / n) / worse / (total / (n - 1))
    share[which] = _shares(shape / np.outer(scale, scale), away / scale)
    return float(fdtrc(freedom, freedom * (n - 1), ratio)), share


def _shares(correlation: Array, away: Array) -> Array:
    """Contributions of k quantities to a quadratic form, none below 0, with sum 1.

    Squares of the deviations after the decorrelating transformation that changes them least (P. H. Garthwaite & I.
    Koch, "Evaluating the contributions of individual variables to a quadratic form", 2016).
    """
    sizes, directions = np.linalg.eigh(correlation)
    seen = sizes > RANK_TOLERANCE * sizes.max()
    root = directions[:, seen] / np.sqrt(sizes[seen]) @ directions[:, seen].T
    parts = np.square(root @ away)
    return np.asarray(parts / parts.sum() if parts.any() else parts)
