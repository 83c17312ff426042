"""Gate 0: mistakes in a recording, which mimic everything. They are put right and reported, never explained as physics.

Columns with another sign, unit, zero or place (`wrong_columns`), rows in another order, frame or meaning
(`wrong_rows`), copies and clocks (`bookkeeping`). Sensors that are none are set aside by `sensors`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from errormodel.arrays import Mask
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine import Machine
from errormodel.serial_chain import ONLY_SERIAL
from errormodel.survey import Survey
from errormodel.survey_columns import MEASURED
from identification.diagnosis.data_checks.blunder import Blunder, Points, groups, sheet
from identification.diagnosis.data_checks.columns import TWO, wrong_column
from identification.diagnosis.data_checks.duplicates_and_clock import copied_rows, set_clock
from identification.diagnosis.data_checks.rows import FEWEST, wrong_rows

MOST_BLUNDERS = 4
SHUFFLES = 20
RELATED = 0.5  # of the misfit of rows that have nothing to do with each other


def find_blunders(machine: Machine, survey: Survey) -> list[Blunder]:
    """Mistakes of a recording, each found with those before it put right.

    Raises
    ------
    InputError
        What was measured has nothing to do with what was commanded, or lies in several frames of which the survey says
        nothing.
    """
    chain = Chain(machine)
    gates: list[Callable[[Survey], Blunder | None]] = [
        lambda s: copied_rows(chain, s),
        set_clock,
        lambda s: wrong_column(chain, s) or wrong_rows(chain, s),
        lambda s: wrong_column(chain, s, two=True),
    ]
    out = list[Blunder]()
    for gate in gates:
        while len(out) < MOST_BLUNDERS and (blunder := gate(survey)) is not None:
            out.append(blunder)
            survey = blunder.survey
    _refuse_unrelated(chain, survey)
    return out


def _refuse_unrelated(chain: Chain, survey: Survey) -> None:
    """InputError where measured points fit the commands no better than those of any other rows would."""
    for rows in groups(survey):
        points = Points.of(chain, sheet(chain, survey.table.iloc[rows]), survey.frame == "fixed")
        found = points.misfit()
        if len(rows) < FEWEST or found < TWO * chain.size:
            continue
        rng = np.random.default_rng(0)
        any_order = [replace(points, measured=rng.permutation(points.measured)).misfit() for _ in range(SHUFFLES)]
        shuffled = float(np.median(any_order))
        if found > RELATED * shuffled:
            raise InputError(
                f"{survey.table['file'].iloc[rows[0]]}, columns {' '.join(MEASURED)}",
                f"measured points that have nothing to do with the commands: the best frame leaves {found:.0f} mm, "
                f"rows in any order would leave {shuffled:.0f} mm",
                "See that each row holds what was measured at its own command, and that this is the machine. "
                f"{ONLY_SERIAL}",
            )


def without(survey: Survey, rows: Mask) -> Survey:
    """The survey with the measured values of some rows (mask) taken out; the rows stay, for what follows in order."""
    table = survey.table.copy()
    table.loc[rows, list(MEASURED)] = np.nan
    return replace(survey, table=table)
