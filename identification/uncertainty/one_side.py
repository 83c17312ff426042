"""Joints that came to all fitted rows from one side: backlash is then unknown, and so are rows from the other side."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from errormodel.approach import direction, starts_of_lines, unknown_sides
from errormodel.chain import Chain

if TYPE_CHECKING:
    from errormodel.survey import Survey
    from identification.estimation.result import Fit


def only_sides(fit: Fit) -> dict[str, int]:
    """The side, +1 from smaller positions or -1, of each joint that came to all rows from one; of a stream unknown."""
    if fit.streamed is not None:
        return {}
    table, joints = fit.survey.table, [j.name for j in fit.chain.machine.joints]
    out = {}
    for name in (n for n in joints if f"dir_{n}" not in fit.chain.channels):  # else the fit knows both
        # it may have overrun the start of a line, and have come there as to the others
        stated = ~unknown_sides(table, name) & ~starts_of_lines(table, name, joints)
        sides = np.unique(direction(table, name)[stated])
        if len(sides) == 1:
            out[name] = int(sides[0])
    return out


def from_other_sides(chain: Chain, only: Mapping[str, int], points: Survey) -> Iterator[str]:
    """A note on points that joints reach from the side from which no row was fitted.

    Parameters
    ----------
    only : as `only_sides` returns them.
    """
    said, table = [], points.table
    for name in (j.name for j in chain.machine.joints if j.name in only):
        count = np.sum((direction(table, name) == -only[name]) & ~unknown_sides(table, name))
        if count:
            said.append(f"{count} points by {name} (dir_{name} {-only[name]:+d})")
    if said:
        yield (
            f"{', '.join(said)} are reached from the side from which no row was measured: backlash is unknown there, "
            "and not in the uncertainty. Measure from both sides"
        )
