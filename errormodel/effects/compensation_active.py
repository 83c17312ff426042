"""Active compensation table: piecewise linear positioning error between the points of a controller's table.

Seen where a correction table is active, switched off or applied twice. Units: mm along the axis, or rad about it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect, along
from errormodel.effects.ops import absolute, fmax
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import Positive, in_runs, run_channels, switched
from errormodel.effects.travel import fraction
from errormodel.machine import Machine, joint_of

POINTS = (5, 6, 7, 8, 9, 11, 13, 16, 21)  # numbers of points that are tried, over the whole travel
FEWER_POINTS = (5, 9, 13, 21)  # the same of several runs, of which there are many sets


class CompensationActive(JointEffect):
    """Table values at the inner ones of `points` equally spaced points; mm along the axis, or rad about it.

    The values at both ends of the travel are zero: a straight line belongs to the scale. Positive: what the table adds.
    With a `run`, or several, a table that acts only there (off, doubled, another): then the ends have values as well.
    `size` (mm, rad) is the standard deviation of a zero-mean normal prior of the values: points that no row is near
    stay as small as the rest.
    """

    effect: ClassVar[str] = "compensation-active"
    family: ClassVar[str] = "dynamic"
    source: ClassVar[str] = "tables of controllers are linear in between their points; 0 to 20 um"
    alike: ClassVar[tuple[str, ...]] = ("higher-order-geometry", "pitch-cyclic", "local-defect")
    separate: ClassVar[str] = "the same axis with the table on and off, at points between those of the table"
    example: ClassVar[Mapping[str, object]] = {"joint": "X", "points": 5}

    points: Annotated[int, Field(ge=3)]
    run: str | tuple[str, ...] | None = None
    size: Positive | None = None  # None: 10 um, 30 urad

    def cost(self, scene: Scene) -> float:
        return 5.0  # log prior odds against it: many linear pieces approximate any smooth curve

    @property
    def exchangeable(self) -> bool:
        return True

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.joint, *run_channels(self.run))

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint = joint_of(machine, self.joint)
        unit, usual = ("mm", 0.01) if joint.type == "prismatic" else ("rad", 3e-5)
        size, tied = self.size or usual, self.size is not None
        u = fraction(joint, channel(self.joint)) * (self.points - 1)
        if self.run is None:
            tents = {str(k): fmax(1 - absolute(u - k), 0) for k in range(1, self.points - 1)}
        else:
            here = in_runs(channel, self.run)
            tents = {str(k): here * fmax(1 - absolute(u - k), 0) for k in range(self.points)}
        return [
            EffectTerm(self.joint, label, unit, along(joint, tent), size, tied=tied) for label, tent in tents.items()
        ]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        """Tables with at least twenty rows per interval; of runs, whose geometry the others show, with four."""
        for joint in scene.moving:
            for points in POINTS:
                if 20 * points <= len(scene.columns[joint.name]):
                    yield cls(joint=joint.name, points=points)
            for run in switched(scene.each_run):
                rows = sum(np.count_nonzero(scene.columns[name]) for name in run_channels(run))
                for points in POINTS if isinstance(run, str) else FEWER_POINTS:
                    if 4 * points <= rows:
                        yield cls(joint=joint.name, points=points, run=run)
