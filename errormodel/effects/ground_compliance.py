"""Foundation compliance: tilt of the whole machine on its feet as a heavy axis travels.

Rotation in rad of the measuring frame, or of the first element.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import ClassVar

from pydantic import Field

from errormodel.conventions import FRAME, ROTATIONS
from errormodel.effects.base import Channels, Effect, EffectTerm
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import Rotation, across, joint_as
from errormodel.effects.travel import crossing, legendre, scaled
from errormodel.machine import Machine, Shape

# standard deviation in rad by polynomial degree; degrees 2 and 3 because feet and floor stiffen under load
TILT_SIZES_RAD = {1: 3e-5, 2: 1e-5, 3: 1e-5}


class GroundCompliance(Effect):
    """Tilt of `element` (rad) in Legendre polynomials up to a `degree` of the heavy axis' travel, scaled to -1 to 1.

    With `by`, a second axis, the ground yields unevenly along that: the first polynomial also has its product with the
    position of `by`, from -1 to 1.
    """

    effect: ClassVar[str] = "ground-compliance"
    family: ClassVar[str] = "gravity"
    source: ClassVar[str] = "moment of the moving mass on feet and floor; up to 0.1 mrad"
    alike: ClassVar[tuple[str, ...]] = ("column-bending", "cross-axis-compliance", "tracker-drift")
    separate: ClassVar[str] = "a level on the base, or targets on the floor, while the axis travels"
    example: ClassVar[Mapping[str, object]] = {"joint": "Y", "motion": "ea"}
    flexible: ClassVar[bool] = True

    joint: str  # the heavy axis
    motion: Rotation | None = None  # None: about the first axis across it
    element: str = FRAME  # the element that tilts
    by: str | None = None
    degree: int = Field(3, ge=1, le=3)  # 1: an elastic ground

    @property
    def where(self) -> str:
        return self.element

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.joint, self.by) if self.by else (self.joint,)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        heavy = joint_as(machine, self.joint, "prismatic", self.effect)
        motion = self.motion or across(heavy, "e")[0]
        u = scaled(heavy, channel(self.joint))
        out = [
            EffectTerm(self.element, str(n), "rad", {motion: legendre(n, u)}, size)
            for n, size in TILT_SIZES_RAD.items()
            if n <= self.degree
        ]
        if self.by:
            other = joint_as(machine, self.by, "prismatic", self.effect)
            uneven = scaled(other, channel(self.by)) * u
            out.append(EffectTerm(self.element, "by", "rad", {motion: uneven}, TILT_SIZES_RAD[1]))
        return out

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        first = scene.machine.elements[0]
        places = (FRAME, first.name) if isinstance(first, Shape) else (FRAME,)  # a joint's tilt is its own compliance
        for heavy, motion, element, degree in product(scene.prismatic, ROTATIONS, places, (1, 3)):
            yield cls(joint=heavy.name, motion=motion, element=element, degree=degree)
        for (heavy, other), element in product(crossing(scene), places):
            for motion in across(heavy, "e"):
                yield cls(joint=heavy.name, motion=motion, element=element, by=other.name)
