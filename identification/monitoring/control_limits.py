"""Whether a new cycle lies within what earlier ones taught: one quantity, all together, and slowly adding up.

The first and the last are exact for any scatter between cycles that is normal and independent, however few they are;
the second is approximate, with room left for it. The rate of false alarms is shared out: half to single quantities
(Bonferroni over them), a quarter to drift, a twentieth to all together.

- One quantity: the prediction interval of the next value, Student's t with the degrees of freedom of the cycles; a
  cycle known less well than the earlier ones has its interval widened by the difference.
- All together: the distance in the metric of the fits' own covariance, so that what is correlated counts once, over
  that of the cycles among themselves. Fewer cycles than quantities leave Hotelling's T^2 no inverse; the ratio is then
  F with as few degrees of freedom as the cycles span (A. P. Dempster, 1958, with the conservative estimate).
- Drift: an exponentially weighted mean of what each cycle was against those before it, as standard normal values
  (D. M. Hawkins' self-starting scheme, 1987), which needs no known mean or scatter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Mask
from identification.monitoring.quantities import Cycle

FEWEST = 3  # earlier cycles: fewer span no range
USEFUL = 10  # earlier cycles: fewer find only changes that are far beyond the scatter
RATE = 0.01  # false alarms a cycle, in all
SHARES = {"range": 0.5, "drift": 0.25, "together": 0.05}  # room is left: the F of all together is approximate
MEMORY = 0.2  # weight of the newest cycle in the weighted mean
FURTHEST = 4.0  # normal deviations that one cycle can add to a drift: an outlier is none
TINY = 1e-30  # of any unit: values without scatter or uncertainty divide by it
RANK = 1e-9  # of the largest eigenvalue of a correlation matrix: a smaller one is a linear dependence
FINEST = 0.1  # of its stated uncertainty: less scatter than this is luck, or values without noise


@dataclass(frozen=True)
class Judged:
    """A cycle (k quantities) beside the normal range.

    Attributes
    ----------
    count : (k,) earlier cycles that show the quantity.
    mean, low, high : (k,) the range; NaN while it is being learned.
    reach : (k,) how far the value lies from the mean, as a share of the way to the limit.
    p : (k,) two-sided, of one value by itself, times the number of quantities looked at (Bonferroni).
    drift, drift_limit : (k,) weighted mean in its standard deviations, and where the alarm begins.
    together : the same kind of probability for all at once, NaN where it cannot be said.
    share : (k,) of the distance of all together, 0 to 1, together 1.
    rate : false alarms a cycle, in all.
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
        return SHARES["range"] * self.rate

    @property
    def together_limit(self) -> float:
        return SHARES["together"] * self.rate

    @property
    def beyond(self) -> Mask:
        """(k,) quantities out of their range."""
        return np.asarray(self.p < self.p_limit)

    @property
    def drifting(self) -> Mask:
        """(k,) quantities that have moved slowly."""
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


def judge(normal: list[Cycle], new: Cycle, rate: float = RATE) -> Judged:
    """Look at a new cycle beside the `normal` ones, which are in the order in which they were measured."""
    from scipy.special import ndtri, stdtr, stdtrit

    past = _Past(len(new.values))
    for cycle in normal:
        past.learn(cycle)
    count, std = past.count.copy(), new.std
    looked = (count >= FEWEST) & np.isfinite(new.values)
    many, freedom = max(int(looked.sum()), 1), np.maximum(count - 1, 1)
    mean, spread = (np.where(looked, v, np.nan) for v in (past.mean, past.spread(std)))
    t = np.abs(new.values - mean) / spread
    half: Array = -spread * stdtrit(freedom, SHARES["range"] * rate / (2 * many))
    p = np.minimum(many * 2 * stdtr(freedom, -t), 1.0)
    past.learn(new)
    drift = np.where(looked, past.drift, np.nan)
    limit = float(-ndtri(SHARES["drift"] * rate / (2 * many)))
    together, share = _together(normal, new, looked & (count == len(normal)))
    low, high, reach = mean - half, mean + half, np.abs(new.values - mean) / half
    return Judged(count, mean, low, high, reach, p, drift, limit, together, share, rate)


