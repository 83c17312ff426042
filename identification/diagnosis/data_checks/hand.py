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
from identification.observation.frames import MACHINE_ERROR_SHARE

SAMPLE = 600  # rows tell as much as all


def left_handed(chain: Chain, survey: Survey, log: DecisionLog = UNRECORDED) -> Blunder | None:
    """Measured columns of another sign or order with which the declared errors leave clearly less, or None."""
    extents = _extents(chain, survey)
    if extents is None or (as_written := left_by_declared(chain, survey)) is None:
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
    changes, on_a_line = ways[k], extents[1] < MACHINE_ERROR_SHARE * chain.size
    log.add("wrong-hand", "found", f"column {changes[0].column}", ratio, CLEAR)
    columns = sheet(chain, survey.table)
    said = change_text(changes, chain.machine, survey.frame == "fixed", columns)
    return Blunder(
        text=f"{said}. As near to the nominal machine, its errors leave {ratio:.2g} times less of the points then",
        survey=replace(survey, table=mended(survey.table, changes)),
        where=changes[0].where,
        driver=(changes[0].column,),
        changes=changes,
        # beside a line a frame turns freely, and each column is another mirror
        others=tuple(ways[n] for left, n in known if n != k and left < CLEAR * after) if on_a_line else (),
    )


def _extents(chain: Chain, survey: Survey) -> Array | None:
    """Largest standard deviations (3,) mm of a frame's nominal points along their principal directions.

    None where they lie in no plane, or all at one place.
    """
    largest = np.zeros(3)
    for rows in groups(survey):
        some = rows[:: -(-len(rows) // SAMPLE)]
        points = Points.of(chain, sheet(chain, survey.table.iloc[some]), fixed=True)
        centred = points.nominal - points.nominal.mean(axis=0)
        variances = np.linalg.eigvalsh(centred.T @ centred / len(points))[::-1]
        extents = np.sqrt(np.maximum(variances, 0.0))
        if len(rows) < FEWEST or extents[2] > points.largest:
            return None
        largest = np.maximum(largest, extents)
    return largest if largest[0] > MACHINE_ERROR_SHARE * chain.size else None
