"""Rows whose measured points lie far from their commands: a few are gross errors, more of them a wrong join."""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.exceptions import InputError
from errormodel.survey import Survey
from identification.importing.words import LISTED

WILD = 15.0  # times the median distance: ten times what most points keep within; named as far from its command
FEW = 0.1  # share of the rows that may be gross errors, by judgement: of more the commands were others


def far_rows(survey: Survey, rows: Index, distance: Array, foreign: float) -> Index:
    """Survey rows (k,) that lie far from their commands.

    Parameters
    ----------
    rows : (n,) survey rows; distance : (n,) mm of their points from their commands, after alignment.
    foreign : mm, beyond which points do not belong to their commands, whatever the machine's errors.

    Raises
    ------
    InputError
        More than a few points do not belong to their commands.
    """
    if not len(distance):
        return rows
    elsewhere = np.flatnonzero(distance > foreign)
    if len(elsewhere) > max(2.0, FEW * len(distance)):
        numbers = survey.table["row"].to_numpy()[rows[elsewhere]]
        files = ", ".join(dict.fromkeys(survey.table["file"].astype(str).to_numpy()[rows[elsewhere]]))
        block = elsewhere[-1] - elsewhere[0] + 1 == len(elsewhere)
        named = f"{numbers[0]} to {numbers[-1]}" if block else ", ".join(map(str, numbers[:LISTED]))
        named += " ..." if not block and len(numbers) > LISTED else ""
        least, most, usual = float(distance[elsewhere].min()), float(distance.max()), float(np.median(distance))
        clock = ": they belong to other commands, or a clock was set" if block else ""
        raise InputError(
            f"{files}, joined rows {named}",
            f"{len(elsewhere)} of {len(distance)} points lie {least:.3g} to {most:.3g} mm from their commands, where "
            f"most lie within {2 * usual:.2g} mm{clock}",
            "See what was driven then. Import both parts by themselves (--leave-out), or join by another --match",
        )
    return rows[distance > WILD * max(float(np.median(distance)), 1e-3)]
