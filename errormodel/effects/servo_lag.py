"""Servo lag (following error): position error proportional to the speed, read before the joint has settled.

Speed over the gain of the position loop; mm along a prismatic axis, rad about a rotary one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect, along
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.machine import Machine, joint_of


class ServoLag(JointEffect):
    """``-lag * feed * direction`` along the axis; s for a prismatic joint (feed in mm/min). Positive: lagging."""

    effect: ClassVar[str] = "servo-lag"
    family: ClassVar[str] = "dynamic"
    source: ClassVar[str] = "speed over the gain of the position loop; after a short dwell 5 um are left at 1 m/min"
    alike: ClassVar[tuple[str, ...]] = ("backlash", "clock-offset", "lost-motion")
    separate: ClassVar[str] = "approach the same positions at three feeds, with a short and a long dwell"
    example: ClassVar[Mapping[str, object]] = {"joint": "X"}

    @property
    def drivers(self) -> tuple[str, ...]:
        return ("feed", f"dir_{self.joint}")

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint = joint_of(machine, self.joint)
        unit, size = ("s", 3e-4) if joint.type == "prismatic" else ("rad s/mm", 6e-7)
        late = -channel("feed") / 60 * channel(f"dir_{self.joint}")
        return [EffectTerm(self.joint, "", unit, along(joint, late), size)]  # excess feedforward makes it negative

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        return (cls(joint=j.name) for j in scene.moving if scene.both_ways(j) and scene.varies("feed"))
