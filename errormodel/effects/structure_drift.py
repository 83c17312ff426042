"""Structure drift: thermal displacement or tilt of a member of the machine (ISO 230-3).

Units: mm/K and rad/K.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations, product
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from errormodel.conventions import FRAME, MOTIONS, ROTATIONS, TRANSLATIONS, Motion, unit_of
from errormodel.effects.base import Channels, Effect, EffectTerm
from errormodel.effects.ops import Value
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import Initial, Lag, Positive, each_motion, lags, members, thermal, warmth
from errormodel.effects.travel import polynomials, scaled
from errormodel.machine import Machine, Shape, Vector, joint_of

SIZES = 0.01, 1e-5  # usual ones per K, mm and rad


class StructureDrift(Effect):
    """``drift * (temperature - 20)`` in one `motion` of a member, mm/K or rad/K, or with ``all`` in each of the six.

    `tau` (s) is the member's lag behind the sensor, `initial` (K) how much warmer than it it was in the first row,
    `minus` a sensor in place of 20 degC. At a joint, `order` lets the drift vary along the travel in Legendre
    polynomials up to that degree (-1 to 1). `std` is the standard deviation of a zero-mean prior, for several sensors
    that are nearly collinear. A rotation is `about` a point (mm, from the element's origin, in its axes); without it
    about that origin, which of a shape is its tool-side end: a column on its foot tilts about the other.
    """

    effect: ClassVar[str] = "structure-drift"
    family: ClassVar[str] = "thermal"
    source: ClassVar[str] = (
        "1 m of steel or cast iron grows by 10 to 12 um/K, and tilts where one side is warmer; ISO 230-3"
    )
    alike: ClassVar[tuple[str, ...]] = ("tracker-drift", "thermal-squareness", "spindle-growth", "warm-up")
    separate: ClassVar[str] = "levels on the member, or targets on both sides of it, measured again and again"
    example: ClassVar[Mapping[str, object]] = {"element": "T1", "motion": "dx", "sensor": "T_bed"}

    element: str
    motion: Motion | Literal["all"]
    sensor: str
    minus: str | None = None
    tau: Lag = 0.0
    initial: Initial = 0.0
    about: Vector | None = None
    order: int = Field(0, ge=0, le=5)
    std: Positive | None = None

    @model_validator(mode="after")
    def _one_motion(self) -> Self:
        if self.motion == "all" and (self.about is not None or self.order or self.std is not None):
            raise ValueError("with about, order or std a member has one motion: motion: ea")
        return self

    @property
    def where(self) -> str:
        return self.element

    @property
    def drivers(self) -> tuple[str, ...]:
        return thermal(self.sensor, self.minus)

    @property
    def random(self) -> bool:
        return self.std is not None

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        warm = warmth(channel, self.sensor, self.minus, self.tau, self.initial)
        if self.motion == "all":
            return each_motion(self.element, MOTIONS, warm, SIZES, "/K")
        unit = f"{unit_of(self.motion)}/K"
        size = self.std or SIZES[self.motion not in TRANSLATIONS]
        # the label names the sensor, so that several random effects at one element differ
        name = f"{self.sensor}{f'-{self.tau:g}s' if self.tau else ''}" if self.random else ""
        if not self.order:
            return [EffectTerm(self.element, name, unit, self._turned(self.motion, warm), size)]
        joint = joint_of(machine, self.element)
        shapes = polynomials(self.order, scaled(joint, channel(joint.name)))
        return [
            EffectTerm(self.element, f"{name}-{n}" if name else str(n), unit, {self.motion: warm * shape}, size)
            for n, shape in enumerate(shapes)
        ]

    def _turned(self, motion: Motion, angle: Value) -> dict[Motion, Value]:
        """The motion; for a rotation about another point also the displacement of the element's origin."""
        if self.about is None or motion not in ROTATIONS:
            return {motion: angle}
        axis = np.array([float(m == motion) for m in ROTATIONS])
        away = np.cross(self.about, axis)
        return {motion: angle} | {m: angle * float(d) for m, d in zip(TRANSLATIONS, away, strict=True) if d}

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        for element in members(scene.machine):
            for motion in (*MOTIONS, "all"):
                yield from _by_sensors(scene, element, motion)
        for shape in scene.machine.shapes:
            foot = tuple(-v for v in shape.offset)
            for motion, axis in zip(ROTATIONS, np.eye(3), strict=True):
                if np.cross(foot, axis).any():
                    for sensor in scene.sensors:
                        yield from _lagging(scene, element=shape.name, motion=motion, about=foot, sensor=sensor)
        for motion in _base(scene.machine):
            yield from _by_sensors(scene, FRAME, motion)
            if motion in ROTATIONS:  # a stand, the machine's or the instrument's, tilts when one side is warmer
                for about, (sensor, minus) in product(
                    (None, *filter(any, scene.stations)), combinations(scene.sensors, 2)
                ):
                    yield from _lagging(scene, element=FRAME, motion=motion, about=about, sensor=sensor, minus=minus)


def _by_sensors(scene: Scene, element: str, motion: str) -> Iterator[Effect]:
    for sensor in scene.sensors:
        yield from _lagging(scene, element=element, motion=motion, sensor=sensor)


def _lagging(scene: Scene, **fields: object) -> Iterator[Effect]:
    for tau in lags(scene):
        yield StructureDrift.model_validate({**fields, "tau": tau})


def _base(machine: Machine) -> tuple[Motion, ...]:
    """Motions of a base outside the chain, or of the instrument's stand, which is indistinguishable from it.

    Before a prismatic joint the base's displacements are those of the next member and are proposed there.
    """
    first = machine.elements[0]
    if isinstance(first, Shape):
        return ()
    return ROTATIONS if first.type == "prismatic" else MOTIONS
