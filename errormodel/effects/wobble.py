"""Wobble: tilt error motion of a rotary axis with one, two or three periods per revolution (ISO 230-7).

Rotation across the axis in rad, and displacement along it in mm.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from errormodel.conventions import ROTATIONS, Motion
from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect
from errormodel.effects.ops import Value
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import Rotation, across, joint_as, waves
from errormodel.effects.travel import cross, direction, shift
from errormodel.machine import Joint, Machine

TINY = 1e-9  # of a unit vector: no component


class Wobble(JointEffect):
    """Both tilts across the axis, or the `motion` alone, each with ``sin(harmonic q)`` and ``cos(harmonic q)``; rad.

    With a `whirl` the axis runs round a cone, ``harmonic`` times a revolution, the way it turns or against it.
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
    whirl: Literal["forward", "backward"] | None = None
    axial: bool = False

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if self.motion is not None and self.whirl is not None:
            raise ValueError("a wobble has a motion or a whirl: an axis that runs round a cone tilts both ways")
        return self

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
        if self.whirl:
            tilts = [*self._cone(joint, **both).items()]
        else:
            about = across(joint, "e") if self.motion is None else (self.motion,)
            tilts = [(label, {m: wave}) for m in about for label, wave in both.items()]
        terms = [EffectTerm(self.joint, label, "rad", tilt, 2e-5) for label, tilt in tilts]
        if self.axial:
            axis = shift(joint.axis, 1.0)
            moved = {label: {m: a * wave for m, a in axis.items()} for label, wave in both.items()}
            terms += [EffectTerm(self.joint, f"axial-{label}", "mm", m, 0.005) for label, m in moved.items()]
        return terms

    def _cone(self, joint: Joint, sin: Value, cos: Value) -> dict[str, dict[Motion, Value]]:
        """Tilts of an axis on a cone that begins at one of the two axes across it, and a quarter of a turn later."""
        x, y, z = cross(joint.axis, direction(across(joint, "e")[0]))
        length = math.hypot(x, y, z)
        second = (x / length, y / length, z / length)
        axes = [c for c in zip(ROTATIONS, cross(second, joint.axis), second, strict=True) if math.hypot(*c[1:]) > TINY]
        if self.whirl == "backward":
            axes = [(name, own, -other) for name, own, other in axes]
        return {
            "cos": {name: own * cos + other * sin for name, own, other in axes},
            "sin": {name: other * cos - own * sin for name, own, other in axes},
        }

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        for joint in scene.rotary:
            for harmonic in (1, 2, 3):
                yield from (cls(joint=joint.name, harmonic=harmonic, axial=axial) for axial in (False, True))
                for motion in across(joint, "e"):
                    yield cls(joint=joint.name, harmonic=harmonic, motion=motion)
                yield cls(joint=joint.name, harmonic=harmonic, whirl="forward")
                yield cls(joint=joint.name, harmonic=harmonic, whirl="backward")
