"""Gear-cyclic error: periodic angular positioning error of a rotary joint from its gear, worm or motor.

Rotation about the axis in rad, with many periods per revolution.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar

import numpy as np

from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect, ShapeParameter, along
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import Positive, frequencies, joint_as, resolved, waves
from errormodel.machine import Machine

RATIO = 160.0  # largest usual ratio of a strain-wave gear, which errs twice a turn of its input


class GearCyclic(JointEffect):
    """``sin * sin(per_turn q) + cos * cos(per_turn q)`` about the axis in rad; `per_turn` need not be an integer."""

    effect: ClassVar[str] = "gear-cyclic"
    family: ClassVar[str] = "periodic"
    source: ClassVar[str] = (
        "worm tables: 90 to 180 a turn, 10 to 50 urad; strain-wave gears of ratios 50 to 160: twice a turn of the input"
    )
    alike: ClassVar[tuple[str, ...]] = ("eccentricity", "higher-order-geometry")
    separate: ClassVar[str] = "200 positions over three periods, at steps that are no fraction of the period"
    example: ClassVar[Mapping[str, object]] = {"joint": "B", "per_turn": 90.0}
    shape: ClassVar[str] = "per_turn"

    per_turn: Annotated[Positive, ShapeParameter("1", sampled=False, said=False)]

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.joint,)

    @property
    def period(self) -> float:
        """Angle of one period, rad."""
        return 2 * math.pi / self.per_turn

    def overtone(self, number: int) -> Effect:
        return self.model_copy(update={"per_turn": number * self.per_turn})

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint = joint_as(machine, self.joint, "rotary", self.effect)
        both = waves(channel(self.joint), self.per_turn)
        return [EffectTerm(self.joint, label, "rad", along(joint, wave), 3e-5) for label, wave in both.items()]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        """Rates from above 3 to twice `RATIO` a turn that the poses resolve, with three periods or more in the span."""
        for joint in scene.rotary:
            turns = float(np.ptp(scene.span(joint))) / (2 * math.pi)
            most = 2 * math.pi / resolved(scene, joint, math.pi / RATIO)
            for rate in frequencies(turns, max(4.0, 3 / turns), most):
                yield cls(joint=joint.name, per_turn=rate)
