"""Clock offset (trigger delay): the instrument records the tool's position earlier or later than the controller.

Displacement in mm: the delay in s times the tool's nominal velocity in mm/s, in the axes of the reference.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar, Literal, Self

from pydantic import model_validator

from errormodel.conventions import FRAME, INSTRUMENT, TRANSLATIONS
from errormodel.effects.base import Channels, Effect, EffectTerm
from errormodel.effects.ops import Value, cos, sin
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import joint_as
from errormodel.effects.target_offset import TOOL_COLUMNS
from errormodel.exceptions import InputError
from errormodel.machine import Machine, Shape, joint_of
from errormodel.path_speed import rate_name, speed_name


class ClockOffset(Effect):
    """``delay * velocity`` of the tool, delay in s; positive: measured too late.

    `speed`, ``each``: every prismatic joint moves with the whole feed in its direction of approach; `joints` are those
    that move, empty: all. ``path``: the feed is that along the path, of which every joint, a rotary one too, has its
    share. ``clock``: each of the `joints` moves as its commanded positions do from row to row, by their times: rows
    were read on the fly.
    """

    effect: ClassVar[str] = "clock-offset"
    family: ClassVar[str] = "instrument"
    source: ClassVar[str] = "trigger and network delays: some 1 ms, from 0.1 to 10 ms"
    alike: ClassVar[tuple[str, ...]] = ("servo-lag", "backlash")
    separate: ClassVar[str] = "measure at rest, or over the same line in both directions at three feeds"
    asked: ClassVar[Mapping[str, int]] = {"feed": 3}
    otherwise: ClassVar[str] = "measure at rest, or over the same line in both directions"
    example: ClassVar[Mapping[str, object]] = {}

    joints: tuple[str, ...] = ()
    speed: Literal["each", "path", "clock"] = "each"

    @model_validator(mode="after")
    def _all_of_a_path(self) -> Self:
        if self.speed == "path" and self.joints:
            raise ValueError("on a path all joints move: leave out joints or write speed: each")
        return self

    @property
    def where(self) -> str:
        return INSTRUMENT

    @property
    def drivers(self) -> tuple[str, ...]:
        if self.speed != "clock":
            return ("feed",)
        return tuple(map(rate_name, self.joints)) or ("time",)

    def cost(self, scene: Scene) -> float:
        """Natural logarithm of the prior odds against it: a delay of one joint is more likely a following error."""
        return 4.0 if len(self.joints) == 1 else 0.0

    def positive(self, machine: Machine) -> str:
        return "it measures later than the controller states the position"

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        every = tuple(j.name for j in machine.joints)
        if self.speed == "path":
            speeds = {name: channel(speed_name(machine, name)) for name in every}
        elif self.speed == "clock":
            moving = [joint_of(machine, name).name for name in self.joints or every]
            speeds = {name: channel(rate_name(name)) for name in moving}
        else:
            joints = self.joints or tuple(j.name for j in machine.joints if j.type == "prismatic")
            for name in joints:
                joint_as(machine, name, "prismatic", self.effect)
            if not joints:
                found = "the machine has no prismatic joint"
                raise InputError(f"effect {self.effect}", found, "Take the effect out, or write speed: path")
            feed = channel("feed") / 60  # mm/s
            speeds = {name: feed * channel(f"dir_{name}") for name in joints}
        # of the tool, in the axes of each element in turn, from the tool back
        velocity: list[Value] = [0.0, 0.0, 0.0]
        place: list[Value] = [channel(name) for name in TOOL_COLUMNS] if self.speed != "each" else [0.0, 0.0, 0.0]
        for element in reversed(machine.elements):
            if isinstance(element, Shape):
                for k, angle in reversed(list(enumerate(element.rotation))):
                    axis = tuple(float(i == k) for i in range(3))
                    velocity, place = turned(velocity, axis, angle), turned(place, axis, angle)
                place = [p + a for p, a in zip(place, element.offset, strict=True)]
            elif element.type == "rotary":
                q = channel(element.name)
                velocity, place = turned(velocity, element.axis, q), turned(place, element.axis, q)
                if element.name in speeds:
                    around = crossed(element.axis, place)
                    velocity = [v + speeds[element.name] * a for v, a in zip(velocity, around, strict=True)]
            else:
                place = [p + channel(element.name) * a for p, a in zip(place, element.axis, strict=True)]
                if element.name in speeds:
                    velocity = [v + speeds[element.name] * a for v, a in zip(velocity, element.axis, strict=True)]
        motion = {name: v for name, v in zip(TRANSLATIONS, velocity, strict=True) if not isinstance(v, float)}
        return [EffectTerm(FRAME, "", "s", motion, 1e-3)]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        if scene.on_the_fly:
            yield cls(joints=tuple(j.name for j in scene.moving), speed="clock")
        if scene.varies("feed"):
            if scene.prismatic and all(scene.both_ways(j) for j in scene.prismatic):
                yield cls(joints=tuple(j.name for j in scene.prismatic))
            if len(scene.moving) > 1 and all(scene.both_ways(j) for j in scene.moving):
                yield cls(speed="path")


def crossed(one: tuple[float, ...], other: list[Value]) -> list[Value]:
    """Cross product of two vectors."""
    (a, b, d), (x, y, z) = one, other
    return [b * z - d * y, d * x - a * z, a * y - b * x]


def turned(vector: list[Value], axis: tuple[float, ...], angle: Value) -> list[Value]:
    """Rotate a vector about a unit axis by a right-handed angle in rad (Rodrigues)."""
    c, s = cos(angle), sin(angle)
    inner = sum(a * v for a, v in zip(axis, vector, strict=True)) * (1 - c)
    across = crossed(axis, vector)
    return [v * c + w * s + u * inner for v, w, u in zip(vector, across, axis, strict=True)]
