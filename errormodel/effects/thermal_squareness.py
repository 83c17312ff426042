"""Thermal squareness: angle between two prismatic axes as a function of temperature (ISO 230-3).

Rotation in rad/K.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import ClassVar, get_args

import numpy as np

from errormodel.effects.base import Channels, Effect, EffectTerm
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import STEEL_EXPANSION, Initial, Lag, Rotation, lags, members, own_axes, thermal, warmth
from errormodel.machine import Joint, Machine


class ThermalSquareness(Effect):
    """``tilt * (temperature - 20)`` in one rotation of the member between two axes, rad/K.

    `minus` is a sensor in place of 20 degC, `tau` (s) the member's lag behind the sensors, `initial` (K) what
    it had more than these in the first row.
    """

    effect: ClassVar[str] = "thermal-squareness"
    family: ClassVar[str] = "thermal"
    source: ClassVar[str] = "one warm side of a member as long as it is wide tilts it by 12 urad/K; ISO 230-3"
    alike: ClassVar[tuple[str, ...]] = ("structure-drift", "tracker-drift")
    separate: ClassVar[str] = "level or square on the member, heated on one side and then on the other"
    example: ClassVar[Mapping[str, object]] = {"element": "T1", "motion": "ec", "sensor": "T_top", "minus": "T_bed"}

    element: str
    motion: Rotation
    sensor: str
    minus: str | None = None
    tau: Lag = 0.0
    initial: Initial = 0.0

    @property
    def where(self) -> str:
        return self.element

    @property
    def drivers(self) -> tuple[str, ...]:
        return thermal(self.sensor, self.minus)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        warm = warmth(channel, self.sensor, self.minus, self.tau, self.initial)
        return [EffectTerm(self.element, "", "rad/K", {self.motion: warm}, STEEL_EXPANSION)]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        alone = [(sensor, None) for sensor in scene.sensors]
        for element in members(scene.machine):
            for motion in squareness(scene.machine, element):
                for sensor, minus in (*alone, *combinations(scene.sensors, 2)):
                    for tau in lags(scene):
                        yield cls(element=element, motion=motion, sensor=sensor, minus=minus, tau=tau)


def squareness(machine: Machine, element: str) -> list[Rotation]:
    """Rotations of an element that change the angle between a prismatic axis before it and one after it."""
    turns = own_axes(machine)
    place = [e.name for e in machine.elements].index(element)
    axes = [
        (k, turns[e.name] @ np.array(e.axis))
        for k, e in enumerate(machine.elements)
        if isinstance(e, Joint) and e.type == "prismatic"
    ]
    normals = [np.cross(a, b) @ turns[element] for i, a in axes for k, b in axes if i <= place < k]
    return [name for k, name in enumerate(get_args(Rotation)) if any(abs(n[k]) > 0.5 for n in normals)]
