"""Many tests of many machines, with the share of false ones among those that are found held below a rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index, Mask


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


@dataclass(frozen=True)
class Selected:
    """Which of n groups of tests hold something, and which of their tests.

    Attributes
    ----------
    p, q : (n,) p-value of each group (Bonferroni within it), and adjusted over the groups; NaN without tests.
    found : (n,) groups.
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
    rate : largest expected share of false ones among the groups found.
    """
    known = np.isfinite(p)
    count = np.bincount(group[known], minlength=groups)
    least = np.full(groups, np.inf)
    np.minimum.at(least, group[known], p[known])
    whole = np.where(count > 0, np.minimum(np.where(count > 0, least, 1.0) * count, 1.0), np.nan)
    q = adjusted(whole)
    found = np.nan_to_num(q, nan=1.0) <= rate
    share = found.sum() / max(int((count > 0).sum()), 1)
    limit = rate * share / np.maximum(count, 1)
    tests = known & found[group] & (np.nan_to_num(p, nan=1.0) <= limit[group])
    return Selected(whole, q, found, tests)
