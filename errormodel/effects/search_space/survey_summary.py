"""Summary of a survey from which effects propose candidates: moved joints, varying channels, duration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from errormodel.channels import CLOCKS
from errormodel.machine import Joint, Machine, Vector
from errormodel.machine_rests import rests
from errormodel.path_speed import in_motion

Array = NDArray[np.float64]
# share of the travel from which on a joint counts as moved; by judgement: probing moves are shorter
MOVED_SHARE = 0.003


@dataclass(frozen=True, eq=False)  # compared and cached by identity
class Scene:
    """A machine and the columns of a survey of it.

    Attributes
    ----------
    machine : the machine.
    columns : channels by name, each (n,), in mm, rad, s and degC.
    stations : possible stations of the instrument in the reference's axes, mm.
    motions_of : the one joint whose error motions were measured, if so; no other element can then cause them.
    unusable : temperature sensors that are left out of the columns, each with the reason.
    readings : types of single readings in the survey, such as distances; empty where there are none.
    positions : whether positions were measured as well, or alone.
    """

    machine: Machine
    columns: Mapping[str, Array]
    stations: tuple[Vector, ...] = ((0.0, 0.0, 0.0),)
    motions_of: str = ""
    unusable: Mapping[str, str] = field(default_factory=dict)
    readings: tuple[str, ...] = ()
    positions: bool = True

    @property
    def of(self) -> str | None:
        """What an effect of the instrument acts on: beside single readings, of instruments of their own, on points."""
        return "points" if self.readings and self.positions else None

    @cached_property
    def all_motions(self) -> bool:
        """Whether all six error motions of that joint were measured: points of three different tools determine them."""
        tools = [self.columns[c] for c in ("tool_x", "tool_y", "tool_z") if c in self.columns]
        return bool(self.motions_of) and len(tools) == 3 and len(np.unique(np.transpose(tools), axis=0)) > 2

    def shows(self, where: str) -> bool:
        """Whether the survey can show an effect at this element."""
        return self.motions_of in ("", where)

    def varies(self, name: str) -> bool:
        """Whether a channel exists, is complete and is not constant."""
        values = self.columns.get(name)
        return values is not None and bool(np.isfinite(values).all()) and float(np.ptp(values)) > 0

    @cached_property
    def moving(self) -> tuple[Joint, ...]:
        """Joints that moved by more than a probing move."""
        return tuple(
            j
            for j in self.machine.joints
            if self.varies(j.name) and np.ptp(self.span(j)) > MOVED_SHARE * (j.travel[1] - j.travel[0])
        )

    @cached_property
    def runs_on(self) -> bool:
        """Whether the path of the moving joints runs on through most rows, as if they were read in motion."""
        return in_motion([self.columns[j.name] for j in self.moving])

    @cached_property
    def on_the_fly(self) -> bool:
        """Whether the rows seem to be read in motion, and have times, which say how fast."""
        if not self.varies("time"):
            return False
        order = np.argsort(self.columns["time"], kind="stable")
        return in_motion([self.columns[j.name][order] for j in self.moving], self.columns["time"][order])

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
        """Indicator channels ``run(<label>)``, where there are several; of two, which differ by one constant, one."""
        return self.each_run[1:] if len(self.each_run) == 2 else self.each_run

    @cached_property
    def each_run(self) -> tuple[str, ...]:
        """Indicator channels ``run(<label>)`` of all runs, where there are several."""
        return tuple(n for n in self.columns if n.startswith("run(") and self.varies(n))

    @cached_property
    def clock(self) -> str:
        """Channel of the rows' times; where none were recorded, that of their order. Empty where neither varies."""
        return next((name for name in CLOCKS if self.varies(name)), "")

    @cached_property
    def duration(self) -> float:
        """Duration of the survey, s; 0 without a column ``time``."""
        return float(np.ptp(self.columns["time"])) if self.varies("time") else 0.0

    @cached_property
    def worked(self) -> float:
        """The same without rests, such as a night between two days of one clock, s."""
        return self.duration - sum(end - begin for begin, end in rests(self.columns["time"])) if self.duration else 0.0

    def span(self, joint: Joint) -> tuple[float, float]:
        """Smallest and largest position that a joint was commanded to, mm or rad."""
        values = self.columns[joint.name]
        return float(values.min()), float(values.max())

    def both_ways(self, joint: Joint) -> bool:
        """Whether the joint approached from both directions, at least five times each."""
        signs = self.columns.get(f"dir_{joint.name}")
        return signs is not None and min(int((signs > 0).sum()), int((signs < 0).sum())) >= 5
