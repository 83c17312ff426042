"""Thermal expansion of the scale or screw of a prismatic joint (ISO 230-3).

Displacement along the axis in mm; coefficient in 1/K.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar

from errormodel.effects.base import FIXED, Channels, Effect, EffectTerm, JointEffect, along
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import STEEL_EXPANSION, Initial, Lag, joint_as, lags, thermal, warmth
from errormodel.machine import Machine


class ScaleExpansion(JointEffect):
    """``expansion * (position - anchor) * (temperature - 20)`` along the axis, in 1/K; positive: too long when warm.

    `tau` (s) is the lag of the scale or screw behind the sensor, `initial` (K) how much warmer than it it was in the
    first row, `minus` a sensor in place of 20 degC, `anchor` the position (mm) at which the scale is fixed.
    """

    effect: ClassVar[str] = "scale-expansion"
    family: ClassVar[str] = "thermal"
    source: ClassVar[str] = "expansion of steel is 11 to 12, of glass 8 ppm/K; ISO 230-3"
    alike: ClassVar[tuple[str, ...]] = ("warm-up", "scale-ppm", "structure-drift")
    separate: ClassVar[str] = "measure the axis cold and warm with an interferometer, at both ends of the travel"
    example: ClassVar[Mapping[str, object]] = {"joint": "X", "sensor": "T_bed"}

    sensor: str
    minus: str | None = None
    tau: Lag = 0.0
    initial: Initial = 0.0
    anchor: Annotated[float, FIXED] = 0.0

    @classmethod
    def same_parameter(cls) -> frozenset[str]:
        """An expansion is the same wherever the scale is held."""
        return cls.cause | {"anchor"}

    @property
    def drivers(self) -> tuple[str, ...]:
        return thermal(self.sensor, self.minus)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint = joint_as(machine, self.joint, "prismatic", self.effect)
        growth = (channel(self.joint) - self.anchor) * warmth(channel, self.sensor, self.minus, self.tau, self.initial)
        return [EffectTerm(self.joint, "", "1/K", along(joint, growth), STEEL_EXPANSION)]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        for joint in scene.prismatic:
            low, high = joint.travel
            for sensor in scene.sensors:
                for tau in lags(scene):
                    for anchor in sorted({0.0, low, (low + high) / 2, high}):
                        yield cls(joint=joint.name, sensor=sensor, tau=tau, anchor=anchor)
