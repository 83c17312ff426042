"""Column bending: tilt of a column under a load that travels out to its side.

Euler-Bernoulli cantilever under an end moment; rotation in rad, displacement in mm.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import ClassVar, Self

from pydantic import model_validator

from errormodel.effects.base import Channels, Effect, EffectTerm
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import Rotation, across, joint_as
from errormodel.effects.travel import (
    TRAVEL_ENDS,
    End,
    cross,
    crossing,
    direction,
    extension,
    length,
    scaled,
    shift,
    turn,
)
from errormodel.exceptions import InputError
from errormodel.machine import Joint, Machine


class ColumnBending(Effect):
    """Tilt of the column's carriage ``tilt * v`` in rad at the end of the load's travel; v is its position, -1 to 1.

    With a `foot` the column bends from that end of its travel: ``tilt * v * h``, with h from 0 to 1 along the column,
    and the displacement of that curvature is added. With `overhang` there are two more: the moment that the load has at
    mid-travel, ``rest * h``, and the column below its own travel, ``below * v``, of which the tilt displaces what is
    above it.
    """

    effect: ClassVar[str] = "column-bending"
    family: ClassVar[str] = "gravity"
    source: ClassVar[str] = "cantilever under a moment: angle M h/EI, deflection M h^2/2EI; up to 0.2 mrad"
    alike: ClassVar[tuple[str, ...]] = ("cross-axis-compliance", "ground-compliance", "beam-torsion")
    separate: ClassVar[str] = "levels at the column's foot and on its carriage while only the load travels"
    example: ClassVar[Mapping[str, object]] = {"joint": "Z", "load_joint": "X"}

    joint: str  # the joint that travels along the column
    load_joint: str  # the joint that moves the load out
    motion: Rotation | None = None  # None: about the axis perpendicular to both joints
    foot: End | None = None  # None: the whole column tilts at its foot
    overhang: bool = False

    @model_validator(mode="after")
    def _bends(self) -> Self:
        if self.overhang and self.foot is None:
            raise ValueError("what overhangs bends the column from its foot: write foot: low or foot: high as well")
        return self

    @property
    def where(self) -> str:
        return self.joint

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.load_joint,) if self.foot is None else (self.load_joint, self.joint)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        column, load = (joint_as(machine, n, "prismatic", self.effect) for n in (self.joint, self.load_joint))
        about, v = self._about(column, load), scaled(load, channel(self.load_joint))
        if self.foot is None:
            return [EffectTerm(self.joint, "", "rad", turn(direction(about), v), 5e-5)]
        h, sense = extension(column, channel(self.joint), self.foot), 1 if self.foot == "low" else -1
        towards, reach = cross(direction(about), column.axis), sense * length(column)
        curves = {"": (v * h, v * h**2 / 2)}
        if self.overhang:
            curves |= {"rest": (h, h**2 / 2), "below": (v, v * h)}
        return [
            EffectTerm(self.joint, label, "rad", turn(direction(about), tilt) | shift(towards, reach * bow), 5e-5)
            for label, (tilt, bow) in curves.items()
        ]

    def _about(self, column: Joint, load: Joint) -> Rotation:
        if self.motion is not None:
            return self.motion
        normal = cross(column.axis, load.axis)
        if not any(abs(n) > 0.1 for n in normal):
            raise InputError(
                f"effect {self.effect}", f"{load.name} travels along {column.name}", "Write a joint across it"
            )
        names: tuple[Rotation, ...] = ("ea", "eb", "ec")
        return names[max(range(3), key=lambda k: abs(normal[k]))]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        for column, load in crossing(scene):
            for motion, foot in product(across(column, "e"), (None, *TRAVEL_ENDS)):
                fields = {"joint": column.name, "load_joint": load.name, "motion": motion, "foot": foot}
                yield cls.model_validate(fields)
                if foot is not None:
                    yield cls.model_validate(fields | {"overhang": True})
