"""Station shift: sudden displacement and rotation of the instrument or the fixture at one time.

Six motions of the measuring frame, mm and rad.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Annotated, ClassVar, Self

from pydantic import model_validator

from errormodel.conventions import FRAME, MOTIONS, TRANSLATIONS
from errormodel.effects.base import MOMENT, Channels, Effect, EffectTerm, ShapeParameter
from errormodel.effects.families import Traits
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import FEW_RUNS, each_motion, in_runs, moments, only, run_channels, since, switched
from errormodel.machine import Machine

# log odds against a step in the order of the rows. By judgement, from recordings: what drifts or was measured in blocks
# looks like one by up to 21 beside its cause (a real arm: 14); the evidence for real steps is 49 to 145
STANDS_OUT = 25.0


class StationShift(Effect):
    """Six motions of the measuring frame (mm, rad) from the time `at` on, within one second; or in a `run`, or several.

    Without a clock, those from a `row` of the file on: rows stand in the order in which they were measured.

    Without `turned` only the three displacements: a foot or fixture that slid. `of` is the observation whose instrument
    it was, or ``points``; without it that of all.
    """

    effect: ClassVar[str] = "station-shift"
    family: ClassVar[str] = "instrument"
    source: ClassVar[str] = "a knock against tripod or fixture: 5 to 100 um, 5 to 50 urad"
    alike: ClassVar[tuple[str, ...]] = ("tracker-drift", "structure-drift")
    separate: ClassVar[str] = (
        "fixed targets on the floor, measured before and after: they stay in place where it was a target on the "
        "machine that was put on anew, which looks alike unless a rotary joint turns it"
    )
    example: ClassVar[Mapping[str, object]] = {"at": 1800.0}

    at: Annotated[float | None, MOMENT] = None  # s
    row: Annotated[float | None, ShapeParameter("1", place=True, sudden=True, said=False)] = None  # counted from 1
    run: str | tuple[str, ...] | None = None
    turned: bool = True
    of: str | None = None

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if sum(v is not None for v in (self.at, self.row, self.run)) != 1:
            raise ValueError("a station shift has one of a time, at: 1800, a row, row: 120, or a run, run: 2")
        return self

    @classmethod
    def traits(cls) -> Traits:
        return replace(super().traits(), form_uncertainty=0.0)  # of a rigid body that was moved the form is exact

    @property
    def where(self) -> str:
        return FRAME

    @property
    def drivers(self) -> tuple[str, ...]:
        return run_channels(self.run) or (("time",) if self.row is None else ("row",))

    def cost(self, scene: Scene) -> float:
        """Natural logarithm of the prior odds against it: in the order of its rows a recording drifts too."""
        return STANDS_OUT if self.row is not None else 0.0

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        if self.run is not None:
            after = in_runs(channel, self.run)
        else:
            after = since(channel, self.at) if self.at is not None else since(channel, self.row or 0.0, "row")
        after = after * only(channel, self.of)
        return each_motion(FRAME, MOTIONS if self.turned else TRANSLATIONS, after, (0.02, 2e-5))

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        for run in switched(scene.runs, constant=True):
            yield from (cls(run=run, turned=turned, of=scene.of) for turned in (True, False))
        for at in moments(scene):
            yield from (cls(at=at, turned=turned, of=scene.of) for turned in (True, False))
        for row in () if len(scene.runs) > FEW_RUNS else moments(scene, "row"):  # labels of many runs are a clock
            yield from (cls(row=row, turned=turned, of=scene.of) for turned in (True, False))
