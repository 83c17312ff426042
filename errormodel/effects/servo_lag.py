"""Servo lag (following error): position error proportional to the speed, read before the joint has settled.

Speed over the gain of the position loop; mm along a prismatic axis, rad about a rotary one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar, Literal

from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect, along
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.machine import Machine, joint_of
from errormodel.path_speed import rate_name, speed_name

BY_THE_CLOCK = 2.3  # log prior odds, 10 to 1, against a speed by the rows' times where a feed is recorded; by judgement


class ServoLag(JointEffect):
    """``-lag * speed`` along the axis; lag in s. Positive: lagging.

    `speed`, ``each``: every joint arrives with the whole feed, ``feed * direction`` (about a rotary joint the lag is in
    rad s/mm); ``path``: the feed is that along the path, of which the joint has its share; ``clock``: it moves as its
    commanded positions do from row to row, by their times: rows were read on the fly.
    """

    effect: ClassVar[str] = "servo-lag"
    family: ClassVar[str] = "dynamic"
    source: ClassVar[str] = (
        "speed over the gain of the position loop: 1 to 60 ms in motion; after a short dwell 5 um are left at 1 m/min"
    )
    alike: ClassVar[tuple[str, ...]] = ("backlash", "clock-offset", "lost-motion")
    separate: ClassVar[str] = "approach the same positions at three feeds, with a short and a long dwell"
    asked: ClassVar[Mapping[str, int]] = {"feed": 3}
    otherwise: ClassVar[str] = "approach the same positions with a short and a long dwell"
    example: ClassVar[Mapping[str, object]] = {"joint": "X"}

    speed: Literal["each", "path", "clock"] = "each"

    def cost(self, scene: Scene) -> float:
        """Natural logarithm of the prior odds against it: where the feed is recorded, it says the speed."""
        return BY_THE_CLOCK if self.speed == "clock" and scene.varies("feed") else 0.0

    @property
    def drivers(self) -> tuple[str, ...]:
        return (rate_name(self.joint),) if self.speed == "clock" else ("feed", f"dir_{self.joint}")

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint = joint_of(machine, self.joint)
        unit, size = "s", 3e-4
        if self.speed == "path":
            speed = channel(speed_name(machine, self.joint))
        elif self.speed == "clock":
            speed, size = channel(rate_name(self.joint)), 3e-3  # nothing has settled
        else:
            speed = channel("feed") / 60 * channel(f"dir_{self.joint}")
            if joint.type == "rotary":
                unit, size = "rad s/mm", 6e-7
        return [EffectTerm(self.joint, "", unit, along(joint, -speed), size)]  # excess feedforward makes it negative

    def meaning_of_sign(self, values: Sequence[float]) -> str:
        if values[0] >= 0:
            return ""
        return f"and {self.joint} leads its command, which no servo does: readings in motion that are late"

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        if scene.on_the_fly:
            yield from (cls(joint=j.name, speed="clock") for j in scene.moving)
        for j in scene.moving:
            if scene.both_ways(j) and scene.varies("feed"):
                yield cls(joint=j.name)
                if len(scene.moving) > 1:
                    yield cls(joint=j.name, speed="path")
