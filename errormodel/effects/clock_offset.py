"""Clock offset (trigger delay): the instrument records the tool's position earlier or later than the controller.

Displacement in mm: the delay in s times the tool's nominal velocity in mm/s, in the axes of the reference.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from errormodel.conventions import FRAME, INSTRUMENT, TRANSLATIONS
from errormodel.effects.base import Channels, Effect, EffectTerm
from errormodel.effects.ops import Value, cos, sin
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import joint_as
from errormodel.exceptions import InputError
from errormodel.machine import Machine, Shape


class ClockOffset(Effect):
    """``delay * velocity`` of the tool, delay in s; positive: measured too late.

    The velocity is the sum over prismatic joints of the feed in the direction of approach. `joints` are those that
    move; empty: all prismatic joints.
    """

    effect: ClassVar[str] = "clock-offset"
    family: ClassVar[str] = "instrument"
    source: ClassVar[str] = "trigger and network delays: 0.1 to 10 ms"
    alike: ClassVar[tuple[str, ...]] = ("servo-lag", "backlash")
    separate: ClassVar[str] = "measure at rest, or over the same line in both directions at three feeds"
    example: ClassVar[Mapping[str, object]] = {}

    joints: tuple[str, ...] = ()

    @property
    def where(self) -> str:
        return INSTRUMENT

    @property
    def drivers(self) -> tuple[str, ...]:
        return ("feed",)

    @property
    def cost(self) -> float:
        """Natural logarithm of the prior odds against it: a delay of one joint is more likely a following error."""
        return 4.0 if len(self.joints) == 1 else 0.0

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joints = self.joints or tuple(j.name for j in machine.joints if j.type == "prismatic")
        moving = [joint_as(machine, name, "prismatic", self.effect) for name in joints]
        if not moving:
            raise InputError(f"effect {self.effect}", "the machine has no prismatic joint", "Take the effect out")
        feed = channel("feed") / 60  # mm/s
        velocity: list[Value] = [0.0, 0.0, 0.0]  # of the tool, in the axes of each element in turn, from the tool back
        for element in reversed(machine.elements):
            if isinstance(element, Shape):
                for k, angle in reversed(list(enumerate(element.rotation))):
                    velocity = turned(velocity, tuple(float(i == k) for i in range(3)), angle)
            elif element.type == "rotary":
                velocity = turned(velocity, element.axis, channel(element.name))
            elif element in moving:
                speed = feed * channel(f"dir_{element.name}")
                velocity = [v + speed * a for v, a in zip(velocity, element.axis, strict=True)]
        motion = {name: v for name, v in zip(TRANSLATIONS, velocity, strict=True) if not isinstance(v, float)}
        return [EffectTerm(FRAME, "", "s", motion, 1e-3)]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        if scene.prismatic and scene.varies("feed") and all(scene.both_ways(j) for j in scene.prismatic):
            yield cls(joints=tuple(j.name for j in scene.prismatic))


def turned(vector: list[Value], axis: tuple[float, ...], angle: Value) -> list[Value]:
    """Rotate a vector about a unit axis by a right-handed angle in rad (Rodrigues)."""
    c, s = cos(angle), sin(angle)
    (x, y, z), (a, b, d) = vector, axis
    across, inner = (b * z - d * y, d * x - a * z, a * y - b * x), (a * x + b * y + d * z) * (1 - c)
    return [v * c + w * s + u * inner for v, w, u in zip(vector, across, axis, strict=True)]
