"""Empirical terms: smooth or periodic motions of an element as a function of one or two channels, without a cause."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import product
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from errormodel.channels import CLOCKS
from errormodel.conventions import ROTATIONS, Motion, unit_of
from errormodel.effects.base import FIXED, Channels, Effect, EffectTerm, ShapeParameter
from errormodel.effects.ops import Value, sin, sqrt
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.search_space.unnamed_grid import lattice
from errormodel.effects.shared import Positive, closed_splines, splines, waves
from errormodel.effects.travel import legendre, usual_size
from errormodel.machine import Machine

Form = Literal["affine", "linear", "square", "cubic"]
SEARCHED = ShapeParameter(said=False)
EDGE_SHARPNESS = 0.02  # of an amplitude: an edge takes a little way, so that a model has a slope everywhere
SUDDEN = 1e-5  # the same of the clock, along which nothing asks for a slope
FORM_DEGREES = {
    "affine": (0, 1),
    "linear": (1,),
    "square": (1, 2),
    "cubic": (1, 2, 3),
}  # affine: with a constant, beside `by`


class Unnamed(Effect):
    """`motion` (mm, rad) in Legendre polynomials of ``(driver - center) / half_range``, or as a wave.

    - `form` gives the degrees, and `by` a second channel, whose functions multiply those of the first.
    - `period` makes it a sine and a cosine; with `edge` it switches between -1 and 1 there and every half period.
    - `pieces` makes it a curve, or a surface over both channels: cubic B-splines on so many intervals of the range (of
      each) or of the period.
    - `size` (mm, rad) is the standard deviation of a zero-mean normal prior of its parameters; curves always have one.
    """

    effect: ClassVar[str] = "unnamed"
    family: ClassVar[str] = "empirical"
    source: ClassVar[str] = "no physics; sizes of usual error motions"
    separate: ClassVar[str] = "its drivers varied one at a time, all else kept; the motion measured at the element"
    example: ClassVar[Mapping[str, object]] = {"element": "X", "motion": "dx", "driver": "w_level", "form": "square"}
    empirical: ClassVar[bool] = True
    shape: ClassVar[str] = "period"

    element: str
    motion: Motion
    driver: str
    form: Form = "linear"
    center: Annotated[float, FIXED] = 0.0  # in the channel's internal unit, as half_range and period
    half_range: Annotated[Positive, FIXED] = 1.0
    period: Annotated[Positive | None, SEARCHED] = None  # makes it a sine and a cosine, or the curve one that repeats
    edge: Annotated[float | None, SEARCHED] = None  # where it switches upwards
    by: str | None = None
    by_form: Form = "linear"
    by_center: Annotated[float, FIXED] = 0.0
    by_half_range: Annotated[Positive, FIXED] = 1.0
    by_period: Annotated[Positive | None, SEARCHED] = None
    by_edge: Annotated[float | None, SEARCHED] = None
    pieces: Annotated[int, Field(ge=2, le=16)] | None = None
    size: Positive | None = None  # None: 20 um, 30 urad

    @property
    def where(self) -> str:
        return self.element

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.driver, self.by) if self.by else (self.driver,)

    @property
    def key(self) -> tuple[object, ...]:
        """Identity of the term: waves and polynomials compete apart, since only waves have a period as their shape."""
        return (*super().key, self.motion, self.period is None, self.by_period is None, self.pieces is None)

    @classmethod
    def shapes(cls) -> Mapping[str, ShapeParameter]:
        """Periods first: an edge means nothing before its wave is found."""
        own = super().shapes()
        return {name: own[name] for name in sorted(own, key=lambda name: not name.endswith("period"))}

    @property
    def random(self) -> bool:
        return self.pieces is not None

    @property
    def exchangeable(self) -> bool:
        return not self.random  # a curve always has a size

    def cost(self, scene: Scene) -> float:
        """Natural logarithm of the prior odds against it: with a constant lever a translation is the simpler model."""
        return 0.5 * (self.motion in ROTATIONS)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        own = (self.form, self.center, self.half_range, self.period, self.edge)
        shapes = self._shapes(self.driver, channel(self.driver), *own)
        if self.by:
            own = (self.by_form, self.by_center, self.by_half_range, self.by_period, self.by_edge)
            second = self._shapes(self.by, channel(self.by), *own)
            shapes = {f"{k}-{n}": a * b for (k, a), (n, b) in product(shapes.items(), second.items())}
        unit, size = unit_of(self.motion), self.size or usual_size(self.motion)
        tied = self.size is not None
        return [EffectTerm(self.element, k, unit, {self.motion: v}, size, tied=tied) for k, v in shapes.items()]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        return (cls.model_validate(fields) for fields in lattice(scene))

    def _shapes(
        self, name: str, x: Value, form: Form, center: float, half: float, period: float | None, edge: float | None
    ) -> dict[str, Value]:
        u = (x - center) / half
        if self.pieces:
            turn = None if period is None else 2 * math.pi * x / period
            curve = splines((u + 1) / 2, self.pieces) if turn is None else closed_splines(turn, max(self.pieces, 5))
            return {str(k): s for k, s in enumerate(curve)}
        if period is not None and edge is not None:
            return {"step": switch(x, period, edge, SUDDEN if name in CLOCKS else EDGE_SHARPNESS)}
        if period is not None:
            return waves(x, 2 * math.pi / period)
        return {str(n): legendre(n, u) if n else 0 * u + 1 for n in FORM_DEGREES[form]}


def switch(x: Value, period: float, edge: float, sharpness: float = EDGE_SHARPNESS) -> Value:
    """Square wave: 1 for half a period from `edge` on, then -1, with edges of finite width."""
    swing = sin((x - edge) * (2 * math.pi / period))
    return swing / sqrt(swing * swing + sharpness**2)
