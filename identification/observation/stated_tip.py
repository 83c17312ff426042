"""The tip that was measured with: where it is stated to be, what it is beside that goes into places of rotary axes."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from errormodel.effects.target_offset import TargetOffset
from errormodel.machine import Machine
from errormodel.survey import Survey
from identification.observation.models import PositionView, View


def tip_is_stated(machine: Machine) -> bool:
    """Whether the place of the tip in the last frame is taken as stated, and not estimated."""
    return all(spec.effect != TargetOffset.effect for spec in machine.effects)


def tip_notes(machine: Machine, survey: Survey, views: Iterable[View]) -> tuple[str, ...]:
    """A note where positions of one tip are to say where the rotary axes of a machine with linear ones lie."""
    kinds = {j.type for j in machine.joints}
    moved = [j.name for j in machine.joints if j.type == "rotary" and np.ptp(survey.table[j.name].dropna()) > 0]
    positions = any(isinstance(v, PositionView) for v in views)
    one = bool((survey.tool == survey.tool[:1]).all())
    if len(kinds) < 2 or not moved or not positions or not one or not tip_is_stated(machine):
        return ()
    return (
        f"the places of {' and '.join(moved)} across the axes hold only as far as the tip that was measured with is "
        f"where tool says ({', '.join(f'{v:g}' for v in survey.tool[0])} mm): what it is beside that goes into them, "
        "1 mm a mm, and into no standard uncertainty. Readings with the spindle turned by 180 deg tell x and y, a "
        "second length tells z",
    )
