"""Eccentricity of a rotary joint's scale: angular positioning error with one, two or three periods per revolution.

Rotation about the axis in rad.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar

from pydantic import Field

from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect, along
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import joint_as, waves
from errormodel.machine import Machine


class Eccentricity(JointEffect):
    """``sin * sin(harmonic q) + cos * cos(harmonic q)`` about the axis in rad; `harmonic` periods per revolution.

    A scale that is `oval`, too, adds a wave of twice the harmonic.
    """

    effect: ClassVar[str] = "eccentricity"
    family: ClassVar[str] = "periodic"
    source: ClassVar[str] = "1 um off on a scale of 200 mm is 10 urad, 2 arcsec; ISO 230-7, ISO 230-2"
    alike: ClassVar[tuple[str, ...]] = ("gear-cyclic", "wobble", "higher-order-geometry")
    separate: ClassVar[str] = "a polygon and autocollimator, or a calibrated encoder on the axis, once around"
    example: ClassVar[Mapping[str, object]] = {"joint": "B", "harmonic": 2}

    harmonic: Annotated[int, Field(ge=1)] = 1
    oval: bool = False

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.joint,)

    @property
    def period(self) -> float:
        """Angle of one period, rad."""
        return 2 * math.pi / self.harmonic

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint = joint_as(machine, self.joint, "rotary", self.effect)
        both = waves(channel(self.joint), self.harmonic)
        if self.oval:
            both |= {f"{label}2": wave for label, wave in waves(channel(self.joint), 2 * self.harmonic).items()}
        return [EffectTerm(self.joint, label, "rad", along(joint, wave), 5e-5) for label, wave in both.items()]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        for joint in scene.rotary:
            yield from (cls(joint=joint.name, harmonic=k) for k in (1, 2, 3))
            yield cls(joint=joint.name, oval=True)
