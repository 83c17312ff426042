"""Doubts about error motions: runs that are copies of others, targets twice in a run."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from errormodel.conventions import MOTIONS
from errormodel.survey import Survey

if TYPE_CHECKING:
    import pandas as pd

FEWEST = 4  # targets of two runs, to compare them
BY_CHANCE = 1e-3  # probability that two runs of all are alike by rounding


def copy_notes(survey: Survey) -> Iterator[str]:
    """Notes on runs that repeat another to the last digit, and on targets that come twice in a run."""
    table = survey.table
    if "joint" not in table:
        return
    for name in dict.fromkeys(table["joint"][table["joint"] != ""]):
        own = table[table["joint"] == name]
        motions = [m for m in MOTIONS if m in own and own[m].notna().any()]
        side = f"dir_{name}"
        keys = ["file", "run", *([side] if side in own else [])]
        runs: dict[object, pd.DataFrame] = dict(iter(own.groupby(keys, sort=False)))
        yield from _twice(runs, name)
        for motion in motions:
            yield from _copied(runs, name, motion)


def _words(key: object) -> str:
    """A run by its number and side."""
    _, run, *side = key if isinstance(key, tuple) else (key,)
    return f"{run}{' ' + '-+'[side[0] > 0] if side else ''}"


def _twice(runs: dict[object, pd.DataFrame], joint: str) -> Iterator[str]:
    for key, part in runs.items():
        again = part[part[joint].duplicated()]
        others = max((len(p) - p[joint].nunique() for k, p in runs.items() if k != key), default=1)
        if len(again) and not others:  # where every run has it twice, it was measured twice
            rows = ", ".join(str(r) for r in again["row"].iloc[:3])
            yield f"run {_words(key)} of {joint} has a target twice (row {rows}), other runs once: a copy counts double"


def _copied(runs: dict[object, pd.DataFrame], joint: str, motion: str) -> Iterator[str]:
    values = {k: p.drop_duplicates(joint).set_index(joint)[motion].dropna() for k, p in runs.items()}
    alike: dict[tuple[object, object], tuple[int, int]] = {}
    for one, other in combinations(values, 2):
        both = values[one].index.intersection(values[other].index)
        if len(both) >= FEWEST:
            a, b = values[one][both].to_numpy(), values[other][both].to_numpy()
            alike[one, other] = int(np.sum(a == b)), len(both)
    whole = {pair for pair, (same, n) in alike.items() if same == n}
    rest = [(same, n) for pair, (same, n) in alike.items() if pair not in whole]
    share = (sum(s for s, _ in rest) + 1) / (sum(n for _, n in rest) + 2)
    for one, other in sorted(whole, key=str):
        n = alike[one, other][1]
        if np.ptp(values[one]) > 0 and share**n * len(alike) < BY_CHANCE:
            yield (
                f"run {_words(other)} of {joint} repeats run {_words(one)} to the last digit in all {n} targets: a "
                "copy, by which scatter comes out too small"
            )
