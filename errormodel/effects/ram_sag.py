"""Ram sag: deflection of a ram or quill as a cantilever whose free length grows with the extension.

Euler-Bernoulli cantilever; deflection in mm, slope in rad.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Annotated, ClassVar

from pydantic import Field

from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect, ShapeParameter
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import across, bending, joint_as
from errormodel.effects.travel import (
    TRAVEL_ENDS,
    End,
    Translation,
    extension,
    length,
    member_of,
    retracted_end,
    sag_direction,
    tilt_of,
    turn,
)
from errormodel.machine import Machine


class RamSag(JointEffect):
    """Deflection ``sag * u^exponent`` along `motion` (mm at full extension), with the slope at a cantilever's end.

    u is the extension, 0 retracted to 1. A second parameter (rad at full extension) is a slope beyond that of the
    deflection, from compliant guides.
    """

    effect: ClassVar[str] = "ram-sag"
    family: ClassVar[str] = "gravity"
    source: ClassVar[str] = "cantilever: end load P u^3/3EI, own weight w u^4/8EI, end moment M u^2/2EI; up to 0.1 mm"
    alike: ClassVar[tuple[str, ...]] = ("higher-order-geometry", "telescoping-compliance", "payload-sag")
    separate: ClassVar[str] = "the same positions with two tools of different weight, and with two tool lengths"
    example: ClassVar[Mapping[str, object]] = {"joint": "Z", "motion": "dy"}

    motion: Translation | None = None  # None: dz, or dy of a ram along z
    retracted: End | None = None  # end of travel at which the ram is in; None: that further from the tool's side
    # 2 end moment, 3 weight at the end, 4 own weight
    exponent: Annotated[float, ShapeParameter("1", said=False)] = Field(3.0, ge=1.5, le=4.5)

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.joint,)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        ram, p = joint_as(machine, self.joint, "prismatic", self.effect), self.exponent
        motion, end = sag_direction(ram, self.motion), retracted_end(machine, ram, self.retracted)
        u, sense = extension(ram, channel(self.joint), end), 1 if end == "low" else -1
        # for u^2, u^3 and u^4 the slope at the end is 2, 3/2 and 4/3 times sag over length, i.e. p / (p - 1)
        slope = sense * u ** (p - 1)
        sag = bending(ram, motion, u**p, p / (p - 1) / length(ram) * slope)
        return [
            EffectTerm(self.joint, "", "mm", sag, 0.05),
            EffectTerm(self.joint, "slope", "rad", turn(tilt_of(ram, motion), slope), 5e-5),
        ]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        for ram in scene.prismatic:
            if member_of(scene.machine, ram) == "slide":
                continue
            for motion, end, exponent in product(across(ram, "d"), TRAVEL_ENDS, (2.0, 3.0, 4.0)):
                yield cls.model_validate({"joint": ram.name, "motion": motion, "retracted": end, "exponent": exponent})
