"""Thermal bending: curvature of a beam by a temperature difference across it, followed by the joint that runs on it.

Constant curvature: deflection in mm across the axis, slope in rad.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import ClassVar, Literal

from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import (
    STEEL_EXPANSION,
    Initial,
    Lag,
    across,
    bending,
    joint_as,
    lags,
    thermal,
    tilting,
    warmth,
)
from errormodel.effects.travel import TRAVEL_ENDS, End, Translation
from errormodel.machine import Machine


class ThermalBending(JointEffect):
    """``curvature * (T_sensor - T_minus) * u (L - u)/2`` across the axis, with its slope as an angle; 1/(mm K).

    u is the position from the lower end of the travel, L the travel, `tau` (s) the beam's lag behind its sensors and
    `initial` (K) what it had more than their difference in the first row. A second parameter is a slope beyond that of
    the deflection: guides follow the beam only approximately. A beam `held` at one place only, as a column at its foot
    or a bed in the middle, is a cantilever: ``-u^2/2`` from that end or the middle of the travel, and its slope.
    """

    effect: ClassVar[str] = "thermal-bending"
    family: ClassVar[str] = "thermal"
    source: ClassVar[str] = "curvature is expansion over height: 12 ppm/K over 300 mm"
    alike: ClassVar[tuple[str, ...]] = ("beam-sag", "structure-drift", "refraction", "cross-axis-compliance")
    separate: ClassVar[str] = (
        "level along the beam, or straightness by autocollimator, with the beam heated on one side"
    )
    example: ClassVar[Mapping[str, object]] = {"joint": "Y", "motion": "dz", "sensor": "T_top", "minus": "T_bed"}

    motion: Translation
    sensor: str
    minus: str | None = None
    tau: Lag = 0.0
    initial: Initial = 0.0
    held: End | Literal["middle"] | None = None

    @property
    def drivers(self) -> tuple[str, ...]:
        return thermal(self.sensor, self.minus)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint = joint_as(machine, self.joint, "prismatic", self.effect)
        (low, high), q = joint.travel, channel(self.joint)
        warm = warmth(channel, self.sensor, self.minus, self.tau, self.initial)
        if self.held is not None:
            u = q - {"low": low, "middle": (low + high) / 2, "high": high}[self.held]
            cantilever = bending(joint, self.motion, -warm * u * u / 2, -warm * u)
            return [EffectTerm(self.joint, "bow", "1/(mm K)", cantilever, STEEL_EXPANSION / 300)]
        slope = warm * ((low + high) / 2 - q)
        bow = bending(joint, self.motion, warm * (q - low) * (high - q) / 2, slope)
        return [
            EffectTerm(self.joint, "bow", "1/(mm K)", bow, STEEL_EXPANSION / 300),
            EffectTerm(self.joint, "slope", "1/(mm K)", tilting(joint, self.motion, slope), STEEL_EXPANSION / 300),
        ]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        for joint in scene.prismatic:
            for motion in across(joint, "d"):
                for sensor, minus in combinations(scene.sensors, 2):
                    for tau in lags(scene):
                        for held in (None, "middle", *TRAVEL_ENDS):
                            yield cls(joint=joint.name, motion=motion, sensor=sensor, minus=minus, tau=tau, held=held)
