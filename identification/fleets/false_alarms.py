"""Many tests of many machines, with the share of false ones among those that are found held below a rate.

Held in the mean of many fleets (false discovery rate; Benjamini and Hochberg, 1995), a share still is above the rate in
every other fleet. So it is held in nearly every fleet, too (exceedance of the false discovery proportion).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index, Mask

CONFIDENCE = 0.95  # that the share of false ones in a fleet is below the rate, and not in the mean of fleets only


def adjusted(p: Array) -> Array:
    """P-values adjusted by Benjamini and Hochberg (1995): below a rate, the share of false ones among these is."""
    known = np.isfinite(p)
    out = np.full(len(p), np.nan)
    m = int(known.sum())
    if m:
        order = np.argsort(p[known], kind="stable")
        steps = np.minimum.accumulate((p[known][order] * m / np.arange(1, m + 1))[::-1])[::-1]
        ranked = np.empty(m)
        ranked[order] = np.minimum(steps, 1.0)
        out[known] = ranked
    return out


def surely(p: Array, rate: float) -> float:
    """Largest p-value that may be found, so that of these at most a share of `rate` is false, at `CONFIDENCE`.

    Romano and Wolf (2007, algorithm 4.1) with the bounds of Guo and Romano (2007) for independent p-values: of m true
    hypotheses, fewer than k have a p-value below the (1 - confidence) quantile of Beta(k, m - k + 1), the distribution
    of the k-th smallest. k is raised as long as k false ones among those found are no more than the share.

    Parameters
    ----------
    p : (n,) p-values, NaN where nothing was tested.
    """
    from scipy.special import betaincinv

    known = np.sort(p[np.isfinite(p)])
    limit = 0.0
    for k in range(1, len(known) + 1):
        limit = float(betaincinv(k, len(known) - k + 1, 1 - CONFIDENCE))
        if np.searchsorted(known, limit, side="right") * rate < k:
            break
    return limit


@dataclass(frozen=True)
class Selected:
    """Which of n groups of tests hold something, and which of their tests.

    Attributes
    ----------
    p, q : (n,) p-value of each group (Bonferroni within it), and adjusted over the groups; NaN without tests.
    found : (n,) groups: of those with a `p` that `surely` allows, the ones that Benjamini and Hochberg find.
    tests : (m,) tests of the groups found.
    """

    p: Array
    q: Array
    found: Mask
    tests: Mask


def selected(p: Array, group: Index, groups: int, rate: float) -> Selected:
    """Test groups of tests, then the tests of those found (Benjamini and Bogomolov, 2014).

    Tests within a group may depend on one another in any way; groups are independent given what is normal.

    Parameters
    ----------
    p, group : (m,) p-values, NaN where nothing was tested, and the number of the group of each, 0 to groups - 1.
    rate : largest share of false ones among the groups found: of the expected one, and at `CONFIDENCE` of their own.
    """
    known = np.isfinite(p)
    count = np.bincount(group[known], minlength=groups)
    least = np.full(groups, np.inf)
    np.minimum.at(least, group[known], p[known])
    whole = np.where(count > 0, np.minimum(np.where(count > 0, least, 1.0) * count, 1.0), np.nan)
    q = adjusted(whole)
    allowed = np.nan_to_num(whole, nan=1.0) <= surely(whole, rate)
    # the others stay among those that were tested, and cannot be found
    found = np.nan_to_num(adjusted(np.where(allowed | ~np.isfinite(whole), whole, 1.0)), nan=1.0) <= rate
    share = found.sum() / max(int((count > 0).sum()), 1)
    limit = rate * share / np.maximum(count, 1)
    tests = known & found[group] & (np.nan_to_num(p, nan=1.0) <= limit[group])
    return Selected(whole, q, found, tests)
