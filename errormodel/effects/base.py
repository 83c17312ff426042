"""Base class of physical effects: small motions that an effect adds to one element of the kinematic chain.

An effect is a pydantic model: its fields are what one writes in ``machine.yaml``. Its linear parameters are chain
parameters like any other; shape parameters (a period, a time constant) are fields. `terms` is written once, with
`errormodel.effects.ops`, and is evaluated on symbols (to build a chain) and on arrays (to try thousands of candidates).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import BaseModel, ConfigDict, PositiveFloat

from errormodel.arrays import Array
from errormodel.conventions import REFERENCE_TEMPERATURE, Motion
from errormodel.effects.families import FAMILIES, Traits
from errormodel.effects.ops import Value
from errormodel.machine import EffectSpec, Joint, Machine

if TYPE_CHECKING:
    from errormodel.effects.search_space.survey_summary import Scene

NOT_SETTLED = 2.3  # log prior odds, 10 to 1, against a lag that was not in equilibrium in the first row; by judgement

SENSORS = "sensor", "minus"  # fields that name temperatures

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
    tied : whether `size` is the standard deviation of a zero-mean prior in every fit, as of a random effect.
    """

    element: str
    label: str
    unit: str
    motion: Mapping[Motion, Value]
    size: float
    low: float = -math.inf
    tied: bool = False


@dataclass(frozen=True)
class ShapeParameter:
    """What a numeric field of an effect is: metadata of its annotation, as in ``Annotated[float, PLACE]``.

    A field of type ``float`` that says nothing is a positive shape parameter in the unit of the first driver. A field
    of another type (``float | None`` too) is none unless it says so.

    Attributes
    ----------
    unit : of the field; empty: that of the effect's first driver (mm, rad or s).
    place : whether it is a position along the first driver, of any sign. The posterior then moves it evenly over what
        was measured; any other it moves in its logarithm.
    sudden : whether something changes there at once, so that it is a place between two values of the first driver.
    searched : whether the diagnosis moves it off the grid of the proposals, to where it fits best.
    sampled : whether the posterior may have it as an unknown.
    said : whether a finding's sentence states it, by the name of its field.
    """

    unit: str = ""
    place: bool = False
    sudden: bool = False
    searched: bool = True
    sampled: bool = True
    said: bool = True


PLACE = ShapeParameter(place=True)
MOMENT = ShapeParameter(place=True, sudden=True)
FIXED = ShapeParameter(searched=False, sampled=False, said=False)
"""Of a number that is given, not found: an origin, a scale, a date."""


