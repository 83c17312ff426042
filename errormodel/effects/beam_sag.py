"""Beam sag: deflection of a beam supported at both ends under the carriage that travels along it.

Euler-Bernoulli beam under a travelling load; deflection in mm across the beam, slope in rad.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Annotated, ClassVar

from pydantic import Field

from errormodel.effects.base import Channels, Effect, EffectTerm, ShapeParameter
from errormodel.effects.ops import fmax
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import across, bending, joint_as
from errormodel.effects.travel import Translation, fraction, length, member_of, sag_direction, tilt_of, turn
from errormodel.machine import Machine


class BeamSag(Effect):
    """Deflection ``sag * (4 u (1 - u))^exponent`` along `motion` (mm at mid-travel), with the slope of the beam there.

    u is the position on the travel, 0 to 1. A second parameter (rad) is a slope beyond that of the deflection: of the
    beam's own weight, or of supports that are clamped or compliant.
    """

    effect: ClassVar[str] = "beam-sag"
    family: ClassVar[str] = "gravity"
    source: ClassVar[str] = "beam under a travelling load: P a^2 (L-a)^2 / 3EIL, clamped ends a^3 (L-a)^3; up to 0.1 mm"
    alike: ClassVar[tuple[str, ...]] = ("higher-order-geometry", "thermal-bending", "rail-waviness")
    separate: ClassVar[str] = "straightness along the beam with and without a weight on the carriage"
    example: ClassVar[Mapping[str, object]] = {"joint": "Y"}

    joint: str  # that travels along the beam
    motion: Translation | None = None  # None: dz, or dy of a beam along z
    # 1.2 dead weight, 2 travelling load, 3 clamped ends: no ends are stiffer
    exponent: Annotated[float, ShapeParameter("1", said=False)] = Field(2.0, ge=1, le=3)

    @property
    def where(self) -> str:
        return self.joint

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.joint,)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        beam, p = joint_as(machine, self.joint, "prismatic", self.effect), self.exponent
        motion, u = sag_direction(beam, self.motion), fraction(beam, channel(self.joint))
        arch = fmax(4 * u * (1 - u), 0)
        tilt = arch ** (p - 1) * (1 - 2 * u)
        # under a travelling load the beam's own angle is half the slope of the carriage's path
        sag = bending(beam, motion, arch**p, 2 * p / length(beam) * tilt)
        return [
            EffectTerm(self.joint, "", "mm", sag, 0.05),
            EffectTerm(self.joint, "slope", "rad", turn(tilt_of(beam, motion), tilt), 5e-5),
        ]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        for beam in scene.prismatic:
            if member_of(scene.machine, beam) == "ram":
                continue
            for motion, exponent in product(across(beam, "d"), (1.2, 2.0, 3.0)):
                yield cls.model_validate({"joint": beam.name, "motion": motion, "exponent": exponent})
