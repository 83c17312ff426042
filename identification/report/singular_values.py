"""The singular values of a report: places of the dots in a drawing that the browser makes.

They say how clearly the poses distinguish the parameters. Each value above the threshold is one identified combination.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from identification.estimation.result import Fit
from identification.plots.singular_values import threshold, visible

WIDTH, HEIGHT = 640.0, 150.0  # of the drawing, in its own units
MOST_LABELS = 8  # powers of ten with a label


class SingularValues(NamedTuple):
    """Dots (x, y, identified), the threshold's y, lines (y, exponent of ten) and how many values of both kinds."""

    dots: list[tuple[float, float, bool]]
    threshold: float
    decades: list[tuple[float, int]]
    identified: int
    others: int


def singular_values_part(fit: Fit) -> SingularValues | None:
    """None where nothing is identified."""
    groups = fit.solution.groups
    if not groups.rank:
        return None
    logarithm = np.log10(visible(groups))
    limit = float(np.log10(threshold(groups)))
    low, high = np.floor(min(logarithm[-1], limit)), np.ceil(max(logarithm[0], limit + 1))
    step = int(np.ceil((high - low) / MOST_LABELS))

    def up(value: float) -> float:
        return round(float(HEIGHT * (high - value) / (high - low)), 2)

    apart = WIDTH / len(logarithm)
    dots = [(round((k + 0.5) * apart, 2), up(v), k < groups.rank) for k, v in enumerate(logarithm)]
    decades = [(up(n), n) for n in range(int(low), int(high) + 1, step)]
    return SingularValues(dots, up(limit), decades, groups.rank, len(logarithm) - groups.rank)
