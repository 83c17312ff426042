"""Target offset: constant error of a target's position in the last frame of the chain, mm; or a target exchanged."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import PositiveFloat, model_validator

from errormodel.arrays import Index
from errormodel.conventions import TOOL, TRANSLATIONS
from errormodel.effects.base import MOMENT, Channels, Effect, EffectTerm
from errormodel.effects.ops import Value, absolute, fmax, fmin
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import in_runs, moments, run_channels, since, switched
from errormodel.machine import Machine, Vector

TOOL_COLUMNS = ("tool_x", "tool_y", "tool_z")  # columns of the functional point, as in `errormodel.surveys.columns`
USUAL_MM = 0.02  # one standard deviation of an offset that a diagnosis finds; by judgement
SAME_TOOL_MM = 0.05  # sum of coordinate differences, mm, below which two functional points are one tool; by judgement
MOST_TOOLS = 12  # most different tools; more are positions of a probe and not a set of tools; by judgement


class TargetOffset(Effect):
    """Constant shift (mm) of the functional point in the last frame, in the rows of one `tool` or in all rows.

    Of a target that was put on anew, or another one, in the rows from the time `at` on, or of one `run`, or several.

    `std` says how well the place was known beforehand: the standard deviation (mm) of a zero-mean prior of each
    coordinate, or ``unknown``, a place that the survey alone shows. `target` is its name in the parameters.
    """

    effect: ClassVar[str] = "target-offset"
    family: ClassVar[str] = "instrument"
    source: ClassVar[str] = "seats of reflectors, lengths of tools as measured: 2 to 50 um"
    alike: ClassVar[tuple[str, ...]] = ("spindle-growth", "payload-sag", "station-shift")
    separate: ClassVar[str] = (
        "the same positions with all targets, and a target taken off and put on again; a place that nobody calibrated "
        "is an unknown of the fit with near: (targets in survey.yaml)"
    )
    example: ClassVar[Mapping[str, object]] = {"tool": [40.0, 25.0, -180.0]}

    tool: Vector | None = None  # mm
    at: Annotated[float | None, MOMENT] = None  # s
    run: str | tuple[str, ...] | None = None
    std: PositiveFloat | Literal["unknown"] | None = None  # mm
    target: str = ""

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if sum(v is not None for v in (self.tool, self.at, self.run)) > 1:
            raise ValueError(
                "a target offset has one of a tool, tool: [0, 0, -120], a time, at: 1800, or a run, run: 2"
            )
        return self

    @property
    def where(self) -> str:
        return TOOL

    @property
    def drivers(self) -> tuple[str, ...]:
        if self.at is not None:
            return ("time",)
        return run_channels(self.run) or (TOOL_COLUMNS if self.tool else ())

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        here: Value = 1.0
        if self.at is not None:
            here = since(channel, self.at)
        elif self.run is not None:
            here = in_runs(channel, self.run)
        elif self.tool is not None:
            apart = sum(absolute(channel(c) - v) for c, v in zip(TOOL_COLUMNS, self.tool, strict=True))
            here = fmin(fmax(2 - apart / SAME_TOOL_MM, 0), 1)
        known = isinstance(self.std, float)
        size = self.std if isinstance(self.std, float) else math.inf if self.std else USUAL_MM
        return [EffectTerm(TOOL, self.target, "mm", {m: here}, size, tied=known) for m in TRANSLATIONS]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        number = np.zeros(1, dtype=np.intp)  # of each row's tool
        if not any(scene.varies(c) for c in TOOL_COLUMNS):
            yield cls()  # a machine whose last member has no constant errors shows it
        else:
            every = np.round(np.column_stack([scene.columns[c] for c in TOOL_COLUMNS]), 4)
            tools, number = np.unique(every, axis=0, return_inverse=True)
            if len(tools) <= MOST_TOOLS:
                for tool in tools.tolist():
                    yield cls(tool=tuple(tool))
        yield from (cls(run=run) for run in switched(scene.runs) if not _of_tools(scene, run, number))
        yield from (cls(at=at) for at in moments(scene))


def _of_tools(scene: Scene, run: str | tuple[str, ...], number: Index) -> bool:
    """Whether runs have tools of their own: then these are the cause.

    Parameters
    ----------
    number : of each row's tool.
    """
    inside = np.asarray(in_runs(scene.columns.__getitem__, run)) > 0
    return bool(number.any()) and not {*number[inside].tolist()} & {*number[~inside].tolist()}
