"""Gate 0: mistakes of columns, which mimic everything. A blunder is put right and reported, never explained as physics.

Each hypothesis (a sign, a unit, a swap) is a change of the table; the nominal machine is aligned to the changed table
in closed form. Geometry is small, so that the right table fits to a fraction of what a wrong one does.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Mask
from errormodel.chain import Chain
from errormodel.effects.axis_blunder import MEASURED, AxisBlunder
from errormodel.survey import Survey
from identification.alignment import align
from identification.problem import frame_labels

if TYPE_CHECKING:
    import pandas as pd

ALIKE = 1.05  # times: two changes that fit as well
BETTER = 4.0  # times: a mended table must fit the nominal machine this much better
SMALL = 2e-4  # of the machine's size: a nominal error below it is no blunder (0.6 mm in 3 m)


@dataclass(frozen=True)
class Blunder:
    """A mistake in the table, and the survey without it."""

    effect: AxisBlunder
    before_um: float  # median nominal misfit of the table as it is, and as mended
    after_um: float
    survey: Survey


def find_blunder(chain: Chain, survey: Survey) -> Blunder | None:
    """The most convincing blunder of a column, or None; a second one shows when the mended survey is looked at."""
    whole = np.isfinite(survey.measured).all(axis=1) & _one_frame(survey)
    if whole.sum() < 8 or survey.frame == "fixed":
        return None
    rows = np.flatnonzero(whole)
    sample = survey.table.iloc[rows[np.unique(np.linspace(0, len(rows) - 1, 300).astype(int))]]
    before = _misfit(chain, sample)
    if before < SMALL * chain.size:
        return None
    tries = [(_misfit(chain, change.mend(sample)), k, change) for k, change in enumerate(_changes(chain))]
    least = min(tries)[0]
    # a mirrored joint and a mirrored column are one reflection: the joints, which come first, are the likelier story
    after, _, best = min((t for t in tries if t[0] < ALIKE * least), key=lambda t: t[1])
    if after > before / BETTER:
        return None
    return Blunder(best, 1e3 * before, 1e3 * after, replace(survey, table=best.mend(survey.table)))


def _one_frame(survey: Survey) -> Mask:
    """The rows to fit that share the measuring frame most of them have: two frames cannot be aligned as one."""
    fit = survey.table["role"].to_numpy() == "fit"
    labels, counts = np.unique(frame_labels(survey)[fit].astype(str), return_counts=True)
    return np.asarray(fit & (frame_labels(survey).astype(str) == labels[np.argmax(counts)]))


def _misfit(chain: Chain, table: pd.DataFrame) -> float:
    """Median distance (mm) of measured from nominal points after the best frame."""
    nominal = chain.kernel("nominal", outputs=(0, 1, 2))(chain.columns(table)).T
    measured = table[list(MEASURED)].to_numpy(dtype=float)
    pose = align(nominal, measured)
    return float(np.median(np.linalg.norm(measured - pose.apply(nominal), axis=1)))


def _changes(chain: Chain) -> Iterator[AxisBlunder]:
    for joint in chain.machine.joints:
        degree = float(np.degrees(1.0))
        units = (degree, 1 / degree) if joint.type == "rotary" else (25.4, 1 / 25.4, 1e3, 1e-3)
        for factor in (-1.0, *units):
            yield AxisBlunder(column=joint.name, factor=factor)
    for one, other in combinations(chain.machine.joints, 2):
        if one.type == other.type:
            yield AxisBlunder(column=one.name, swap=other.name)
    for name in MEASURED:
        for factor in (-1.0, 25.4, 1e3):
            yield AxisBlunder(column=name, factor=factor)
    for first, second in combinations(MEASURED, 2):
        yield AxisBlunder(column=first, swap=second)


def without(survey: Survey, rows: Mask) -> Survey:
    """The survey with the measured values of some rows (mask) taken out; the rows stay, for what follows in order."""
    table = survey.table.copy()
    table.loc[rows, list(MEASURED)] = np.nan
    return replace(survey, table=table)
