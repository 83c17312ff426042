"""What the machines of a type have in common, and other types have not: a fault of the design, not of a machine."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import comb
from typing import TYPE_CHECKING, Any

import numpy as np

from identification.fleets.collecting import Entry
from identification.fleets.false_alarms import adjusted
from identification.fleets.partial_pooling import Normal
from identification.monitoring.quantities import Watched

if TYPE_CHECKING:
    import pandas as pd

CONFIDENCE = 0.95  # of intervals of a rate
COMMON_SHARE = 0.5  # of the machines of a type, above which an effect is called common
SAME_SIGN = 0.95  # share of the machines of a type that have an error of one sign, from which it is called common
COLUMNS = (
    "type", "kind", "name", "symbol", "where", "machines", "of", "rate", "low", "high", "mean", "mean_std", "unit",
    "size_um", "others", "p", "q", "special", "common",
)  # fmt: skip


@dataclass(frozen=True)
class Shown:
    """An effect at a place in the surveys of one machine; without an effect a machine that was diagnosed.

    Attributes
    ----------
    machine : number among those of its type.
    surveys, of : in how many of how many surveys.
    p : chance that noise alone shows it in so many of them.
    size_um : median over the surveys that show it.
    statement : of the survey in which it is largest.
    """

    machine: int
    effect: str = ""
    where: str = ""
    surveys: int = 0
    of: int = 0
    p: float = 1.0
    size_um: float = 0.0
    statement: str = ""

    @property
    def shown(self) -> bool:
        """Whether at least half of the surveys show it: one that comes and goes may be the survey's."""
        return 2 * self.surveys >= self.of


def own_findings(machines: Sequence[Sequence[Entry]]) -> Iterator[Shown]:
    """Effects that each machine's surveys show, of a fleet that was diagnosed.

    The p-value is of the least significant survey of half of them: at least r of n surveys below p by chance has at
    most the probability C(n, r) p^r.
    """
    for number, entries in enumerate(machines):
        if not all("findings" in (e.data or {}) and "rms_um" in (e.data or {}) for e in entries):
            continue  # not diagnosed: alarms of `monitor` are no effects
        yield Shown(number, of=len(entries))
        places: dict[tuple[str, str], list[dict[str, Any]]] = {}
        for e in entries:
            seen = set()
            for f in e.findings:
                key = (str(f["effect"]), str(f["where"]))
                if key not in seen:
                    places.setdefault(key, []).append(dict(f))
                seen.add(key)
        half = -(-len(entries) // 2)
        for (effect, where), found in places.items():
            p = sorted(float(f["p_value"]) for f in found)
            chance = min(1.0, comb(len(entries), half) * p[half - 1] ** half) if len(p) >= half else 1.0
            largest = max(found, key=lambda f: float(f["size_um"]))
            size = float(np.median([float(f["size_um"]) for f in found]))
            yield Shown(number, effect, where, len(found), len(entries), chance, size, str(largest["statement"]))


def common_effects(types: Sequence[tuple[str, int, Sequence[Shown]]], rate: float) -> pd.DataFrame:
    """How often an effect at a place is shown by the machines of a type, and by those of the others at any place.

    The interval of the rate is Jeffreys' (Brown, Cai and DasGupta, 2001), the comparison Fisher's exact test, of one
    side.

    Parameters
    ----------
    types : name, number of machines with results, and what they show.

    Returns
    -------
    DataFrame
        ``common``: more than half of the machines have it, surely; ``special``: more than of the other types.
    """
    import pandas as pd
    from scipy.special import betaincinv
    from scipy.stats import hypergeom

    rows = []
    diagnosed = {name: len({s.machine for s in shown}) for name, _, shown in types}
    by_effect = {
        name: {
            e: {s.machine for s in shown if s.effect == e and s.shown} for e in {s.effect for s in shown if s.effect}
        }
        for name, _, shown in types
    }
    for name, _, shown in types:
        n = diagnosed[name]
        places = dict.fromkeys((s.effect, s.where) for s in shown if s.effect and s.shown)
        for effect, where in places:
            own = [s for s in shown if s.effect == effect and s.where == where and s.shown]
            k = len(own)
            low, high = (
                float(betaincinv(k + 0.5, n - k + 0.5, x)) for x in ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2)
            )
            others = sum(d for other, d in diagnosed.items() if other != name)
            have = sum(len(found.get(effect, ())) for other, found in by_effect.items() if other != name)
            p = float(hypergeom.sf(k - 1, n + others, k + have, n)) if others else float("nan")
            rows.append(
                {"type": name, "kind": "effect", "name": effect, "symbol": "", "where": where, "machines": k, "of": n,
                 "rate": k / n, "low": low, "high": high, "mean": np.nan, "mean_std": np.nan, "unit": "",
                 "size_um": float(np.median([s.size_um for s in own])),
                 "others": have / others if others else np.nan, "p": p}
            )  # fmt: skip
    table = pd.DataFrame(rows, columns=[c for c in COLUMNS if c not in ("q", "special", "common")])
    table["q"] = adjusted(table["p"].to_numpy(dtype=float))
    table["special"] = table["q"] <= rate
    table["common"] = table["low"] > COMMON_SHARE
    return table[list(COLUMNS)]


def common_parameters(
    types: Sequence[tuple[str, Sequence[tuple[Watched, Normal, float]]]], rate: float
) -> pd.DataFrame:
    """Errors whose mean over the machines of a type is not zero, and is so large that nearly all have its sign.

    Parameters
    ----------
    types : name, and of each quantity what is normal and how far it moves the tool (mm per unit).
    """
    import pandas as pd
    from scipy.special import ndtr

    means: dict[tuple[str, str], dict[str, float]] = {}
    for name, quantities in types:
        for w, level, _ in quantities:
            means.setdefault((w.id, w.unit), {})[name] = level.mean
    rows = []
    for name, quantities in types:
        for w, level, moves in quantities:
            if not w.members or not np.isfinite(level.p_mean):
                continue
            others = [m for other, m in means[w.id, w.unit].items() if other != name]
            n = len(level.kept)
            sign = float(ndtr(abs(level.mean) / level.spread)) if level.spread > 0 else 1.0
            rows.append(
                {"type": name, "kind": "parameter", "name": w.id, "symbol": w.symbol, "where": "", "machines": n,
                 "of": n, "rate": sign, "low": np.nan, "high": np.nan, "mean": level.mean, "mean_std": level.mean_std,
                 "unit": w.unit, "size_um": 1e3 * abs(level.mean) * moves,
                 "others": float(np.mean(others)) if others else np.nan, "p": level.p_mean}
            )  # fmt: skip
    table = pd.DataFrame(rows, columns=[c for c in COLUMNS if c not in ("q", "special", "common")])
    table["q"] = adjusted(table["p"].to_numpy(dtype=float))
    table["special"] = False  # parameters of one name may be other things in machines of another type
    table["common"] = (table["q"] <= rate) & (table["rate"] >= SAME_SIGN)
    return table[list(COLUMNS)]
