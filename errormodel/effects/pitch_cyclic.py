"""Periodic positioning error of a prismatic joint, from the lead of a screw, the pitch of a rack, a motor or a scale.

Displacement along the axis in mm.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import ClassVar

from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect, along
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import Positive, joint_as, periods, resolved, waves
from errormodel.machine import Joint, Machine

SHORTEST_PITCH_MM = 4.0  # period, mm
LEAD = 10.0  # mm: the usual one
MOST_PITCHES_PER_TRAVEL = 50  # may fit into any travel: those of a small machine are shorter


class PitchCyclic(JointEffect):
    """``sin * sin(2 pi q/period) + cos * cos(2 pi q/period)`` along the axis in mm; `period` in mm."""

    effect: ClassVar[str] = "pitch-cyclic"
    family: ClassVar[str] = "periodic"
    source: ClassVar[str] = "ISO 230-2 and ISO 3408: 1 to 10 um within a lead"
    alike: ClassVar[tuple[str, ...]] = ("rail-waviness", "compensation-active", "higher-order-geometry")
    separate: ClassVar[str] = "200 positions over three periods, at steps that are no fraction of the period"
    example: ClassVar[Mapping[str, object]] = {"joint": "X", "period": 10.0}
    shape: ClassVar[str] = "period"

    period: Positive

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.joint,)

    @classmethod
    def unresolved(cls, scene: Scene, joint: Joint) -> str:
        """Between targets that are far apart a lead passes unseen, and what is seen of it looks slower."""
        least = resolved(scene, joint, SHORTEST_PITCH_MM)
        if joint.type != "prismatic" or least <= LEAD:
            return ""
        return (
            f"Targets so far apart show no wave shorter than {least:.0f} mm: what repeats with the lead of a screw or "
            "the pitch of a scale would look the same."
        )

    def overtone(self, number: int) -> Effect:
        return self.model_copy(update={"period": self.period / number})

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint = joint_as(machine, self.joint, "prismatic", self.effect)
        both = waves(channel(self.joint), 2 * math.pi / self.period)
        return [EffectTerm(self.joint, label, "mm", along(joint, wave), 0.005) for label, wave in both.items()]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        for joint in scene.prismatic:
            for period in periods(scene, joint, 3, SHORTEST_PITCH_MM, MOST_PITCHES_PER_TRAVEL):
                yield cls(joint=joint.name, period=period)
