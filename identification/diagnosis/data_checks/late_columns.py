"""Commands of some joints that stand a few rows too late or too early beside the other columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from errormodel.arrays import Index
from errormodel.chain import Chain
from errormodel.effects.axis_blunder import AxisBlunder
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED
from identification.diagnosis.data_checks.blunder import FEWEST, Blunder, Points, Sheet, groups, sheet
from identification.diagnosis.data_checks.columns import ALIKE, TWO
from identification.diagnosis.data_checks.rows import BETTER
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog

LATEST = 3  # rows by which a column may be late or early: a line too many or too few at its head
MOST = 600  # rows, one after the other, tell as much as all


def late_column(chain: Chain, survey: Survey, log: DecisionLog = UNRECORDED) -> Blunder | None:
    """The column, or all columns of one kind of joint, that fit where they are taken from a few rows further on.

    The rows at the end for which nothing is left are taken as not measured.
    """
    rows = max(groups(survey, gaps=True), key=len, default=np.zeros(0, dtype=np.intp))
    if len(rows) < FEWEST + LATEST:
        return None
    columns, fixed = sheet(chain, survey.table.iloc[rows[:MOST]]), survey.frame == "fixed"
    if len(Points.of(chain, columns, fixed).measured_whole) < FEWEST + LATEST:
        return None
    before = _misfit(chain, columns, fixed)
    if not before > TWO * chain.size:
        return None
    joints = chain.machine.joints
    kinds = [[j.name for j in joints if j.type == kind] for kind in ("rotary", "prismatic")]
    ways = [*([j.name] for j in joints), *(names for names in kinds if 1 < len(names) < len(joints))]
    late = [k for k in range(-LATEST, LATEST + 1) if k]
    tries = sorted(
        (_misfit(chain, _moved(columns, names, k), fixed), n, k) for n, names in enumerate(ways) for k in late
    )
    (after, n, k), *others = tries
    found = after < min(before / BETTER, TWO * chain.size) and not any(m < ALIKE * after for m, *_ in others)
    log.add("late-column", "found" if found else "passed", "columns", after, before / BETTER)
    if not found:
        return None
    names = ways[n]
    table = survey.table.copy()
    for own in groups(survey, gaps=True):
        lost = own[len(own) - k :] if k > 0 else own[:-k]
        table.loc[table.index[lost], list(MEASURED)] = np.nan
        for name in names:
            values = table[name].to_numpy()[own]
            source = np.clip(np.arange(len(own)) + k, 0, len(own) - 1)
            table.loc[table.index[own], name] = values[source]
    what = f"column {names[0]} stands" if len(names) == 1 else f"columns {' '.join(names)} stand"
    many = f"{abs(k)} row{'s' * (abs(k) > 1)} too {'late' if k > 0 else 'early'}"
    return Blunder(
        f"{what} {many} beside the other columns",
        replace(survey, table=table),
        where=names[0],
        driver=tuple(names),
        before_um=1e3 * before,
        after_um=1e3 * after,
        cure=AxisBlunder.separate,
    )


def _moved(columns: Sheet, names: list[str], k: int) -> Sheet:
    """The columns with those named taken from `k` rows further on, without the rows for which nothing is left."""
    n = len(next(iter(columns.values())))
    kept: Index = np.arange(max(-k, 0), n - max(k, 0))
    return {name: values[kept + k * (name in names)] for name, values in columns.items()}


def _misfit(chain: Chain, columns: Sheet, fixed: bool) -> float:
    return Points.of(chain, columns, fixed).measured_whole.misfit()
