"""Telescoping compliance: tilt of a member in its guide, which grows as the overlap of the two gets shorter.

Two bearings at the ends of the overlap under a moment; rotation in rad.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Annotated, ClassVar

from pydantic import Field

from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect, ShapeParameter
from errormodel.effects.ops import fmax
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import Rotation, across, joint_as
from errormodel.effects.travel import (
    TRAVEL_ENDS,
    End,
    extension,
    length,
    member_of,
    parallel,
    retracted_end,
    sag_direction,
    scaled,
    tilt_of,
    turn,
)
from errormodel.machine import Machine


class TelescopingCompliance(JointEffect):
    """Tilt of `joint` (rad fully extended): ``tilt * u * (shortest / overlap)^2``, with u from 0 retracted to 1.

    A second parameter (rad fully extended) is the tilt under a constant moment.
    """

    effect: ClassVar[str] = "telescoping-compliance"
    family: ClassVar[str] = "gravity"
    source: ClassVar[str] = "two bearings at the ends of the overlap l under a moment: 2 M / (k l^2); up to 0.2 mrad"
    alike: ClassVar[tuple[str, ...]] = ("ram-sag", "column-bending", "higher-order-geometry")
    separate: ClassVar[str] = "tilt sensors on both members while the joint extends"
    example: ClassVar[Mapping[str, object]] = {"joint": "Z", "motion": "ea", "overlap": 1600.0}

    motion: Rotation | None = None  # None: that of a sag along dz, or dy of a joint along z
    load_joint: str | None = None  # whose position makes the moment (-1 to 1 for u); None: the joint's own
    retracted: End | None = None  # end of travel with the longest overlap; None: that further from the tool's side
    # mm, retracted; None: 1.5 times the travel
    overlap: Annotated[float | None, ShapeParameter(said=False)] = Field(None, gt=0)

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.joint, self.load_joint) if self.load_joint else (self.joint,)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint = joint_as(machine, self.joint, "prismatic", self.effect)
        longest = self.overlap or 1.5 * length(joint)
        shortest = max(longest - length(joint), 0.02 * longest)
        u = extension(joint, channel(self.joint), retracted_end(machine, joint, self.retracted))
        give = (shortest / fmax(longest - u * length(joint), shortest)) ** 2
        load = joint_as(machine, self.load_joint, "prismatic", self.effect) if self.load_joint else None
        moment = scaled(load, channel(load.name)) if load else u
        tilt = turn(tilt_of(joint, sag_direction(joint, None)), 1.0) if self.motion is None else {self.motion: 1.0}
        return [
            EffectTerm(self.joint, label, "rad", {name: part * value for name, part in tilt.items()}, 5e-5)
            for label, value in (("", give * moment), ("constant", give))
        ]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        for joint in scene.prismatic:
            others = [j.name for j in scene.prismatic if j is not joint and parallel(j.axis, joint.axis)]
            if not others and member_of(scene.machine, joint) == "slide":  # whose guide carries all of it everywhere
                continue
            loads = [None, *others]
            for motion, end, ratio, load in product(across(joint, "e"), TRAVEL_ENDS, (1.1, 1.3, 1.8), loads):
                fields = {"motion": motion, "load_joint": load, "retracted": end, "overlap": ratio * length(joint)}
                yield cls.model_validate({"joint": joint.name, **fields})
