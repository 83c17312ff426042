"""Hierarchical Gaussian model of one quantity over the machines of one type: random effects, partially pooled.

A survey j of a machine i gives y_ij = theta_i + e_ij with theta_i ~ N(mean, spread^2) over the machines and
e_ij ~ N(0, std_ij^2 + within^2): the standard uncertainty of the fit, and what else changes between two surveys of one
machine. This is the random-effects model of meta-analysis (DerSimonian and Laird, 1986):

- within: generalised Q statistic within machines (Paule and Mandel, 1982; DerSimonian and Kacker, 2007).
- spread: restricted maximum likelihood (REML; Viechtbauer, 2005), its interval by the Q profile (Viechtbauer, 2007).
- a machine: the posterior mean, mean + (y_i - mean) spread^2 / (spread^2 + v_i), in closed form.

Machines that are not normal would widen what is normal. So both variances begin with an estimate that half of the
machines may spoil: the value at which the median of the machines' chi-squared probabilities is one half. Machines
beyond that are left out of the mean and the spread, and taken in again where these reach them. Where one or two
machines only have several surveys, no median helps; but surveys of one scatter no more than those of all machines do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import MAD_STD, Array, Index, Mask

LEAST_MACHINES = 5  # of which a spread is known well enough to call another one out; by judgement
FEW_MACHINES = 20  # up to which each is compared with an estimate without it; of more, it hardly matters
LEAST_DATES = 3  # surveys at dates of their own, from which on a trend leaves something to judge scatter by
# chance that any of the machines of a type is left out of what is normal though it belongs there, for one quantity
LEFT_OUT = 0.05
MOST_ROUNDS = 20  # in which machines are left out and taken in again; it settles in two or three
ROUND_OFF = 1e-12  # of the largest variance: smaller ones are zero


@dataclass(frozen=True)
class Normal:
    """What is normal of a type, and where each of n machines stands to it.

    Attributes
    ----------
    mean, mean_std : of the machines, and its standard uncertainty.
    spread : standard deviation of the machines about the mean; `low`, `high`: its 95 % interval.
    kept : (n,) machines that this was learned from.
    pooled, pooled_std : (n,) posterior mean of each machine's own value and its standard uncertainty.
    t, p : (n,) how far the machine is from the others, in standard deviations of a prediction from them, and the
        two-sided p-value of that (Student's t); NaN where there are too few machines.
    """

    mean: float
    mean_std: float
    spread: float
    low: float
    high: float
    kept: Mask
    pooled: Array
    pooled_std: Array
    t: Array
    p: Array

    @property
    def freedom(self) -> int:
        return int(self.kept.sum()) - 1

    @property
    def p_mean(self) -> float:
        """Two-sided p-value of a mean of zero."""
        from scipy.special import stdtr

        if self.freedom < 1 or not self.mean_std > 0:
            return float("nan")
        return float(2 * stdtr(self.freedom, -abs(self.mean) / self.mean_std))


def normal(values: Array, variances: Array) -> Normal:
    """The model over n machines from one value each.

    Parameters
    ----------
    values, variances : (n,) of each machine, the variance being that of the estimate alone.
    """
    from scipy.special import ndtri, stdtr

    n = len(values)
    kept = np.ones(n, dtype=bool)
    if n >= LEAST_MACHINES:
        far = float(-ndtri(LEFT_OUT / (2 * n)))
        middle, square = _robust(values, variances)
        kept = np.abs(values - middle) <= far * np.sqrt(variances + square)
    for _ in range(MOST_ROUNDS):
        square = reml(values[kept], variances[kept])
        mean, mean_variance = _mean(values[kept], variances[kept], square)
        t, freedom = _away(values, variances, square, mean, mean_variance, kept)
        p = 2 * stdtr(freedom, -np.abs(t))
        again = kept | (p > LEFT_OUT / n)
        if n < LEAST_MACHINES or (again == kept).all():
            break
        kept = again
    known = n >= LEAST_MACHINES
    share = square / (square + variances) if square > 0 else np.zeros(n)
    # what is known of a machine: its own value and the others, and of the others how well mean and spread are known
    pooled_variance = share * variances + (1 - share) ** 2 * mean_variance
    pooled_variance += np.square(values - mean) * _share_variance(variances, square, kept)
    low, high = q_profile(values[kept], variances[kept])
    return Normal(
        mean, float(np.sqrt(mean_variance)), float(np.sqrt(square)), low, high, kept, mean + share * (values - mean),
        np.sqrt(pooled_variance), t if known else np.full(n, np.nan), p if known else np.full(n, np.nan),
    )  # fmt: skip


def reml(values: Array, variances: Array) -> float:
    """Variance between machines by restricted maximum likelihood; 0 where the machines scatter less than expected."""
    if len(values) < 2:
        return 0.0

    def slope(square: float) -> float:
        w = 1 / (variances + square)
        total = w.sum()
        mean = (w * values).sum() / total
        return float(np.sum(np.square(w * (values - mean))) - total + np.sum(w**2) / total)

    return _root(slope, values, variances)


def _share_variance(variances: Array, square: float, kept: Mask) -> Array:
    """Variance of spread^2 / (spread^2 + v), as the spread is estimated (Kass and Steffey, 1989).

    That of the spread's square is the inverse of the information of REML. A share lies between 0 and 1.
    """
    w = 1 / (variances[kept] + square)
    total = w.sum()
    information = 0.5 * (np.sum(w**2) - 2 * np.sum(w**3) / total + (np.sum(w**2) / total) ** 2)
    if not information > 0:
        return np.ones(len(variances))
    return np.asarray(np.minimum(np.square(variances / (variances + square) ** 2) / information, 1.0))


def q_profile(values: Array, variances: Array, chance: float = 0.05) -> tuple[float, float]:
    """Interval of the standard deviation between machines: where the Q statistic is at the ends of its distribution."""
    from scipy.special import chdtri

    freedom = len(values) - 1
    if freedom < 1:
        return float("nan"), float("nan")

    def q(square: float) -> float:
        w = 1 / (variances + square)
        return float(np.sum(w * np.square(values - (w * values).sum() / w.sum())))

    low, high = (chdtri(freedom, share) for share in (chance / 2, 1 - chance / 2))
    ends = [_root(lambda s, end=end: q(s) - float(end), values, variances) for end in (low, high)]  # type: ignore[misc]
    return float(np.sqrt(ends[0])), float(np.sqrt(ends[1]))


def _mean(values: Array, variances: Array, square: float) -> tuple[float, float]:
    w = 1 / (variances + square)
    return float((w * values).sum() / w.sum()), float(1 / w.sum())


def _away(
    values: Array, variances: Array, square: float, mean: float, mean_variance: float, kept: Mask
) -> tuple[Array, Array]:
    """Deviation of each machine from what the kept others let expect, in Student's t, and its degrees of freedom.

    Of a kept one it is the deleted residual: mean and spread are those of the others. Of few machines they are
    estimated without it; of many its own share is taken away again, exact where all machines are known equally well.
    """
    n = int(kept.sum())
    whole = variances + square
    if 2 < n <= FEW_MACHINES:
        t = (values - mean) / np.sqrt(whole + mean_variance)
        for k in np.flatnonzero(kept):
            others = kept.copy()
            others[k] = False
            apart = reml(values[others], variances[others])
            centre, uncertain = _mean(values[others], variances[others], apart)
            t[k] = (values[k] - centre) / np.sqrt(variances[k] + apart + uncertain)
        return t, np.where(kept, n - 2, n - 1).astype(float)
    r2 = np.square(values - mean) / np.where(kept, np.maximum(whole - mean_variance, ROUND_OFF * whole), 1.0)
    inside = np.sign(values - mean) * np.sqrt(r2 * max(n - 2, 1) / np.maximum(n - 1 - r2, 1e-3))
    outside = (values - mean) / np.sqrt(whole + mean_variance)
    freedom = np.where(kept, max(n - 2, 1), max(n - 1, 1)).astype(float)
    return np.where(kept, inside, outside), freedom


def _robust(values: Array, variances: Array) -> tuple[float, float]:
    """Mean and variance between machines that half of the machines may spoil."""

    def gap(square: float) -> float:
        middle = weighted_median(values, 1 / (variances + square))
        return _half(np.square(values - middle) / (variances + square), np.ones(len(values)))

    square = _root(gap, values, variances)
    return weighted_median(values, 1 / (variances + square)), square


def _half(q: Array, freedom: Array) -> float:
    """By how much the median of chi-squared probabilities exceeds one half."""
    from scipy.special import chdtr

    return float(np.median(chdtr(freedom, q))) - 0.5


def weighted_median(values: Array, weights: Array) -> float:
    """Value that half of the weight lies below."""
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(reached, 0.5 * reached[-1])])


def _root(excess: Callable[[float], float], values: Array, variances: Array) -> float:
    """Variance at which a falling function is zero; 0 where it is below from the start."""
    from scipy.optimize import brentq

    least = ROUND_OFF * float(max(np.square(values - np.median(values)).max(), variances.max(), 1e-300))
    if excess(least) <= 0:
        return 0.0
    high = float(np.square(values - np.median(values)).max() + variances.max())
    while excess(high) > 0:
        high *= 4
    return float(brentq(excess, least, high, xtol=least, rtol=1e-12))


@dataclass(frozen=True)
class Surveys:
    """Values of one quantity from N surveys of n machines.

    Attributes
    ----------
    values, variances : (N,)
    machine : (N,) number of the machine, 0 to n - 1, of which each has a survey.
    date : (N,) years, NaN where there is none.
    """

    values: Array
    variances: Array
    machine: Index
    date: Array

    @property
    def count(self) -> int:
        return int(self.machine.max()) + 1

    def total(self, numbers: Array) -> Array:
        """(n,) sums over the surveys of each machine."""
        return np.bincount(self.machine, numbers, self.count).astype(np.float64)


@dataclass(frozen=True)
class PerMachine:
    """Level and trend of n machines.

    Attributes
    ----------
    within : standard deviation between surveys of one machine beyond their uncertainty; NaN where no machine shows it.
    values, variances : (n,) level: weighted mean of the surveys.
    trends, trend_variances : (n,) change a year; NaN where a machine has no two dates.
    p_scatter : (n,) p-value of so much scatter of a machine's surveys about its level or trend; 1 where none is seen.
    stretch : (n,) factor of the standard uncertainty of a machine whose surveys scatter more than those of others
        (Birge ratio); 1 of all others. Variances are without it: what scatters is compared with what is normal.
    shown : machines that `within` was learned from.
    """

    within: float
    values: Array
    variances: Array
    trends: Array
    trend_variances: Array
    p_scatter: Array
    stretch: Array
    shown: int


def per_machine(surveys: Surveys, odd: Mask | None = None) -> PerMachine:
    """Level and trend of each machine, and how much surveys of one machine differ.

    Parameters
    ----------
    odd : (n,) machines that say nothing of how much surveys of a normal machine differ; None: not known yet, and the
        estimate is one that half of the machines may spoil.
    """
    first = _fitted(surveys, 0.0)
    freedom = first.freedom
    shown = (freedom > 0) if odd is None else (freedom > 0) & ~odd
    square = float("nan")
    if shown.any():

        def gap(square: float) -> float:
            q = _fitted(surveys, square).q[shown]
            return _half(q, freedom[shown]) if odd is None else float(q.sum() - freedom[shown].sum())

        square = _root(gap, surveys.values, surveys.variances)
        if surveys.count >= LEAST_MACHINES:  # it is no larger than the scatter of all about the middle of the type
            whole = MAD_STD * np.median(np.abs(surveys.values - np.median(surveys.values)))
            square = min(square, float(whole) ** 2)
    done = _fitted(surveys, 0.0 if np.isnan(square) else square)
    from scipy.special import chdtrc

    p = np.where(freedom > 0, chdtrc(np.maximum(freedom, 1), done.q), 1.0)
    return PerMachine(
        float(np.sqrt(square)), done.values, done.variances, done.trends, done.trend_variances, p,
        np.where(p < LEFT_OUT / len(p), np.sqrt(np.maximum(done.q, freedom) / np.maximum(freedom, 1)), 1.0),
        int(shown.sum()),
    )  # fmt: skip


def apart(surveys: Surveys, each: PerMachine, level: Normal) -> Array:
    """P-value (N,) of each survey's distance from both its machine's other surveys and the type (Student's t).

    1 where the machine has no other survey, or where its surveys lie about a level or trend as those of others do.
    """
    from scipy.special import stdtr

    s, n = surveys, surveys.count
    if n < LEAST_MACHINES:
        return np.ones(len(s.values))
    variances = s.variances + (0.0 if np.isnan(each.within) else each.within**2)
    w = 1 / variances
    rest = s.total(w)[s.machine] - w
    alone = rest < ROUND_OFF * w
    rest = np.where(alone, 1.0, rest)
    others = (s.total(w * s.values)[s.machine] - w * s.values) / rest
    t = np.minimum(
        np.abs(s.values - others) / np.sqrt(variances + 1 / rest),
        np.abs(s.values - level.mean) / np.sqrt(variances + level.spread**2 + level.mean_std**2),
    )
    known = ~alone & (each.p_scatter < LEFT_OUT / n)[s.machine]
    return np.where(known, 2 * stdtr(max(level.freedom, 1), -t), 1.0)


@dataclass(frozen=True)
class _Fitted:
    values: Array
    variances: Array
    trends: Array
    trend_variances: Array
    q: Array
    freedom: Array


def _fitted(surveys: Surveys, square: float) -> _Fitted:
    """A constant, and where there are two dates a line, through the surveys of each machine."""
    s, w = surveys, 1 / (surveys.variances + square)
    total = s.total(w)
    level = s.total(w * s.values) / total
    dated = np.isfinite(s.date)
    wd = np.where(dated, w, 0.0)
    date = np.where(dated, s.date, 0.0)
    weight = np.maximum(s.total(wd), 1e-300)
    centre, middle = s.total(wd * date) / weight, s.total(wd * s.values) / weight
    t = np.where(dated, date - centre[s.machine], 0.0)
    gain = s.total(wd * t**2)
    has = gain > 1e-9 * weight  # a few minutes
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.where(has, s.total(wd * t * (s.values - middle[s.machine])) / gain, np.nan)
        slope_variance = np.where(has, 1 / gain, np.nan)
    dates = s.total(dated.astype(float))
    bent = has & (dates >= LEAST_DATES) & (dates == s.total(np.ones(len(t))))  # all its surveys are dated
    left = s.values - level[s.machine] - np.where(bent, np.nan_to_num(slope), 0.0)[s.machine] * t
    freedom = s.total(np.ones(len(t))) - 1 - bent
    return _Fitted(level, 1 / total, slope, slope_variance, s.total(w * left**2), freedom)
