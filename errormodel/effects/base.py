"""What a physical effect is: the small motions it adds to a chain element at one place, and what it looks like.

An effect is a pydantic model: its fields are what one writes in ``machine.yaml``. Its linear parameters are chain
parameters like any other; shape parameters (a period, a time constant) are fields. `terms` is written once, with
`errormodel.effects.ops`, and is evaluated on symbols (to build a chain) and on arrays (to try thousands of candidates).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import BaseModel, ConfigDict

from errormodel.conventions import Motion
from errormodel.effects.ops import Value
from errormodel.machine import Joint, Machine

if TYPE_CHECKING:
    from errormodel.effects.search_space.survey_summary import Scene

Channels = Callable[[str], Value]
"""Value of a channel of the survey: a joint (mm, rad), ``time`` (s), ``T_bed`` (degC), ``dir_X`` (+-1), ``feed``,
``load``, ``w_sync``, ``point_x`` (nominal position in the reference's axes, mm), or a derived one such as
``lag(T_bed,600)`` or ``run(3)``; see `errormodel.channels`."""


@dataclass(frozen=True)
class EffectTerm:
    """One linear parameter of an effect.

    Attributes
    ----------
    element : the chain element that moves, or ``frame``, ``tool``.
    label : tells the effect's parameters apart; may be empty.
    unit : of the parameter.
    motion : what the element does per unit of the parameter, mm and rad.
    size : how large the parameter can physically be (one standard deviation), in its unit.
    low : the least that it can physically be: 0 where the form has its sign and nature no other.
    """

    element: str
    label: str
    unit: str
    motion: Mapping[Motion, Value]
    size: float
    low: float = -math.inf


class Effect(BaseModel, ABC):
    """Base of all effects. A new one is one class in one file of this package; it is found by itself.

    Periodic effects also have a ``period`` (mm or rad), a field or a property.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    effect: ClassVar[str]  # its word in files and findings
    family: ClassVar[str]
    source: ClassVar[str]  # where form and sizes come from
    alike: ClassVar[tuple[str, ...]] = ()  # effects that can look the same
    separate: ClassVar[str]  # the measurement that tells them apart
    example: ClassVar[Mapping[str, object]]  # as in machine.yaml, on the machine of the test battery
    empirical: ClassVar[bool] = False  # a form, not a physics: names nothing
    flexible: ClassVar[bool] = False  # physics of no form of its own: follows any smooth curve
    shape: ClassVar[str] = ""  # a field that `terms` also takes as an array, (n, 1) for n values at once

    @property
    @abstractmethod
    def where(self) -> str:
        """The chain element, or ``frame``, ``tool``, ``instrument``."""

    @property
    @abstractmethod
    def drivers(self) -> tuple[str, ...]:
        """Channels that it depends on, the chain's or the survey's."""

    @abstractmethod
    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        """Its parameters and the motions per unit of each."""

    @classmethod
    @abstractmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        """Every place and shape that it could have in a survey: what the diagnosis tries."""

    def channels(self, machine: Machine) -> list[str]:
        """Channels that it is made of, in the order in which it asks for them."""
        asked: dict[str, None] = {}

        def channel(name: str) -> Value:
            asked[name] = None
            return np.ones(1)

        self.terms(channel, machine)
        return list(asked)

    @classmethod
    def bounds(cls, name: str) -> tuple[float, float]:
        """Least and greatest value of a field."""
        limits = cls.model_fields[name].metadata
        low = (getattr(m, side) for m in limits for side in ("ge", "gt") if hasattr(m, side))
        high = (getattr(m, side) for m in limits for side in ("le", "lt") if hasattr(m, side))
        return max(map(float, low), default=-math.inf), min(map(float, high), default=math.inf)

    @property
    def cost(self) -> float:
        """Nats of prior odds against it: less usual physics must show more."""
        return 0.0

    def positive(self, machine: Machine) -> str:
        """What a positive parameter does, where that is not a rise of the motion in its name; else ""."""
        return ""

    @property
    def random(self) -> bool:
        """Whether its parameters are many that a prior ties to zero, all with the same standard deviation."""
        return False

    @property
    def key(self) -> tuple[object, ...]:
        """The same for all shapes of one effect at one place: of these only the best counts."""
        return (self.effect, self.where, self.drivers)


class JointEffect(Effect):
    """An effect that sits at one joint: its ``joint:`` in ``machine.yaml``."""

    joint: str

    @property
    def where(self) -> str:
        return self.joint


def axis_motion(joint: Joint) -> Motion:
    """The translation (prismatic) or rotation (rotary) motion along the joint's axis: positioning."""
    k = max(range(3), key=lambda i: abs(joint.axis[i]))
    names: tuple[tuple[Motion, Motion, Motion], ...] = (("dx", "dy", "dz"), ("ea", "eb", "ec"))
    return names[joint.type == "rotary"][k]


def along(joint: Joint, value: Value) -> dict[Motion, Value]:
    """Motion of size `value` along (about) the joint's axis, whatever its direction."""
    names: tuple[Motion, Motion, Motion] = ("ea", "eb", "ec") if joint.type == "rotary" else ("dx", "dy", "dz")
    return {name: value * a for name, a in zip(names, joint.axis, strict=True) if a}
