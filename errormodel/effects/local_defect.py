"""Local defect: a Gaussian disturbance of one error motion at one position of the travel.

Dents, chips and joints of rails. Units: mm and rad.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Annotated, ClassVar

import numpy as np

from errormodel.conventions import MOTIONS, Motion, unit_of
from errormodel.effects.base import PLACE, Channels, Effect, EffectTerm, JointEffect
from errormodel.effects.ops import exp
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import Positive, across, joint_as, tilting
from errormodel.effects.travel import length, usual_size
from errormodel.machine import Machine, joint_of

# standard deviations of the Gaussian as shares of the travel; by judgement: broader ones are smooth geometry
DEFECT_WIDTH_SHARES = (1 / 40, 1 / 25, 1 / 16)
DEFECT_STEP_WIDTHS = 0.8  # distance of neighbouring candidates in widths; neighbours then correlate by 0.85
FEWEST_DEFECT_ROWS = 4  # rows within one width of the centre; with fewer a defect cannot be distinguished from outliers
# positions within one width that show its slope, a tenth of the width apart at least: at one position any slope fits,
# which is ten times as large a little way beside it
FEWEST_SLOPE_POSITIONS, APART = 3, 0.1


class LocalDefect(JointEffect):
    """``height * exp(-((q - at) / width)^2 / 2)`` in one motion of a joint (mm, rad); `at` and `width` in mm or rad.

    With `tilt` a linear carriage dips across its axis and pitches in passing: a second parameter is a rotation by the
    slope of the disturbance.
    """

    effect: ClassVar[str] = "local-defect"
    family: ClassVar[str] = "geometric"
    source: ClassVar[str] = "dents and joints of rails, damaged scales: 2 to 50 um over 10 to 200 mm"
    alike: ClassVar[tuple[str, ...]] = ("outliers", "rail-waviness", "contact-knee", "higher-order-geometry")
    separate: ClassVar[str] = "twenty positions within three widths of the place, in both directions"
    example: ClassVar[Mapping[str, object]] = {"joint": "X", "motion": "dz", "at": 600.0, "width": 120.0}
    shape: ClassVar[str] = "at"

    motion: Motion
    at: Annotated[float, PLACE]  # mm or rad
    width: Positive
    tilt: bool = False

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.joint,)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint = joint_as(machine, self.joint, "prismatic", self.effect) if self.tilt else joint_of(machine, self.joint)
        away = (channel(self.joint) - self.at) / self.width
        bump, size = exp(-(away**2) / 2), usual_size(self.motion)
        out = [EffectTerm(self.joint, "", unit_of(self.motion), {self.motion: bump}, size)]
        if self.tilt:
            pitch = tilting(joint, self.motion, -away * bump / self.width)
            out.append(EffectTerm(self.joint, "slope", "mm", pitch, size))
        return out

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        for joint, part in product(scene.moving, DEFECT_WIDTH_SHARES):
            width, positions = length(joint) * part, np.sort(scene.columns[joint.name])
            low, high = scene.span(joint)
            places = np.arange(low + width / 2, high, DEFECT_STEP_WIDTHS * width)
            distinct = np.unique(np.round(positions / (APART * width))) * APART * width
            near, apart = (
                np.searchsorted(q, places + width) - np.searchsorted(q, places - width, "right")
                for q in (positions, distinct)
            )
            seen = near >= FEWEST_DEFECT_ROWS
            sloped = (apart >= FEWEST_SLOPE_POSITIONS)[seen].tolist()
            for (at, slope), motion in product(zip(places[seen].tolist(), sloped, strict=True), MOTIONS):
                yield cls(joint=joint.name, motion=motion, at=at, width=width)
                if slope and joint.type == "prismatic" and motion in across(joint, "d"):
                    yield cls(joint=joint.name, motion=motion, at=at, width=width, tilt=True)
