"""Rail waviness: periodic straightness or angular error motion of a prismatic joint.

Its period is that of the rail's bolts, rollers or joints. Units: mm and rad.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import ClassVar

from errormodel.conventions import MOTIONS, Motion, unit_of
from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect, axis_motion
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import Positive, joint_as, periods, waves
from errormodel.machine import Machine

SHORTEST_WAVE_MM = 20.0  # shortest candidate period, mm; by judgement: bolts of guides are 40 to 120 mm apart
# so many periods per travel are tried even if they are shorter, since small machines have finer pitches
MOST_WAVES_PER_TRAVEL = 10


class RailWaviness(JointEffect):
    """``sin * sin(2 pi q/period) + cos * cos(2 pi q/period)`` in a `motion` across the axis (mm, rad)."""

    effect: ClassVar[str] = "rail-waviness"
    family: ClassVar[str] = "periodic"
    source: ClassVar[str] = "guides have bolts every 40 to 120 mm, joints every 1 to 4 m; 1 to 10 um, 1 to 20 urad"
    alike: ClassVar[tuple[str, ...]] = ("pitch-cyclic", "higher-order-geometry", "local-defect")
    separate: ClassVar[str] = "straightness and level along the travel at steps of a sixth of the period"
    example: ClassVar[Mapping[str, object]] = {"joint": "X", "motion": "dz", "period": 120.0}
    shape: ClassVar[str] = "period"

    motion: Motion
    period: Positive

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.joint,)

    def overtone(self, number: int) -> Effect:
        return self.model_copy(update={"period": self.period / number})

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint_as(machine, self.joint, "prismatic", self.effect)
        both = waves(channel(self.joint), 2 * math.pi / self.period)
        unit = unit_of(self.motion)
        size = 0.005 if unit == "mm" else 1e-5
        return [EffectTerm(self.joint, label, unit, {self.motion: wave}, size) for label, wave in both.items()]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        for joint in scene.prismatic:
            for period in periods(scene, joint, 2, SHORTEST_WAVE_MM, MOST_WAVES_PER_TRAVEL):
                for motion in MOTIONS:
                    if motion != axis_motion(joint):
                        yield cls(joint=joint.name, motion=motion, period=period)
