"""Foundation compliance: tilt of the whole machine on its feet as a heavy axis travels, or an arm reaches out.

Rotation in rad of the measuring frame, or of the first element.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import ClassVar

from pydantic import Field

from errormodel.conventions import FRAME, ROTATIONS, Motion
from errormodel.effects.base import Channels, Effect, EffectTerm
from errormodel.effects.kinematics import Gravity, apply, lever, places, weights_behind
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import Rotation, across, joint_as
from errormodel.effects.travel import crossing, legendre, parallel, scaled
from errormodel.machine import Machine, Shape, Vector

# standard deviation in rad by polynomial degree; degrees 2 and 3 because feet and floor stiffen under load
TILT_SIZES_RAD = {1: 3e-5, 2: 1e-5, 3: 1e-5}
MOMENT_RAD_MM = 1e-7  # the same a mm of a weight's lever: 50 N on 5e8 N mm/rad
UPRIGHT_Z = 0.7  # log odds that z is upright: two machines of three, for it is the spindle's axis (ISO 841)
UPRIGHT: Mapping[str, Vector] = {"-x": (1.0, 0.0, 0.0), "-y": (0.0, 1.0, 0.0), "-z": (0.0, 0.0, 1.0)}


class GroundCompliance(Effect):
    """Tilt of `element` (rad) in Legendre polynomials up to a `degree` of the heavy axis' travel, scaled to -1 to 1.

    With `by`, a second axis, the ground yields unevenly along that: the first polynomial also has its product with the
    position of `by`, from -1 to 1.

    Of a rotary `joint` the tilt is that by the moment of the weights that it swings, about both axes across `gravity`:
    one parameter (rad/mm) for the tool's and each member's lever about the foot, at the member's end, and one by which
    the ground yields more about the first axis, by their mean lever.
    """

    effect: ClassVar[str] = "ground-compliance"
    family: ClassVar[str] = "gravity"
    source: ClassVar[str] = "moment of the moving mass on feet and floor; up to 0.1 mrad"
    alike: ClassVar[tuple[str, ...]] = ("column-bending", "cross-axis-compliance", "tracker-drift")
    separate: ClassVar[str] = "a level on the base, or targets on the floor, while the axis travels"
    example: ClassVar[Mapping[str, object]] = {"joint": "Y", "motion": "ea"}
    flexible: ClassVar[bool] = True

    joint: str  # the heavy axis; the first rotary joint of an arm that swings its weight up and down
    motion: Rotation | None = None  # None: about the first axis across it
    element: str = FRAME  # the element that tilts
    by: str | None = None
    degree: int = Field(3, ge=1, le=3)  # 1: an elastic ground
    gravity: Gravity = "-z"  # direction of gravity in the reference's axes, of a rotary joint

    @property
    def where(self) -> str:
        return self.element

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.joint, self.by) if self.by else (self.joint,)

    def cost(self, scene: Scene) -> float:
        """Natural logarithm of the prior odds against it: what travels up and down changes no moment on the ground."""
        own = (j for j in scene.prismatic if j.name in self.drivers)
        return UPRIGHT_Z if any(parallel(j.axis, UPRIGHT["-z"]) for j in own) else 0.0

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        if any(j.name == self.joint and j.type == "rotary" for j in machine.joints):
            return self._by_moment(channel, machine)
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

    def _by_moment(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        """Tilt by the moments of the weights that a rotary joint swings."""
        joint = joint_as(machine, self.joint, "rotary", self.effect)
        frames = places(machine, channel)
        names, weights = zip(*weights_behind(machine, joint, frames), strict=True)
        axes: Mapping[Motion, Vector] = {"ea": (1.0, 0.0, 0.0), "eb": (0.0, 1.0, 0.0), "ec": (0.0, 0.0, 1.0)}
        level = [m for m in axes if "xyz"["abc".index(m[1])] != self.gravity[-1]]
        moments = [{m: lever(axes[m], frames[0], w, self.gravity) for m in level} for w in weights]
        out = [
            EffectTerm(self.element, name, "rad/mm", moment, MOMENT_RAD_MM)
            for name, moment in zip(names, moments, strict=True)
        ]
        uneven = sum(moment[level[0]] for moment in moments) / len(moments)
        out.append(EffectTerm(self.element, "uneven", "rad/mm", {level[0]: uneven}, MOMENT_RAD_MM / 3))
        return out

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        first = scene.machine.elements[0]
        feet = (FRAME, first.name) if isinstance(first, Shape) else (FRAME,)  # a joint's tilt is its own compliance
        for heavy, motion, element, degree in product(scene.prismatic, ROTATIONS, feet, (1, 3)):
            yield cls(joint=heavy.name, motion=motion, element=element, degree=degree)
        if not scene.prismatic:
            every, frames = scene.machine.elements, places(scene.machine, lambda _: 0.0)
            axes = {j.name: apply(frames[every.index(j)].turn, j.axis) for j in scene.rotary}
            for gravity, upright in UPRIGHT.items():
                swings = next((name for name, axis in axes.items() if not parallel(axis, upright)), None)
                if swings is not None:
                    yield cls.model_validate({"joint": swings, "gravity": gravity})
        for (heavy, other), element in product(crossing(scene), feet):
            for motion in across(heavy, "e"):
                yield cls(joint=heavy.name, motion=motion, element=element, by=other.name)
