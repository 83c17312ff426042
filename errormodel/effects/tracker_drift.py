"""Tracker drift: slow displacement and tilt of the instrument or its stand.

Six motions of the measuring frame, mm and rad, as functions of time.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Annotated, ClassVar

from pydantic import Field

from errormodel.conventions import FRAME, MOTIONS
from errormodel.effects.base import FIXED, Channels, Effect, EffectTerm, ShapeParameter
from errormodel.effects.families import Traits
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import each_motion, only, settling, start_of
from errormodel.machine import Machine


class TrackerDrift(Effect):
    """Six motions of the measuring frame (mm, rad): linear in time over `duration`, or settling with `tau`.

    All times are in s. `of` is the observation whose instrument drifts, or ``points``; without it that of all.
    """

    effect: ClassVar[str] = "tracker-drift"
    family: ClassVar[str] = "instrument"
    source: ClassVar[str] = "warm-up of laser trackers and stands over hours: up to 50 um, 20 urad"
    alike: ClassVar[tuple[str, ...]] = ("structure-drift", "warm-up", "station-shift")
    separate: ClassVar[str] = "measure fixed targets on the floor again and again between the positions"
    example: ClassVar[Mapping[str, object]] = {"duration": 7200.0}

    start: Annotated[float, FIXED] = 0.0  # s
    duration: Annotated[float, FIXED] = Field(3600.0, gt=0)  # s
    tau: Annotated[float, ShapeParameter("s")] = Field(0.0, ge=0)  # s; 0: even drift
    of: str | None = None

    @classmethod
    def traits(cls) -> Traits:
        """A stand settles in forms of its own, and goes on after the last row as nobody has seen."""
        return replace(super().traits(), form_uncertainty=0.3)  # of later poses of three recordings

    @property
    def where(self) -> str:
        return FRAME

    @property
    def drivers(self) -> tuple[str, ...]:
        return ("time",)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        even = (channel("time") - self.start) / self.duration
        grown = settling(channel, self.tau, self.start) if self.tau else even
        return each_motion(FRAME, MOTIONS, grown * only(channel, self.of), (0.02, 1e-5))

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        if scene.duration:
            start, duration = round(start_of(scene), 1), round(scene.duration, 1)
            for tau in (0.0, *(duration * 0.04 * 1.6**k for k in range(7))):
                yield cls(start=start, duration=duration, tau=tau, of=scene.of)
