"""Base class of physical effects: small motions that an effect adds to one element of the kinematic chain.

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
    label : distinguishes the effect's parameters; may be empty.
    unit : of the parameter.
    motion : small motion of the element per unit of the parameter, mm and rad.
    size : usual physical size of the parameter (one standard deviation about zero), in its unit.
    low : physical lower bound of the parameter: 0 where only one sign is possible.
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
        """Channels of the chain or the survey that the effect depends on."""

    @abstractmethod
    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        """Linear parameters of the effect, each with the small motion per unit of it (mm, rad)."""

    @classmethod
    @abstractmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        """Candidates of this effect, at each location and with each shape that a survey could show."""

    def channels(self, machine: Machine) -> list[str]:
        """Names of the channels that `terms` asks for, in that order."""
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
        """Natural logarithm of the prior odds against it: unusual physics needs stronger evidence."""
        return 0.0

    def positive(self, machine: Machine) -> str:
        """Meaning of a positive parameter, where it is not a rise of the motion in the parameter's name; else ""."""
        return ""

    @property
    def random(self) -> bool:
        """Whether the parameters are random effects: shrunk to zero by a prior of one common standard deviation."""
        return False

    @property
    def key(self) -> tuple[object, ...]:
        """The same for all shapes of one effect at one place: of these only the best counts."""
        return (self.effect, self.where, self.drivers)


class JointEffect(Effect):
    """An effect at one joint, the ``joint:`` of its entry in ``machine.yaml``."""

    joint: str

    @property
    def where(self) -> str:
        return self.joint


def axis_motion(joint: Joint) -> Motion:
    """Positioning motion of a joint: the translation (prismatic) or rotation (rotary) nearest to its axis."""
    k = max(range(3), key=lambda i: abs(joint.axis[i]))
    names: tuple[tuple[Motion, Motion, Motion], ...] = (("dx", "dy", "dz"), ("ea", "eb", "ec"))
    return names[joint.type == "rotary"][k]


def along(joint: Joint, value: Value) -> dict[Motion, Value]:
    """Motion of size `value` along (prismatic, mm) or about (rotary, rad) the joint's axis."""
    names: tuple[Motion, Motion, Motion] = ("ea", "eb", "ec") if joint.type == "rotary" else ("dx", "dy", "dz")
    return {name: value * a for name, a in zip(names, joint.axis, strict=True) if a}
