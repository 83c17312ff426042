"""Joint compliance of an arm: twist of a rotary joint's gear under gravity.

Twist about the joint's axis in rad, per mm of lever of the weights it carries.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import hypot
from typing import ClassVar

from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect, along
from errormodel.effects.kinematics import Gravity, apply, lever, places, weights_behind
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import joint_as
from errormodel.machine import Machine, Shape

USUAL = 1e-6  # rad/mm of lever, of all weights together: 1 mrad at 1 m


class JointCompliance(JointEffect):
    """Twist about the joint's axis per lever of weight (rad/mm), for the tool and for each member behind the joint.

    A member's lever (mm) is that of its end. A hardening term is the cube of the mean lever over the square of the
    reach: gears stiffen under torque. With `payload` a term (rad per kg and mm) is the tool's lever times the column
    ``load``.
    """

    effect: ClassVar[str] = "joint-compliance"
    family: ClassVar[str] = "gravity"
    source: ClassVar[str] = "stiffness of arms' joints 1e4 to 1e6 N m/rad under 10 to 1000 N; 1 mrad at 1 m"
    alike: ClassVar[tuple[str, ...]] = ("eccentricity", "payload-sag", "cross-axis-compliance")
    separate: ClassVar[str] = "the same poses with two payloads, the arm stretched out and folded"
    asked: ClassVar[Mapping[str, int]] = {"load": 2}
    otherwise: ClassVar[str] = (
        "a level, or a second target near the joint, while the payload is put on and taken off, the arm stretched out"
    )
    example: ClassVar[Mapping[str, object]] = {"joint": "B", "gravity": "x"}

    gravity: Gravity = "-z"  # direction of gravity in the reference's axes
    payload: bool = False

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.joint, "load") if self.payload else (self.joint,)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint = joint_as(machine, self.joint, "rotary", self.effect)
        number, frames = machine.elements.index(joint), places(machine, channel)
        axis = apply(frames[number].turn, joint.axis)
        names, weights = zip(*weights_behind(machine, joint, frames), strict=True)
        levers = [lever(axis, frames[number], weight, self.gravity) for weight in weights]
        out = [
            EffectTerm(self.joint, name, "rad/mm", along(joint, arm), USUAL / len(levers), low=0.0)
            for name, arm in zip(names, levers, strict=True)
        ]
        behind = [e for e in machine.elements[number + 1 :] if isinstance(e, Shape)]
        reach = sum(hypot(*e.offset) for e in behind) + hypot(*machine.tool) or 1.0
        mean = sum(levers) / len(levers)
        out.append(EffectTerm(self.joint, "hardening", "rad/mm", along(joint, mean * (mean / reach) ** 2), USUAL))
        if self.payload:
            out.append(
                EffectTerm(
                    self.joint, "payload", "rad/(kg mm)", along(joint, levers[0] * channel("load")), 3e-8, low=0.0
                )
            )
        return out

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        for joint in scene.rotary:
            for gravity in ("-x", "-y", "-z"):
                yield cls.model_validate({"joint": joint.name, "gravity": gravity, "payload": scene.varies("load")})
