"""Contact knee: piecewise linear error motion where a one-sided contact opens or closes.

Examples are covers, stops and lifting guides. Units: mm or rad per travel of the joint.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import model_validator

from errormodel.conventions import MOTIONS, Motion, unit_of
from errormodel.effects.base import PLACE, Channels, Effect, EffectTerm, JointEffect
from errormodel.effects.ops import fmax
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import across, each_motion, joint_as, tilting
from errormodel.effects.travel import length, usual_size
from errormodel.machine import Machine, joint_of

# candidate positions, evenly spaced over the travel; by judgement: closer knees are nearly collinear
KNEE_POSITIONS = 16
Side = Literal["above", "below"]
SIDES: tuple[Side, Side] = ("above", "below")


class ContactKnee(JointEffect):
    """`motion` proportional to the distance beyond `at` (mm or rad per full travel), zero on the other side of `at`.

    With `tilt` a linear carriage that leaves one of its pads both moves aside and tilts about the axis across both: a
    second parameter is that rotation, in proportion to the same distance. With motion ``all`` each of the six moves so.
    """

    effect: ClassVar[str] = "contact-knee"
    family: ClassVar[str] = "geometric"
    source: ClassVar[str] = "one-sided contact: covers, stops, lifting guides; 5 to 50 um, up to 0.1 mrad"
    alike: ClassVar[tuple[str, ...]] = ("higher-order-geometry", "local-defect", "telescoping-compliance")
    separate: ClassVar[str] = "a dial gauge at the contact, and positions close together around the knee, both ways"
    example: ClassVar[Mapping[str, object]] = {"joint": "X", "motion": "dz", "at": 1400.0}

    motion: Motion | Literal["all"]
    at: Annotated[float, PLACE]  # mm or rad
    side: Side = "above"
    tilt: bool = False

    @model_validator(mode="after")
    def _one_motion(self) -> Self:
        if self.motion == "all" and self.tilt:
            raise ValueError("with tilt a carriage moves aside in one motion: motion: dz")
        return self

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.joint,)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint, sense = joint_of(machine, self.joint), 1 if self.side == "above" else -1
        beyond = fmax(sense * (channel(self.joint) - self.at), 0) / length(joint)
        if self.motion == "all":
            return each_motion(self.joint, MOTIONS, beyond, (2 * usual_size("dx"), 2 * usual_size("ea")))
        out = [EffectTerm(self.joint, "", unit_of(self.motion), {self.motion: beyond}, 2 * usual_size(self.motion))]
        if self.tilt:
            carriage = joint_as(machine, self.joint, "prismatic", self.effect)
            tilt = tilting(carriage, self.motion, beyond)
            out.append(EffectTerm(self.joint, "tilt", "rad", tilt, 2 * usual_size("ea")))
        return out

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        for joint in scene.moving:
            for at in np.linspace(*scene.span(joint), KNEE_POSITIONS + 2)[1:-1].tolist():
                if joint.type == "prismatic":
                    yield cls(joint=joint.name, motion="all", at=at)
                for motion in MOTIONS:
                    # both sides differ by a straight line: where the geometry has one, the two are collinear
                    straight = joint.type == "prismatic" and motion in joint.models
                    for side in SIDES[:1] if straight else SIDES:
                        yield cls(joint=joint.name, motion=motion, at=at, side=side)
                        if joint.type == "prismatic" and motion in across(joint, "d"):
                            yield cls(joint=joint.name, motion=motion, at=at, side=side, tilt=True)