class Effect(BaseModel, ABC):
    """Base of all effects. A new one is one class in one file of this package; it is found by itself.

    All that others know of an effect stands on its class; what has a default here need not be given. Fields of these
    names mean the same in every effect, and findings put them in words: ``period`` (mm or rad; a property will do) of
    what repeats, ``at`` and ``width`` of a place, ``edge`` of a switch, ``sensor`` and ``minus`` of a temperature and
    what it is the excess over, ``tau`` of a lag (s), ``initial`` of what it began with (K), ``motion`` of the error
    motion that moves, ``load_joint`` or ``by`` of a second channel. ``within`` and ``spread`` stand at what a diagnosis
    found without a name (`errormodel.effects.best_prediction`): the range of each channel (internal units) in which it
    was recorded, and the standard deviation (mm, rad) of each element's motion there.

    Attributes
    ----------
    effect : its word in files and findings.
    family : physics it belongs to; see :mod:`errormodel.effects.families` for what that implies.
    source : where form and sizes come from.
    alike : words of effects that can look the same.
    separate : the measurement that tells it from these; findings recommend it.
    asked : of how many values of which channels `separate` asks; `otherwise` : what findings recommend in its stead
        where a survey has these.
    example : its keys as in ``machine.yaml``.
    empirical : whether it is a form without physics, which names nothing.
    flexible : whether it is physics that can follow any smooth curve.
    shape : a field that `terms` also takes as an array, (n, 1) for n values at once.
    cause : fields that say what drives it, not what moves.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    within: tuple[tuple[str, float, float, PositiveFloat], ...] = ()
    spread: tuple[tuple[str, Motion, PositiveFloat], ...] = ()

    effect: ClassVar[str]
    family: ClassVar[str]
    source: ClassVar[str]
    alike: ClassVar[tuple[str, ...]] = ()
    separate: ClassVar[str]
    asked: ClassVar[Mapping[str, int]] = {}
    otherwise: ClassVar[str] = ""
    example: ClassVar[Mapping[str, object]]
    empirical: ClassVar[bool] = False
    flexible: ClassVar[bool] = False
    shape: ClassVar[str] = ""
    cause: ClassVar[frozenset[str]] = frozenset({"sensor", "minus", "tau", "initial", "start"})

    @classmethod
    def recommended(cls, columns: Mapping[str, Array]) -> str:
        """The measurement that tells it from what is alike, beside those of a survey with these channels."""
        has = (c in columns and len(np.unique(columns[c])) >= count for c, count in cls.asked.items())
        return cls.otherwise if cls.asked and all(has) else cls.separate

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
    def traits(cls) -> Traits:
        """What it has in common with its family."""
        return FAMILIES.get(cls.family, Traits())

    @classmethod
    def shapes(cls) -> Mapping[str, ShapeParameter]:
        """Its shape parameters by field, in the order in which the diagnosis searches them."""
        out = {}
        for name, field in cls.model_fields.items():
            said = next((m for m in field.metadata if isinstance(m, ShapeParameter)), None)
            kind = said or (ShapeParameter() if field.annotation is float else FIXED)
            if kind is not FIXED:
                out[name] = kind
        return out

    @classmethod
    def same_parameter(cls) -> frozenset[str]:
        """Fields in which two effects may differ and still have one and the same parameter, such as an expansion."""
        return cls.cause

    def unit_of_shape(self, name: str, machine: Machine) -> str:
        """Unit of a shape parameter: its own, or that of the first driver."""
        if unit := self.shapes()[name].unit:
            return unit
        joint = next((j for j in machine.joints if j.name == self.drivers[0]), None)
        if joint is None:
            return "s" if self.drivers[0] == "time" else "mm"
        return "rad" if joint.type == "rotary" else "mm"

    @classmethod
    def unresolved(cls, scene: Scene, joint: Joint) -> str:
        """Why positions of the joint as far apart as a survey's would show it as something else; empty: they do not.

        Asked for findings along a joint: the name is then uncertain, and the sentence is added to the finding's.
        """
        return ""

    def reversal(self, values: Sequence[float]) -> tuple[float, float] | None:
        """What the position along (about) its joint's axis gains by turning round, at both ends of the travel.

        A control holds it in its parameter of backlash. None: it is no such effect.

        Parameters
        ----------
        values : of its parameters, in the order of a chain's identities of them.

        Returns
        -------
        At the lower and at the upper end, mm or rad; positive where the joint is ahead in its direction of travel.
        """
        return None

    def overtone(self, number: int) -> Effect | None:
        """The effect with so many times as many waves; None where it is no wave of any period."""
        return None

    @classmethod
    def bounds(cls, name: str) -> tuple[float, float]:
        """Least and greatest value of a field."""
        limits = cls.model_fields[name].metadata
        low = (getattr(m, side) for m in limits for side in ("ge", "gt") if hasattr(m, side))
        high = (getattr(m, side) for m in limits for side in ("le", "lt") if hasattr(m, side))
        return max(map(float, low), default=-math.inf), min(map(float, high), default=math.inf)

    def cost(self, scene: Scene) -> float:
        """Natural logarithm of the prior odds against it in a survey: unusual physics needs stronger evidence."""
        return NOT_SETTLED if getattr(self, "initial", 0.0) else 0.0

    @property
    def spec(self) -> EffectSpec:
        """The effect as an entry of ``effects:`` in ``machine.yaml``: its name, and its fields but for defaults."""
        return EffectSpec(self.effect, self.model_dump(mode="json", exclude_defaults=True))

    def positive(self, machine: Machine) -> str:
        """Meaning of a positive parameter, where it is not a rise of the motion in the parameter's name; else ""."""
        return ""

    def meaning_of_sign(self, values: Sequence[float]) -> str:
        """What the sign of its parameters (in their order) says of the cause, as a clause; "" where it is the usual."""
        return ""

    @property
    def rested(self) -> frozenset[str]:
        """Channels of work resumed after a recording that it has, if the machine rested in that recording."""
        return frozenset()

    @property
    def motion_form(self) -> str:
        """In words which of several forms at one place it is; empty where there is one."""
        return ""

    @property
    def random(self) -> bool:
        """Whether the parameters are random effects: shrunk to zero by a prior of one common standard deviation."""
        return False

    @property
    def exchangeable(self) -> bool:
        """Whether the parameters are of one kind, with a `size`: the standard deviation that the data give them."""
        return False

    def changing(self, scene: Scene) -> float:
        """Share (0 to 1) of its length squared that is due to changes of the temperature that its fields name.

        What a sensor shows over its reference all the time, as at 60 +- 1 degC, is constant: geometry takes it up, and
        nothing of the effect is hidden by that.
        """
        sensor, minus = (scene.columns.get(getattr(self, name, None) or "") for name in SENSORS)
        if sensor is None:
            return 1.0
        warm = sensor - (REFERENCE_TEMPERATURE if minus is None else minus)
        return float(np.var(warm) / max(np.mean(np.square(warm)), np.finfo(float).tiny))

    @property
    def key(self) -> tuple[object, ...]:
        """The same for all shapes of one effect at one place: their evidence is integrated over the shapes."""
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
