"""Wobble: tilt error motion of a rotary axis with one, two or three periods per revolution (ISO 230-7).

Rotation across the axis in rad, and displacement along it in mm.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar

from pydantic import Field

from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import Rotation, across, joint_as, waves
from errormodel.effects.travel import shift
from errormodel.machine import Machine


class Wobble(JointEffect):
    """Both tilts across the axis, or the `motion` alone, each with ``sin(harmonic q)`` and ``cos(harmonic q)``; rad.

    With `axial` the axial error motion (mm) of the same period, too, as of a bearing face that is not flat.
    """

    effect: ClassVar[str] = "wobble"
    family: ClassVar[str] = "periodic"
    source: ClassVar[str] = "ISO 230-7 tilt error motion: 1 to 30 urad on rotary tables"
    alike: ClassVar[tuple[str, ...]] = ("eccentricity", "higher-order-geometry", "structure-drift")
    separate: ClassVar[str] = "an electronic level or two indicators on a plate on the table, once around"
    example: ClassVar[Mapping[str, object]] = {"joint": "B", "harmonic": 2}

    harmonic: Annotated[int, Field(ge=1)] = 1
    motion: Rotation | None = None
    axial: bool = False

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
        tilts = across(joint, "e") if self.motion is None else (self.motion,)
        terms = [EffectTerm(self.joint, label, "rad", {m: wave}, 2e-5) for m in tilts for label, wave in both.items()]
        if self.axial:
            axis = shift(joint.axis, 1.0)
            moved = {label: {m: a * wave for m, a in axis.items()} for label, wave in both.items()}
            terms += [EffectTerm(self.joint, f"axial-{label}", "mm", m, 0.005) for label, m in moved.items()]
        return terms

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        for joint in scene.rotary:
            for harmonic in (1, 2, 3):
                yield from (cls(joint=joint.name, harmonic=harmonic, axial=axial) for axial in (False, True))
                for motion in across(joint, "e"):
                    yield cls(joint=joint.name, harmonic=harmonic, motion=motion)
