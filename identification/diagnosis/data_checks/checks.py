"""Gate 0: mistakes in a recording, which mimic everything. They are put right and reported, never explained as physics.

Columns with another sign, unit, zero or place (`wrong_columns`) or in other rows (`late_column`), also where points in
a plane do not show it (`left_handed`), rows in another order, frame or meaning (`wrong_rows`), copies and clocks
(`bookkeeping`), readings of the opposite sign (`opposite_readings`). Sensors that are none are set aside by `sensors`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from errormodel.arrays import Mask
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine import Machine
from errormodel.survey import Survey
from errormodel.surveys.columns import MEASURED, ORIENTATION, READINGS
from errormodel.surveys.touched_places import with_nominal_commands
from identification.diagnosis.data_checks.blunder import Blunder, length
from identification.diagnosis.data_checks.columns import TWO, wrong_column
from identification.diagnosis.data_checks.duplicates_and_clock import copied_rows, set_clock
from identification.diagnosis.data_checks.hand import left_handed
from identification.diagnosis.data_checks.late_columns import late_column
from identification.diagnosis.data_checks.opposite_readings import find_opposite_readings
from identification.diagnosis.data_checks.rows import BETTER, refuse_other_targets, wrong_rows
from identification.diagnosis.data_checks.steps import LARGEST_MM, refuse_steps
from identification.diagnosis.data_checks.tool_lengths import refuse_other_tools
from identification.diagnosis.data_checks.unrelated import refuse_still_joint, refuse_unrelated
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog

MOST_BLUNDERS = 4


def find_blunders(machine: Machine, survey: Survey, log: DecisionLog = UNRECORDED) -> list[Blunder]:
    """Mistakes of a recording, each found with those before it put right.

    Raises
    ------
    InputError
        What was measured has nothing to do with what was commanded, or lies in several frames of which the survey says
        nothing, or was displaced by centimetres from a row on; or targets are exchanged, or no mistake explains it.
    """
    chain = Chain(machine)
    gates: list[Callable[[Survey], Blunder | None]] = [
        lambda s: copied_rows(chain, s, log),
        lambda s: set_clock(s, log),
        lambda s: wrong_column(chain, s, log=log) or wrong_rows(chain, s, log) or late_column(chain, s, log),
        lambda s: wrong_column(chain, s, two=True, log=log),
        lambda s: left_handed(chain, s, log),
        lambda s: find_opposite_readings(chain, s, log),
    ]
    out = list[Blunder]()
    refuse_still_joint(chain, survey)
    refuse_other_targets(chain, survey)
    for gate in gates:
        while len(out) < MOST_BLUNDERS and (blunder := gate(survey)) is not None:
            survey = _with_nominal_commands(blunder.survey, machine)
            out.append(replace(blunder, survey=survey))
    if len(out) >= MOST_BLUNDERS:
        log.add("most-mistakes", "refused", "survey", len(out), MOST_BLUNDERS)
    refuse_unrelated(chain, survey, log)
    refuse_other_tools(chain, survey, LARGEST_MM)
    refuse_steps(machine, survey)
    _refuse_no_cure(chain, survey, out, log)
    return out


def _refuse_no_cure(chain: Chain, survey: Survey, found: list[Blunder], log: DecisionLog) -> None:
    """InputError where the changes of columns that fit best leave far more than a machine's errors: they are none."""
    columns = [b for b in found if b.changes and b.before_um is not None and b.after_um is not None]
    if not columns:
        return
    before, after = columns[0].before_um or 0.0, columns[-1].after_um or 0.0
    if after < 1e3 * TWO * chain.size or after < before / BETTER:
        return
    log.add("no-cure", "refused", "columns", after, min(1e3 * TWO * chain.size, before / BETTER))
    nearest = "; and ".join(b.text for b in columns)
    raise InputError(
        str(survey.source),
        f"the nominal machine misses by {length(before)}, and no usual mistake in a column explains it: the nearest "
        f"({nearest}) leaves {length(after)} (four of five rows stay within), further than errors of a machine go",
        "Look for a wrong tool or target, for rows that do not belong to their commands and for several mistakes at "
        "once, and see that this is the machine",
    )


def _with_nominal_commands(survey: Survey, machine: Machine) -> Survey:
    """The survey of places that were touched, which only now show as such, as reading it would have written it."""
    if survey.indicated:
        return survey
    table, notes = with_nominal_commands(survey.table, machine, survey.frame, survey.frame_rotation)
    return replace(survey, table=table, notes=(*survey.notes, *notes), indicated=True) if notes else survey


def without(survey: Survey, rows: Mask) -> Survey:
    """The survey with the measured values of some rows (mask) taken out; the rows stay, for what follows in order."""
    table = survey.table.copy()
    table.loc[rows, [*MEASURED, *(c for c in (*ORIENTATION, *READINGS) if c in table)]] = np.nan
    return replace(survey, table=table)
