"""Lost motion: reversal error of a joint that grows along its travel, as its screw or belt winds up.

Displacement in mm along a prismatic axis, rotation in rad about a rotary one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect, along
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import reversal_size
from errormodel.effects.travel import fraction
from errormodel.machine import Machine, joint_of


class LostMotion(JointEffect):
    """``(growth * u + size) * direction / 2`` along the axis (mm) or about it (rad); u is 0 to 1 over the travel.

    Positive: ahead in the direction of travel, as for backlash.
    """

    effect: ClassVar[str] = "lost-motion"
    family: ClassVar[str] = "reversal"
    source: ClassVar[str] = "friction over the stiffness of a screw held at one end: 1 to 30 um/m; ISO 230-2"
    alike: ClassVar[tuple[str, ...]] = ("backlash", "hysteresis", "servo-lag")
    separate: ClassVar[str] = "approach positions at both ends of the travel from both sides"
    example: ClassVar[Mapping[str, object]] = {"joint": "X"}

    def cost(self, scene: Scene) -> float:
        return 2.0  # log prior odds against it: backlash is the usual form

    @property
    def drivers(self) -> tuple[str, ...]:
        return (f"dir_{self.joint}",)

    def reversal(self, values: Sequence[float]) -> tuple[float, float]:
        growth, size = values
        return size, growth + size

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint = joint_of(machine, self.joint)
        unit, size = reversal_size(joint)
        side = channel(f"dir_{self.joint}") / 2
        return [
            EffectTerm(self.joint, "growth", unit, along(joint, side * fraction(joint, channel(self.joint))), size),
            EffectTerm(self.joint, "size", unit, along(joint, side), size),
        ]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        return (cls(joint=j.name) for j in scene.moving if scene.both_ways(j))
