"""Higher-order geometry: an error motion of a joint is less smooth than its declared model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Annotated, ClassVar

from pydantic import Field

from errormodel.conventions import MOTIONS, Motion, unit_of
from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect
from errormodel.effects.scene import Scene
from errormodel.effects.shared import waves
from errormodel.effects.travel import legendre, scaled, usual_size
from errormodel.machine import Joint, Machine, joint_of

Degree = Annotated[int, Field(ge=1, le=30)]


class HigherOrderGeometry(JointEffect):
    """`motion` of a joint as Legendre polynomials of its travel, -1 to 1, or as harmonics of its turn (mm, rad)."""

    effect: ClassVar[str] = "higher-order-geometry"
    family: ClassVar[str] = "geometric"
    source: ClassVar[str] = "ISO 230-1 error motions of guides and bearings: 20 um, 30 urad"
    alike: ClassVar[tuple[str, ...]] = (
        "ram-sag",
        "beam-sag",
        "rail-waviness",
        "wobble",
        "eccentricity",
        "contact-knee",
    )
    separate: ClassVar[str] = "the error motion of this joint alone, measured directly at four times as many positions"
    example: ClassVar[Mapping[str, object]] = {"joint": "X", "motion": "dy"}

    motion: Motion
    degrees: tuple[Degree, ...] = ()  # (): the one above the declared model

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.joint,)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint, q = joint_of(machine, self.joint), channel(self.joint)
        shapes = {}
        for n in self.degrees or (declared(joint, self.motion) + 1,):
            if joint.type == "prismatic":
                shapes[str(n)] = legendre(n, scaled(joint, q))
            else:
                shapes |= {f"{name}{n}": wave for name, wave in waves(q, n).items()}
        unit, size = unit_of(self.motion), usual_size(self.motion)
        return [EffectTerm(self.joint, label, unit, {self.motion: value}, size) for label, value in shapes.items()]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        for joint, motion in product(scene.moving, MOTIONS):
            n = declared(joint, motion) + 1
            sets = [(n,), (n + 1,), (n, n + 1)] + ([(n, n + 1, n + 2)] if joint.type == "prismatic" else [])
            for degrees in sets:
                yield cls(joint=joint.name, motion=motion, degrees=degrees)


def declared(joint: Joint, motion: Motion) -> int:
    """Highest polynomial degree (prismatic) or harmonic (rotary) that the machine's model of a motion has."""
    basis = joint.models.get(motion)
    if basis is None:
        return 0
    if joint.type == "rotary":
        return basis.n if basis.kind == "harmonic" else 0
    return basis.n + 3 if basis.kind == "spline" else basis.n
