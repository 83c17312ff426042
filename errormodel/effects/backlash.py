"""Backlash: offset of a joint's position that depends on the direction of approach (reversal value B of ISO 230-2).

Displacement along a prismatic axis in mm, rotation about a rotary axis in rad; the direction of approach is +1 or -1.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect, along
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import reversal_size
from errormodel.machine import Machine, joint_of


class Backlash(JointEffect):
    """``size/2 * direction`` along the axis (mm) or about it (rad); positive: ahead in the direction of travel."""

    effect: ClassVar[str] = "backlash"
    family: ClassVar[str] = "reversal"
    source: ClassVar[str] = (
        "ISO 230-2 reversal value; 0 to 50 um on machine tools; worm tables 10 to 60, geared arms 60 to 300 arcsec"
    )
    alike: ClassVar[tuple[str, ...]] = ("lost-motion", "hysteresis", "servo-lag")
    separate: ClassVar[str] = "approach the same positions from both sides at two feeds, along the whole travel"
    asked: ClassVar[Mapping[str, int]] = {"feed": 2}
    otherwise: ClassVar[str] = "approach the same positions from both sides, along the whole travel"
    example: ClassVar[Mapping[str, object]] = {"joint": "X"}

    @property
    def drivers(self) -> tuple[str, ...]:
        return (f"dir_{self.joint}",)

    def reversal(self, values: Sequence[float]) -> tuple[float, float]:
        return values[0], values[0]

    def meaning_of_sign(self, values: Sequence[float]) -> str:
        if values[0] <= 0:
            return ""
        return (
            f"and {self.joint} is ahead of its command, which no worn drive makes: a compensation of backlash set too "
            f"large, readings in motion that are late, or dir_{self.joint} of the wrong sign"
        )

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint = joint_of(machine, self.joint)
        unit, size = reversal_size(joint)
        return [EffectTerm(self.joint, "", unit, along(joint, channel(f"dir_{self.joint}") / 2), size)]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        return (cls(joint=j.name) for j in scene.moving if scene.both_ways(j))
