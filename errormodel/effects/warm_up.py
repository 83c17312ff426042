"""Warm-up: exponential growth of a joint's screw, the tool or a member with time (ISO 230-3).

No recorded temperature is needed. Units: mm and rad.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise, product
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from errormodel.conventions import MOTIONS, TRANSLATIONS, Motion, unit_of
from errormodel.effects.base import FIXED, Channels, Effect, EffectTerm, along
from errormodel.effects.ops import Value, fmin
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import (
    STEEL_EXPANSION,
    Positive,
    each_motion,
    joint_as,
    members,
    outward,
    outward_words,
    settling,
    settling_times,
    start_of,
    warmed,
)
from errormodel.effects.travel import polynomials, scaled, usual_size
from errormodel.machine import Machine
from errormodel.machine_rests import LEAST_REST, longest_step, rests, resumed_name

# log prior odds, 10 to 1, against a member that moves in all six motions: what does is usually the instrument's stand;
# by judgement
AS_A_WHOLE = 2.3
UNSHOWN = 2.3  # log prior odds, 10 to 1, against a warm-up that no recorded temperature shows; by judgement


class WarmUp(Effect):
    """``(scale * position + growth) * (1 - exp(-(t - start)/tau))`` along a joint's axis; without a joint, of the tool.

    `tau` (s) is the time constant, `start` (s, on the clock of ``time``) the beginning. Positive: longer. With a
    `motion` that one (mm, rad), or with ``all`` each of the six, or the three ``translations``, grows in Legendre
    polynomials of the joint's travel (-1 to 1) up to `degree`. An `element` is a member that moves or tilts as a whole
    in a `motion`, in the three ``translations``, as one that only grows, or in ``all`` six.
    In `rests`, from and to a time each (s), the machine stands and it cools as fast. `until` is the end of what was
    recorded, and `step` the longest time between two rows there that was no rest: rows that come later than that after
    it begin after a rest, too. From `ends` (s) on it stays as it is then.
    """

    effect: ClassVar[str] = "warm-up"
    family: ClassVar[str] = "thermal"
    source: ClassVar[str] = "ISO 230-3; screws settle in 5 to 60 minutes some 10 K warmer, castings in hours"
    alike: ClassVar[tuple[str, ...]] = ("scale-expansion", "spindle-growth", "structure-drift", "tracker-drift")
    separate: ClassVar[str] = "repeat the first positions at the end, and again after a night of rest"
    example: ClassVar[Mapping[str, object]] = {"joint": "X", "tau": 1800.0}

    joint: str | None = None
    element: str | None = None
    tau: Positive = 1800.0
    start: Annotated[float, FIXED] = 0.0
    motion: Motion | Literal["all", "translations"] | None = None
    degree: Annotated[int, Field(ge=0, le=8)] = 1
    rests: tuple[tuple[float, float], ...] = ()
    until: Annotated[float | None, FIXED] = None
    step: Annotated[float, FIXED] = LEAST_REST
    ends: Annotated[float | None, FIXED] = None

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if self.element is not None and (self.joint is not None or self.motion is None):
            raise ValueError("a member that warms up has a motion and is no joint: element: T1, motion: ea")
        ends = [self.start, *(t for rest in self.rests for t in rest), *([] if self.until is None else [self.until])]
        if any(before > after for before, after in pairwise(ends)):
            raise ValueError("start and rests and until must follow one another in time")
        return self

    @property
    def where(self) -> str:
        return self.joint or self.element or "tool"

    @property
    def key(self) -> tuple[object, ...]:
        return (*super().key, self.element)

    @property
    def drivers(self) -> tuple[str, ...]:
        return ("time",)

    @property
    def rested(self) -> frozenset[str]:
        return frozenset({resumed_name(self.until, self.step)} if self.rests and self.until is not None else ())

    def cost(self, scene: Scene) -> float:
        """Where temperatures were recorded one of them usually shows what warms."""
        whole = self.element is not None and self.motion == "all"
        return (UNSHOWN if scene.sensors else 0.0) + (AS_A_WHOLE if whole else 0.0)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        warm = self._warm(channel)
        if self.element is not None and self.motion is not None:
            return each_motion(self.element, _motions(self.motion), warm, (0.03, 3e-5))
        if self.joint is None:
            motion = {name: value * warm for name, value in outward(machine).items()}
            return [EffectTerm("tool", "growth", "mm", motion, 0.02)]
        joint = joint_as(machine, self.joint, "prismatic", self.effect)
        if self.motion is not None:
            shapes = polynomials(self.degree, scaled(joint, channel(self.joint)))
            return [
                EffectTerm(self.joint, str(n), unit_of(motion), {motion: shape * warm}, usual_size(motion))
                for motion in _motions(self.motion)
                for n, shape in enumerate(shapes)
            ]
        return [
            EffectTerm(self.joint, "scale", "1", along(joint, channel(self.joint) * warm), 10 * STEEL_EXPANSION),
            EffectTerm(self.joint, "growth", "mm", along(joint, warm), 0.02),
        ]

    def _warm(self, channel: Channels) -> Value:
        time = channel("time") if self.ends is None else fmin(channel("time"), self.ends)
        if self.until is None and not self.rests:
            return settling({"time": time}.__getitem__, self.tau, self.start)
        again = [] if self.until is None else [self.until, channel(resumed_name(self.until, self.step))]
        turns = [self.start, *(t for rest in self.rests for t in rest), *again]
        return warmed(time, self.tau, [*zip(turns[::2], [*turns[1::2], time], strict=True)])

    def positive(self, machine: Machine) -> str:
        return outward_words(machine) if self.joint is None and self.element is None else ""

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        if scene.duration:
            time = scene.columns["time"]
            always = cls(start=start_of(scene))
            cooling = cls(start=always.start, rests=rests(time), until=time.max(), step=round(longest_step(time)))
            uses = [cooling, always] if cooling.rests else [cooling]
            for joint in (*(j.name for j in scene.prismatic), None):
                for tau, use in product(settling_times(scene), uses):
                    yield use.model_copy(update={"joint": joint, "tau": tau})
            # relative to the joint's cold state at the time 0
            if scene.all_motions and scene.motions_of in {j.name for j in scene.prismatic}:
                for tau, degree in product(settling_times(scene), range(4)):
                    yield cls(joint=scene.motions_of, tau=tau, motion="all", degree=degree)
            # in rows of one joint a member's growth is that of the joint
            growth = ("translations",) if len(scene.moving) > 1 else ()
            motions = (*MOTIONS, *growth, "all")
            for element, motion, tau, use in product(members(scene.machine), motions, settling_times(scene), uses):
                yield use.model_copy(update={"element": element, "motion": motion, "tau": tau})


def _motions(name: str) -> Sequence[Motion]:
    """The motions of a name: one, the three translations, or all six."""
    return {"all": MOTIONS, "translations": TRANSLATIONS}.get(name) or [m for m in MOTIONS if m == name]
