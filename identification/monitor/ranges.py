"""Whether a new cycle lies within what earlier ones taught: one quantity, all together, and slowly adding up.

Each test is exact, or errs towards silence, for any scatter between cycles, however few they are. The rate of false
alarms is shared out: half to single quantities (Bonferroni over them), a quarter to all together, a quarter to drift.

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
from identification.monitor.watched import Cycle

FEWEST = 3  # earlier cycles: fewer span no range
RATE = 0.01  # false alarms a cycle, in all
SHARES = {"range": 0.5, "together": 0.25, "drift": 0.25}
MEMORY = 0.2  # weight of the newest cycle in the weighted mean
FURTHEST = 4.0  # normal deviations that one cycle can add to a drift: an outlier is none
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
    share : (k,) of the distance of all together.
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
    def beyond(self) -> Mask:
        """(k,) quantities out of their range."""
        return np.asarray(self.p < SHARES["range"] * self.rate)

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
        return bool(self.together < SHARES["together"] * self.rate)

    @property
    def alarm(self) -> bool:
        return bool(self.flagged.any() or self.together_beyond)


def judge(normal: list[Cycle], new: Cycle, rate: float = RATE) -> Judged:
    """Look at a new cycle beside the `normal` ones, which are in the order in which they were measured."""
    from scipy import stats

    k = len(new.values)
    values = np.array([c.values for c in normal]).reshape(-1, k)
    stds = np.array([c.std for c in normal]).reshape(-1, k)
    seen = np.isfinite(values)
    count = seen.sum(axis=0)
    looked = (count >= FEWEST) & np.isfinite(new.values)
    many = max(int(looked.sum()), 1)
    mean, spread = np.full(k, np.nan), np.full(k, np.nan)
    for j in np.flatnonzero(looked):
        mean[j], spread[j] = _range(values[seen[:, j], j], stds[seen[:, j], j], new.std[j])
    with np.errstate(invalid="ignore"):
        t = (new.values - mean) / spread
        p = np.minimum(many * 2 * stats.t.sf(np.abs(t), np.maximum(count - 1, 1)), 1.0)
        half = spread * stats.t.isf(SHARES["range"] * rate / (2 * many), np.maximum(count - 1, 1))
    drift = np.full(k, np.nan)
    for j in np.flatnonzero(looked):
        drift[j] = _drift(np.append(values[seen[:, j], j], new.values[j]), np.append(stds[seen[:, j], j], new.std[j]))
    limit = float(stats.norm.isf(SHARES["drift"] * rate / (2 * many)))
    together, share = _together(normal, values, new, looked & (count == len(normal)))
    reach = np.abs(new.values - mean) / half
    return Judged(count, mean, mean - half, mean + half, reach, p, drift, limit, together, share, rate)


def _range(values: Array, stds: Array, std: float) -> tuple[float, float]:
    """Mean of a quantity's earlier values (n,), and the standard deviation of the next one about it."""
    n, known = len(values), float(np.mean(np.square(stds)))
    variance = max(float(np.var(values, ddof=1)), FINEST**2 * known)
    return float(np.mean(values)), float(np.sqrt(variance * (1 + 1 / n) + max(std**2 - known, 0.0)))


def _drift(values: Array, stds: Array) -> float:
    """The weighted mean of the cycles' deviations from those before them, in its own standard deviations."""
    from scipy import stats

    state = variance = 0.0
    for n in range(2, len(values)):
        mean, spread = _range(values[:n], stds[:n], stds[n])
        t = (values[n] - mean) / spread
        normal = float(np.sign(t) * stats.norm.isf(stats.t.sf(abs(t), n - 1)))
        state = (1 - MEMORY) * state + MEMORY * float(np.clip(normal, -FURTHEST, FURTHEST))
        variance = (1 - MEMORY) ** 2 * variance + MEMORY**2
    return state / float(np.sqrt(variance)) if variance else float("nan")


def _together(normal: list[Cycle], values: Array, new: Cycle, which: Mask) -> tuple[float, Array]:
    """Probability of a distance as large as the new cycle's, and each quantity's share of it (k,)."""
    from scipy import stats

    share = np.zeros(len(which))
    n = len(normal)
    if n < FEWEST or not which.any():
        return float("nan"), share
    pick = np.ix_(which, which)
    shape = np.mean([c.covariance[pick] for c in normal], axis=0)
    scale = np.sqrt(np.diag(shape))
    # what the fits hold for linearly dependent is one direction, not a division by zero
    metric = np.linalg.pinv(shape / np.outer(scale, scale), rcond=1e-9, hermitian=True) / np.outer(scale, scale)
    worse = max(float(np.trace(metric @ new.covariance[pick])) / float(np.trace(metric @ shape)), 1.0)
    centred = values[:, which] - values[:, which].mean(axis=0)
    away = new.values[which] - values[:, which].mean(axis=0)
    parts = away * (metric @ away)
    among = centred @ metric @ centred.T  # (n, n)
    total = max(float(np.trace(among)), FINEST**2 * (n - 1) * float(np.trace(metric @ shape)))
    freedom = float(np.clip(total**2 / max(float(np.sum(among**2)), 1e-300), 1.0, which.sum()))
    ratio = float(parts.sum()) / (1 + 1 / n) / worse / (total / (n - 1))
    share[which] = parts / parts.sum() if parts.sum() else 0.0
    return float(stats.f.sf(ratio, freedom, freedom * (n - 1))), share
