"""Cross-axis compliance: error motion of one joint as a smooth function of another joint's position.

Guides and frames deflect as weight moves over them. Units: mm and rad; positions scaled to the travel.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import permutations
from typing import ClassVar, Literal

from pydantic import Field

from errormodel.conventions import MOTIONS, ROTATIONS, TRANSLATIONS, Motion, unit_of
from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect
from errormodel.effects.ops import cos, sin
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import own_axes
from errormodel.effects.travel import legendre, scaled
from errormodel.machine import Machine, joint_of

# candidates (degree, `along`) by the type of the other joint; by judgement: stiffness varies smoothly
COMPLIANCE_SHAPES = {
    "prismatic": ((1, False), (2, False), (3, False), (5, False), (1, True), (2, True)),
    "rotary": ((1, False), (2, False), (1, True)),
}
WHOLE_DEGREES = 1, 2, 3  # candidates of a carriage that moves and tilts, all of them `along`
SIZES = 0.02, 1e-4  # standard deviations: mm, rad
# log prior odds, 10 to 1, against a joint that turns, of which the own wobble looks alike: of eight compliances that
# three authors made none is by such a joint
ROTATED = 2.3
# cosine of the angle between a turning axis and a translation, from which on the turn leaves the translation unchanged
PARALLEL_COSINE = 1 - 1e-6


class CrossAxisCompliance(JointEffect):
    """`motion` (mm, rad) in Legendre polynomials of the `other` joint's travel (-1 to 1), or in harmonics of its angle.

    With `along` a product term adds compliance that differs along the joint's own travel. With motion ``all`` each of
    the six moves, as of a carriage that is pressed aside and tilts: each polynomial then has its product.
    """

    effect: ClassVar[str] = "cross-axis-compliance"
    family: ClassVar[str] = "gravity"
    source: ClassVar[str] = "guides and frames give way as weight moves over them; up to 0.3 mrad"
    alike: ClassVar[tuple[str, ...]] = ("gantry-racking", "column-bending", "beam-torsion", "higher-order-geometry")
    separate: ClassVar[str] = "a level or a second target on the joint while only the other joint travels"
    example: ClassVar[Mapping[str, object]] = {"joint": "X", "motion": "ec", "other": "Y"}
    flexible: ClassVar[bool] = True

    motion: Motion | Literal["all"]
    other: str
    degree: int = Field(2, ge=1, le=5)
    along: bool = False  # compliance differs along the joint's own travel

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.other, self.joint) if self.along else (self.other,)

    def cost(self, scene: Scene) -> float:
        """Natural logarithm of the prior odds against it: a joint that turns moves little weight."""
        return ROTATED if joint_of(scene.machine, self.other).type == "rotary" else 0.0

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint = joint_of(machine, self.joint)
        other, q = joint_of(machine, self.other), channel(self.other)
        orders = range(1, self.degree + 1)
        if other.type == "rotary":
            shapes = {f"{name}{k}": f(k * q) for k in orders for name, f in (("sin", sin), ("cos", cos))}
        else:
            shapes = {str(k): legendre(k, scaled(other, q)) for k in orders}
        moves = MOTIONS if self.motion == "all" else (self.motion,)
        products = {}
        if self.along:
            own = scaled(joint, channel(self.joint))
            along = {f"along{k}": value * own for k, value in shapes.items()}
            products = along if self.motion == "all" else {"along": next(iter(along.values()))}
        return [
            EffectTerm(self.joint, label, unit_of(motion), {motion: value}, SIZES[motion in ROTATIONS])
            for label, value in (shapes | products).items()
            for motion in moves
        ]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        axes = own_axes(scene.machine)
        for joint, other in permutations(scene.moving, 2):
            # without a rotation between the two joints, a translation of one is collinear with the other's geometry
            first, last = sorted(scene.machine.elements.index(j) for j in (joint, other))
            turns = [j for j in scene.moving if j.type == "rotary" and j in scene.machine.elements[first:last]]
            seen = [axes[joint.name].T @ axes[j.name] @ j.axis for j in turns]  # turning axes in the joint's own axes
            turned = [t for k, t in enumerate(TRANSLATIONS) if any(abs(axis[k]) < PARALLEL_COSINE for axis in seen)]
            for motion in (*turned, *ROTATIONS):
                for degree, along in COMPLIANCE_SHAPES[other.type]:
                    yield cls(joint=joint.name, motion=motion, other=other.name, degree=degree, along=along)
            if joint.type == other.type == "prismatic":
                for degree in WHOLE_DEGREES:
                    yield cls(joint=joint.name, motion="all", other=other.name, degree=degree, along=True)
