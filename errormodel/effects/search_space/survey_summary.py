"""What a survey lets an effect be looked for by: which joints moved, which channels vary, how long it took."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from errormodel.machine import Joint, Machine, Vector

Array = NDArray[np.float64]
MOVED_SHARE = 0.003  # of the travel


@dataclass(frozen=True, eq=False)  # what is derived from a scene is kept by which one it is
class Scene:
    """A machine and the columns of a survey of it, each (n,), in mm, rad, s, degC.

    `stations` are where its instrument may have stood, in the reference's axes, mm. `motions_of` is the one joint
    whose error motions were measured, so that nothing else can be at fault. `unusable` are the temperature sensors left
    out of the columns, each with the reason.
    """

    machine: Machine
    columns: Mapping[str, Array]
    stations: tuple[Vector, ...] = ((0.0, 0.0, 0.0),)
    motions_of: str = ""
    unusable: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def all_motions(self) -> bool:
        """Whether all six motions of the one joint were read: points in three places show them."""
        tools = [self.columns[c] for c in ("tool_x", "tool_y", "tool_z") if c in self.columns]
        return bool(self.motions_of) and len(tools) == 3 and len(np.unique(np.transpose(tools), axis=0)) > 2

    def shows(self, where: str) -> bool:
        """Whether an effect at this place would be seen."""
        return self.motions_of in ("", where)

    def varies(self, name: str) -> bool:
        """Whether a channel is there, complete, and not constant."""
        values = self.columns.get(name)
        return values is not None and bool(np.isfinite(values).all()) and float(np.ptp(values)) > 0

    @cached_property
    def moving(self) -> tuple[Joint, ...]:
        """Joints that moved: one that only sought a switch or a probe is what was measured, and drives nothing."""
        return tuple(
            j
            for j in self.machine.joints
            if self.varies(j.name) and np.ptp(self.span(j)) > MOVED_SHARE * (j.travel[1] - j.travel[0])
        )

    @property
    def prismatic(self) -> tuple[Joint, ...]:
        return tuple(j for j in self.moving if j.type == "prismatic")

    @property
    def rotary(self) -> tuple[Joint, ...]:
        return tuple(j for j in self.moving if j.type == "rotary")

    @cached_property
    def sensors(self) -> tuple[str, ...]:
        """Temperature channels that vary."""
        return tuple(n for n in self.columns if n.startswith("T_") and self.varies(n))

    @cached_property
    def witnesses(self) -> tuple[str, ...]:
        return tuple(n for n in self.columns if n.startswith("w_") and self.varies(n))

    @cached_property
    def runs(self) -> tuple[str, ...]:
        """Channels that tell one run of several from the rest."""
        return tuple(n for n in self.columns if n.startswith("run(") and self.varies(n))

    @cached_property
    def duration(self) -> float:
        """Of the recording, s; 0 without time."""
        return float(np.ptp(self.columns["time"])) if self.varies("time") else 0.0

    def span(self, joint: Joint) -> tuple[float, float]:
        """Positions that a joint really took."""
        values = self.columns[joint.name]
        return float(values.min()), float(values.max())

    def both_ways(self, joint: Joint) -> bool:
        """Whether the joint arrived from both sides, at least five times each."""
        signs = self.columns.get(f"dir_{joint.name}")
        return signs is not None and min(int((signs > 0).sum()), int((signs < 0).sum())) >= 5
