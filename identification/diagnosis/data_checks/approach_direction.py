"""Check of the column ``dir_<joint>`` against the direction of approach that the row order implies."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from errormodel.approach import direction
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog

if TYPE_CHECKING:
    from errormodel.survey import Survey

CONTRARY = 0.9  # of the rows: approaches by a detour are of both kinds, or always from one side
FEWEST = 20  # rows of either side


def contrary_sides(survey: Survey, log: DecisionLog = UNRECORDED) -> Iterator[str]:
    """A remark for each column ``dir_<joint>`` that says +1 where the joint came from above, and -1 from below.

    Nothing is put right: whether a machine arrives by a detour, only its user knows.
    """
    table = survey.fit.table
    for name in (str(c) for c in table.columns if str(c).startswith("dir_")):
        joint = name.removeprefix("dir_")
        given = table[name].to_numpy(dtype=np.float64)
        moved = direction(table.drop(columns=name), joint)
        known = np.isfinite(given)
        sides = np.sum(moved[known] > 0), np.sum(moved[known] < 0)
        against = int(np.sum(given[known] * moved[known] < 0))
        contrary = min(sides) >= FEWEST and against > CONTRARY * known.sum()
        log.add(
            "approach-column",
            "found" if contrary else "passed",
            f"column {name}",
            against / max(known.sum(), 1),
            CONTRARY,
        )
        if contrary:
            yield (
                f"column {name} says the opposite of how {joint} came in the order of the rows, in {against} of "
                f"{known.sum()}: if its sign is wrong, so is that of any backlash, lost motion or hysteresis of {joint}"
            )
