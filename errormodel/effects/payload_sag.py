"""Payload sag: deflection or tilt proportional to the payload, varying along a joint's travel.

Units: mm/kg and rad/kg, times the column ``load`` in kg; of a lever rad/(kg mm), or rad/mm of loads by run.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from errormodel.conventions import MOTIONS, TRANSLATIONS, Motion, unit_of
from errormodel.effects.base import Channels, Effect, EffectTerm, along
from errormodel.effects.kinematics import Gravity, apply, lever, places
from errormodel.effects.ops import Value, cos, sin
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import joint_as, run_channels
from errormodel.effects.travel import legendre, sag_direction, scaled
from errormodel.machine import Machine, joint_of

MOST_RUNS = 6  # in which loads that were not recorded are looked for: of more, runs are no loads; by judgement


class PayloadSag(Effect):
    """`motion` per kg of the column ``load`` (mm/kg, rad/kg), in Legendre polynomials of the travel up to `degree`.

    At an `element` in place of a `joint`, such as a pallet, it is the same everywhere.

    For a rotary joint: a constant, and unless `degree` is 0 the sine and cosine of its angle. With `gravity` it twists
    about its own axis by the load's lever there (rad per kg and mm), as the pose of all joints makes it. Of a load that
    was not recorded and differs from run to run, `run` names the runs, each with a load of its own (rad per mm), more
    or less than that of the others.
    """

    effect: ClassVar[str] = "payload-sag"
    family: ClassVar[str] = "gravity"
    source: ClassVar[str] = "stiffness of machine tools at the tool, 10 to 100 N/um, of arms 1 N/um"
    alike: ClassVar[tuple[str, ...]] = ("ram-sag", "joint-compliance", "target-offset")
    separate: ClassVar[str] = "the same positions with no load and with two loads"
    asked: ClassVar[Mapping[str, int]] = {"load": 3}
    otherwise: ClassVar[str] = "a level, or a second target on the member, while the loads are put on and taken off"
    example: ClassVar[Mapping[str, object]] = {"joint": "Y"}

    joint: str | None = None
    element: str | None = None
    motion: Motion | None = None  # None: dz, or dy for a joint along z
    degree: Annotated[int, Field(ge=0, le=2)] = 2
    gravity: Gravity | None = None  # direction of gravity in the reference's axes
    run: tuple[str, ...] | None = None

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if (self.joint is None) == (self.element is None) or (self.element and (self.degree or self.gravity)):
            raise ValueError("a payload sag is that of a joint or of an element with degree: 0")
        if self.run is not None and (self.gravity is None or not self.run):
            raise ValueError("a payload sag by run is that of a rotary joint with gravity, such as gravity: -z")
        return self

    @property
    def where(self) -> str:
        return self.joint or self.element or ""

    @property
    def drivers(self) -> tuple[str, ...]:
        load = run_channels(self.run) or ("load",)
        return (*load, self.joint) if self.joint else load

    def cost(self, scene: Scene) -> float:
        """Natural logarithm of the prior odds against it: guides give way more than castings, loads are known."""
        return 1.0 if self.run or not self.joint else 0.0

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        if self.joint is None:
            return [self._term("", channel("load"), self.motion or "dz")]
        joint, q = joint_of(machine, self.joint), channel(self.joint)
        if self.gravity is not None:
            turning = joint_as(machine, self.joint, "rotary", self.effect)
            number, frames = machine.elements.index(turning), places(machine, channel)
            arm = lever(apply(frames[number].turn, turning.axis), frames[number], frames[-1], self.gravity)
            if self.run is not None:
                loads = {str(k): channel(name) for k, name in enumerate(run_channels(self.run), 1)}
                return [EffectTerm(self.joint, k, "rad/mm", along(turning, on * arm), 1e-6) for k, on in loads.items()]
            own = along(turning, channel("load") * arm)
            return [EffectTerm(self.joint, "lever", "rad/(kg mm)", own, 3e-8, low=0.0)]
        motion = self.motion or sag_direction(joint, None)
        if joint.type == "prismatic":
            bends = {str(n): legendre(n, scaled(joint, q)) for n in range(1, self.degree + 1)}
        else:
            bends = {"sin": sin(q), "cos": cos(q)} if self.degree else {}
        shapes = {"": 1.0, **bends}
        return [self._term(label, channel("load") * shape, motion) for label, shape in shapes.items()]

    def _term(self, label: str, value: Value, motion: Motion) -> EffectTerm:
        size = 1e-3 if motion in TRANSLATIONS else 2e-6  # between machine tools and arms
        return EffectTerm(self.where, label, f"{unit_of(motion)}/kg", {motion: value}, size)

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        if scene.varies("load"):
            # degree 0: the same deflection everywhere; degree 2: it varies along the travel
            for joint, motion, degree in product(scene.moving, MOTIONS, (0, 2)):
                yield cls(joint=joint.name, motion=motion, degree=degree)
            for member, motion in product(scene.machine.shapes, MOTIONS):
                yield cls(element=member.name, motion=motion, degree=0)
            for joint, gravity in product(scene.rotary, ("-x", "-y", "-z")):
                yield cls.model_validate({"joint": joint.name, "gravity": gravity})
        elif 1 < len(scene.each_run) <= MOST_RUNS:  # beside the load of the first
            runs = tuple(name[4:-1] for name in scene.each_run[1:])
            for joint, gravity in product(scene.rotary, ("-x", "-y", "-z")):
                yield cls.model_validate({"joint": joint.name, "gravity": gravity, "run": runs})
