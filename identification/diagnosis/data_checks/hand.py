"""Measured points in a plane or on a line that are left-handed, which no distance from the nominal machine shows.

Two or three balls, or a plate, lie as near to their mirror image as to themselves. What the machine's errors do to them
over the poses does not: the declared errors explain the points as they are, or turned or exchanged.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.survey import Survey
from identification.diagnosis.data_checks.blunder import FEWEST, Blunder, Points, groups, sheet
from identification.diagnosis.data_checks.columns import change_text, measured_reflections, mended
from identification.diagnosis.data_checks.declared_errors import CLEAR, CLEARLY, left_by_declared
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog

SAMPLE = 600  # rows tell as much as all


def left_handed(chain: Chain, survey: Survey, log: DecisionLog = UNRECORDED) -> Blunder | None:
    """Measured columns of another sign or order with which the declared errors leave clearly less, or None."""
    if not _flat(chain, survey) or (as_written := left_by_declared(chain, survey)) is None:
        return None
    ways = list(measured_reflections())
    left = [left_by_declared(chain, replace(survey, table=mended(survey.table, c))) for c in ways]
    known = [(found[0], k) for k, found in enumerate(left) if found is not None]
    if not known:
        return None
    after, k = min(known)
    ratio = as_written[0] / max(after, np.finfo(float).tiny)
    if ratio < CLEAR or as_written[1] * np.log(ratio) < CLEARLY:
        log.add("wrong-hand", "passed", "columns", ratio, CLEAR)
        return None
    changes = ways[k]
    log.add("wrong-hand", "found", f"column {changes[0].column}", ratio, CLEAR)
    columns = sheet(chain, survey.table)
    said = change_text(changes, chain.machine, survey.frame == "fixed", columns)
    return Blunder(
        text=f"{said}. As near to the nominal machine, its errors leave {ratio:.2g} times less of the points then",
        survey=replace(survey, table=mended(survey.table, changes)),
        where=changes[0].where,
        driver=(changes[0].column,),
        changes=changes,
    )


def _flat(chain: Chain, survey: Survey) -> bool:
    """Whether the nominal points of each frame lie in a plane or on a line, and not all at one place."""
    several = False
    for rows in groups(survey):
        some = rows[:: -(-len(rows) // SAMPLE)]
        points = Points.of(chain, sheet(chain, survey.table.iloc[some]), fixed=True)
        extents = _extents(points.nominal)
        if len(rows) < FEWEST or extents[2] > points.largest:
            return False
        several |= bool(extents[0] > points.largest)
    return several


def _extents(points: Array) -> Array:
    """Standard deviations (3,) of points (n, 3) along their principal directions, the largest first."""
    centred = points - points.mean(axis=0)
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(centred.T @ centred / len(points))[::-1], 0.0)))
