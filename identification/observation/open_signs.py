"""Readings at one place whose sign nothing proves: all of them turned are those of a machine with all errors turned."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from identification.observation.frames import POINT_SPREAD_ROUND_OFF
from identification.observation.models import PositionView, View

OPEN_SIGNS = (
    "all commands take the functional point to one place, and whether all signs of what was measured are turned cannot "
    "be known from it: it is read as the place of the functional point (the tool), positive where it stands too far "
    "along an axis. Of the opposite sign (the workpiece beside the tool, or what the axes indicated at a probed ball "
    "less what was commanded) all errors would be the opposite of those found: then turn mx, my and mz about that place"
)


def at_one_place(views: Iterable[View]) -> bool:
    """Whether positions were measured, with all components, of points that determine no rotation of their frames."""
    points = [v for v in views if isinstance(v, PositionView)]
    return bool(points) and all(len(v.pose.undetermined) == 3 and v.components.all() for v in points)


def sign_notes(views: Iterable[View], indicated: bool) -> tuple[str, ...]:
    """A note where the sign of what was measured cannot be known; that of a place that does not change can.

    Parameters
    ----------
    indicated : whether it was indicated by the axes at such a place, as of `Survey.indicated`.
    """
    points = [v for v in views if isinstance(v, PositionView)]
    if indicated or not at_one_place(points):
        return ()
    spread = max(float(np.ptp(v.measured, axis=0).max(initial=0.0)) for v in points)
    return (OPEN_SIGNS,) if spread > POINT_SPREAD_ROUND_OFF * points[0].chain.size else ()
