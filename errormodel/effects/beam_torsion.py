"""Beam torsion: twist of a beam under an overhanging load, largest at mid-span.

Saint-Venant torsion of a shaft held at both ends; rotation in rad about the beam's axis.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from errormodel.effects.base import Channels, Effect, EffectTerm
from errormodel.effects.ops import fmax
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import joint_as
from errormodel.effects.travel import crossing, fraction, scaled, turn
from errormodel.machine import Machine


class BeamTorsion(Effect):
    """Roll of `joint` about the beam: ``twist * v * 4 u (1 - u)`` in rad.

    u is the position along the beam (0 to 1), v the position on the load's travel (-1 to 1). A second parameter (rad)
    is the twist with the load at mid-travel, which has the same dependence on u.
    """

    effect: ClassVar[str] = "beam-torsion"
    family: ClassVar[str] = "gravity"
    source: ClassVar[str] = "shaft held at both ends: T a (L-a) / (L G J), T growing with the overhang; up to 0.2 mrad"
    alike: ClassVar[tuple[str, ...]] = ("cross-axis-compliance", "column-bending", "telescoping-compliance")
    separate: ClassVar[str] = (
        "a level on the carriage at both ends of the load's travel, in the beam's middle and at its ends"
    )
    example: ClassVar[Mapping[str, object]] = {"joint": "Y", "load_joint": "Z"}

    joint: str  # the joint that travels along the beam
    load_joint: str  # the joint that moves the load out

    @property
    def where(self) -> str:
        return self.joint

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.joint, self.load_joint)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        beam, load = (joint_as(machine, name, "prismatic", self.effect) for name in self.drivers)
        u, v = fraction(beam, channel(self.joint)), scaled(load, channel(self.load_joint))
        give = fmax(4 * u * (1 - u), 0)
        return [
            EffectTerm(self.joint, "", "rad", turn(beam.axis, give * v), 5e-5),
            EffectTerm(self.joint, "middle", "rad", turn(beam.axis, give), 5e-5),
        ]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        return (cls(joint=beam.name, load_joint=load.name) for beam, load in crossing(scene))
