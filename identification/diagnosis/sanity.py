"""Gate 0: mistakes of columns, which mimic everything. A blunder is put right and reported, never explained as physics.

Each hypothesis (a sign, a unit, a swap) is a change of the table; the nominal machine is aligned to the changed table in
closed form. Geometry is small, so that the right table fits to a fraction of what a wrong one does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from errormodel.chain import Chain
from errormodel.kernel import Array
from errormodel.survey import Survey
from identification.alignment import align

if TYPE_CHECKING:
    import pandas as pd

BETTER = 4.0  # times: a mended table must fit the nominal machine this much better
SMALL = 2e-4  # of the machine's size: a nominal error below it is no blunder (0.6 mm in 3 m)
MEASURED = ["mx", "my", "mz"]


@dataclass(frozen=True)
class Blunder:
    """A mistake in the table, and the table without it."""

    where: str  # the joint, or `instrument`
    text: str
    before_um: float  # mean nominal misfit of the table as it is, and as mended
    after_um: float
    survey: Survey


@dataclass(frozen=True)
class _Change:
    where: str
    text: str
    apply: Callable[[pd.DataFrame], None]


def find_blunder(chain: Chain, survey: Survey) -> Blunder | None:
    """The most convincing blunder of a column, or None; a second one shows when the mended survey is looked at again."""
    whole = np.isfinite(survey.measured).all(axis=1)
    if whole.sum() < 8 or survey.frame == "fixed":
        return None
    rows = np.flatnonzero(whole)
    sample = survey.table.iloc[rows[np.unique(np.linspace(0, len(rows) - 1, 300).astype(int))]]
    before = _misfit(chain, sample)
    if before < SMALL * chain.size:
        return None
    tries = []
    for change in _changes(chain):
        table = sample.copy()
        change.apply(table)
        tries.append((_misfit(chain, table), change))
    after, best = min(tries, key=lambda t: t[0])
    if after > before / BETTER:
        return None
    table = survey.table.copy()
    best.apply(table)
    return Blunder(best.where, best.text, 1e3 * before, 1e3 * after, replace(survey, table=table))


def _misfit(chain: Chain, table: pd.DataFrame) -> float:
    """Median distance (mm) of measured from nominal points after the best frame of each run."""
    nominal = chain.kernel("nominal", outputs=(0, 1, 2))(chain.columns(table)).T
    measured = table[MEASURED].to_numpy(dtype=float)
    pose = align(nominal, measured)
    return float(np.median(np.linalg.norm(measured - pose.apply(nominal), axis=1)))


def _changes(chain: Chain) -> Iterator[_Change]:
    def scaled(name: str, factor: float) -> Callable[[pd.DataFrame], None]:
        def apply(table: pd.DataFrame) -> None:
            table[name] = table[name] * factor

        return apply

    def swapped(one: str, other: str) -> Callable[[pd.DataFrame], None]:
        def apply(table: pd.DataFrame) -> None:
            table[one], table[other] = table[other].copy(), table[one].copy()

        return apply

    for joint in chain.machine.joints:
        name = joint.name
        yield _Change(name, f"the sign of column {name} is wrong", scaled(name, -1.0))
        units = {"radians": np.degrees(1.0), "degrees, converted twice": np.radians(1.0)}
        if joint.type == "prismatic":
            units = {"inches": 25.4, "metres": 1000.0, "micrometres": 1e-3, "mm taken for inches": 1 / 25.4}
        for unit, factor in units.items():
            yield _Change(name, f"column {name} seems to be in {unit}", scaled(name, factor))
    for one, other in combinations(chain.machine.joints, 2):
        if one.type == other.type:
            text = f"columns {one.name} and {other.name} are swapped"
            yield _Change(one.name, text, swapped(one.name, other.name))
    for name in MEASURED:
        yield _Change("instrument", f"the sign of column {name} is wrong", scaled(name, -1.0))
        for unit, factor in {"inches": 25.4, "metres": 1000.0}.items():
            yield _Change("instrument", f"column {name} seems to be in {unit}", scaled(name, factor))
    for one, other in combinations(MEASURED, 2):
        yield _Change("instrument", f"columns {one} and {other} are swapped", swapped(one, other))


def without(survey: Survey, rows: Array) -> Survey:
    """The survey with the measured values of some rows (mask) taken out; the rows stay, for what follows in order."""
    table = survey.table.copy()
    table.loc[np.asarray(rows, dtype=bool), MEASURED] = np.nan
    return replace(survey, table=table)
