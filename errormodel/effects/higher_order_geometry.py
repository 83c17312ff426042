"""Higher-order geometry: terms of a joint's error motion beyond its declared polynomial, harmonic or spline model.

Legendre polynomials, harmonics or cubic B-splines in the joint's position. Units: mm and rad.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import product
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from errormodel.conventions import MOTIONS, TRANSLATIONS, Motion, iso_symbol, unit_of
from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect, axis_motion
from errormodel.effects.ops import Value
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import (
    POSITIONS_PER_PERIOD,
    Positive,
    across,
    bending,
    closed_splines,
    joint_as,
    resolved,
    splines,
    waves,
)
from errormodel.effects.travel import fraction, legendre, legendre_slope, length, scaled, usual_size
from errormodel.machine import Joint, Machine, joint_of

Degree = Annotated[int, Field(ge=0, le=30)]
# knot spacings of a rotary joint's positioning curve, rad; by judgement
FINE_SPACINGS_RAD = tuple(math.radians(d) for d in (10.0, 6.0, 4.0, 3.0, 2.0))
BROAD_SPACING_RAD = math.radians(30.0)  # knot spacing of a rotary joint's smooth curves, rad; by judgement
FINE_PIECES = (16, 32, 64, 128)  # knot intervals in the travel of a prismatic joint's positioning curve; by judgement
ROWS_PER_KNOT = 1.5  # fewest rows per knot; by judgement: with fewer the prior determines the curve
# size of a constant over that of an error motion; by judgement: members are assembled less exactly than guides are made
CONSTANT_SIZE_RATIO = 10.0


class HigherOrderGeometry(JointEffect):
    """`motion` of a joint in Legendre polynomials of its travel (-1 to 1), or in harmonics of its angle (mm, rad).

    Degree 0 is a constant: a squareness or an offset that the adjacent members' models leave out.

    With `every` (mm, rad) it is a curve: cubic B-splines at that spacing, with a zero-mean prior of standard deviation
    `size` (mm, rad). Beyond the measured range the curve returns to zero and its standard uncertainty to `size`. The
    curve of a joint that makes full revolutions is periodic.

    With `slope` a straightness comes with the rotation of its slope: a carriage that follows a bent guide.
    """

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
    flexible: ClassVar[bool] = True

    motion: Motion
    degrees: tuple[Degree, ...] = ()  # (): one above the declared model
    every: Positive | None = None
    size: Positive | None = None  # None: 20 um, 30 urad
    slope: bool = False

    @model_validator(mode="after")
    def _of_a_straightness(self) -> Self:
        if self.slope and (self.motion not in TRANSLATIONS or self.every or 0 in self.degrees):
            raise ValueError("a slope is that of a straightness in polynomials: motion: dy, degrees: [3]")
        return self

    @property
    def drivers(self) -> tuple[str, ...]:
        return () if self.degrees == (0,) else (self.joint,)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint = joint_as(machine, self.joint, "prismatic", self.effect) if self.slope else joint_of(machine, self.joint)
        q = channel(self.joint)
        unit, size = unit_of(self.motion), self.size or usual_size(self.motion)
        if self.every:
            splines = curve(joint, q, self.every)
            return [EffectTerm(self.joint, str(k), unit, {self.motion: s}, size) for k, s in enumerate(splines)]
        shapes = dict[str, Value]()
        for n in self.degrees or (declared(joint, self.motion) + 1,):
            if n == 0:
                shapes["0"] = 0 * q + 1
                size = CONSTANT_SIZE_RATIO * size
            elif joint.type == "prismatic":
                shapes[str(n)] = legendre(n, scaled(joint, q))
            else:
                shapes |= {f"{name}{n}": wave for name, wave in waves(q, n).items()}
        moved = {label: {self.motion: value} for label, value in shapes.items()}
        if self.slope:
            rates = {label: 2 / length(joint) * legendre_slope(int(label), scaled(joint, q)) for label in shapes}
            moved = {label: bending(joint, self.motion, shapes[label], rate) for label, rate in rates.items()}
        return [EffectTerm(self.joint, label, unit, motion, size) for label, motion in moved.items()]

    @property
    def random(self) -> bool:
        return self.every is not None

    @property
    def motion_form(self) -> str:
        """The motion and the degree, where it is one and bends: degree 1 of a straightness is a squareness."""
        one = len(self.degrees) == 1 and self.degrees[0] > 1 and not self.every
        return f"{iso_symbol(self.joint, self.motion)} of degree {self.degrees[0]}" if one else ""

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        for joint, motion in product(scene.moving, MOTIONS):
            yield cls(joint=joint.name, motion=motion, degrees=(0,))
            n = declared(joint, motion) + 1
            sets = [(n,), (n + 1,), (n, n + 1)] + ([(n, n + 1, n + 2)] if joint.type == "prismatic" else [])
            yield from (cls(joint=joint.name, motion=motion, degrees=degrees) for degrees in sets)
            if joint.type == "prismatic" and motion in across(joint, "d"):
                bent = [*sets, (n, n + 1, n + 2, n + 3)]
                yield from (cls(joint=joint.name, motion=motion, degrees=degrees, slope=True) for degrees in bent)
        for joint in scene.moving:
            rows, span = len(scene.columns[joint.name]), float(np.ptp(scene.span(joint)))
            for every in FINE_SPACINGS_RAD if joint.type == "rotary" else (length(joint) / n for n in FINE_PIECES):
                if (
                    resolved(scene, joint, every) <= POSITIONS_PER_PERIOD * every
                    and span / every < rows / ROWS_PER_KNOT
                ):
                    yield cls(joint=joint.name, motion=axis_motion(joint), every=every)
            for motion in MOTIONS:
                yield cls(
                    joint=joint.name,
                    motion=motion,
                    every=BROAD_SPACING_RAD if joint.type == "rotary" else length(joint) / 8,
                )


def curve(joint: Joint, q: Value, every: float) -> Iterator[Value]:
    """Cubic B-splines over a joint's travel, or its full revolution, at a spacing of about `every` (mm, rad)."""
    if joint.type == "rotary" and length(joint) > 1.99 * math.pi:
        yield from closed_splines(q, max(round(2 * math.pi / every), 5))
    else:
        yield from splines(fraction(joint, q), max(round(length(joint) / every), 2))


def declared(joint: Joint, motion: Motion) -> int:
    """Highest polynomial degree (prismatic) or harmonic (rotary) that the machine's model of a motion has."""
    from errormodel.joint_models import registry

    basis = joint.models.get(motion)
    return 0 if basis is None else registry()[basis.kind].order(joint, basis.n)