class _Past:
    """What the cycles so far taught of each of k quantities: running sums, and the weighted mean of their surprises."""

    def __init__(self, k: int) -> None:
        self.count, self.mean, self.square, self.known = (np.zeros(k) for _ in range(4))
        self.state, self.variance = np.zeros(k), np.zeros(k)

    def spread(self, std: Array) -> Array:
        """(k,) standard deviation of the next value about the mean, if it is known to `std`."""
        variance = np.maximum(self.square / np.maximum(self.count - 1, 1), FINEST**2 * self.known)
        more = np.maximum(np.square(std) - self.known, 0.0)
        return np.asarray(np.sqrt(variance * (1 + 1 / np.maximum(self.count, 1)) + more) + TINY)

    @property
    def drift(self) -> Array:
        """(k,) the weighted mean of the cycles' deviations from those before them, in its own standard deviations."""
        return self.state / np.sqrt(np.where(self.variance > 0, self.variance, np.nan))

    def learn(self, cycle: Cycle) -> None:
        from scipy.special import ndtri, stdtr

        values, std, seen = cycle.values, cycle.std, np.isfinite(cycle.values)
        known = seen & (self.count >= 2)
        t = (values - self.mean)[known] / self.spread(std)[known]
        # the same chance as a standard normal value
        normal = -np.sign(t) * ndtri(stdtr(self.count[known] - 1, -np.abs(t)))
        surprise = MEMORY * np.clip(normal, -FURTHEST, FURTHEST)
        self.state[known] = (1 - MEMORY) * self.state[known] + surprise
        self.variance[known] = (1 - MEMORY) ** 2 * self.variance[known] + MEMORY**2
        self.count[seen] += 1
        step = (values - self.mean)[seen]
        self.mean[seen] += step / self.count[seen]
        self.square[seen] += step * (values - self.mean)[seen]
        self.known[seen] += (np.square(std[seen]) - self.known[seen]) / self.count[seen]


def _together(normal: list[Cycle], new: Cycle, which: Mask) -> tuple[float, Array]:
    """Probability of a distance as large as the new cycle's, and each quantity's share of it (k,)."""
    from scipy.special import fdtrc

    share = np.zeros(len(which))
    n = len(normal)
    if n < FEWEST or not which.any():
        return float("nan"), share
    pick = np.ix_(which, which)
    shape = np.mean([c.covariance[pick] for c in normal], axis=0)
    scale = np.sqrt(np.diag(shape))
    # what the fits hold for linearly dependent is one direction, not a division by zero
    metric = np.linalg.pinv(shape / np.outer(scale, scale), rcond=RANK, hermitian=True) / np.outer(scale, scale)
    worse = max(float(np.trace(metric @ new.covariance[pick])) / float(np.trace(metric @ shape)), 1.0)
    values = np.array([c.values[which] for c in normal])
    centred = values - values.mean(axis=0)
    away = new.values[which] - values.mean(axis=0)
    among = centred @ metric @ centred.T  # (n, n)
    total = max(float(np.trace(among)), FINEST**2 * (n - 1) * float(np.trace(metric @ shape)))
    freedom = float(np.clip(total**2 / max(float(np.sum(among**2)), 1e-300), 1.0, which.sum()))
    ratio = float(away @ metric @ away) / (1 + 1 / n) / worse / (total / (n - 1))
    share[which] = _shares(shape / np.outer(scale, scale), away / scale)
    return float(fdtrc(freedom, freedom * (n - 1), ratio)), share


def _shares(correlation: Array, away: Array) -> Array:
    """What each of k quantities contributes to a distance, none below 0 and together 1.

    Squares of the deviations once turned, as little as can be, into independent ones (P. H. Garthwaite & I. Koch,
    "Evaluating the contributions of individual variables to a quadratic form", 2016).
    """
    sizes, directions = np.linalg.eigh(correlation)
    seen = sizes > RANK * sizes.max()
    root = directions[:, seen] / np.sqrt(sizes[seen]) @ directions[:, seen].T
    parts = np.square(root @ away)
    return np.asarray(parts / parts.sum() if parts.any() else parts)
