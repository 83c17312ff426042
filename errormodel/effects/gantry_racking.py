"""Gantry racking: yaw of the bridge between two drives that are out of step.

Rotation in rad per mm of difference of the two drives, the inverse of their spacing for a rigid bridge.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import product
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import model_validator

from errormodel.arrays import Array
from errormodel.channels import AHEAD_CHANNEL
from errormodel.drives import MOST_SKEW_SHARE
from errormodel.effects.base import FIXED, Channels, Effect, EffectTerm, JointEffect, along
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import Rotation, across, joint_as
from errormodel.effects.travel import crossing, scaled
from errormodel.machine import Joint, Machine

# words in a ``w_`` column's name by which it is taken for a record of the two drives; by judgement
DRIVE_NAME_HINTS = ("sync", "enc", "rack", "drive", "skew", "gantry", "dual", "yaw")

# of a joint's positions, by which two drives differ at most for the second to be seen to follow the first; by judgement
SAME_POSITION_SHARE = 0.02

PIVOT = 500.0  # mm, usual distance of what the bridge turns about


class GantryRacking(JointEffect):
    """Yaw of `joint` (rad) per unit of `channel`.

    `channel` is a record of the two drives (``w_...``, their difference; ``w_x2 less X``, of which ``w_x2`` is the
    position of the second one), or without one the joint across (-1 to 1 over its travel) or the direction of approach
    ``dir_<joint>``: friction drags the bridge askew, and in a second parameter the more, the farther `by`, the joint
    across, has its carriage from the middle (-1 to 1 over its travel). By a record of the drives the joint moves
    `along` as well: the bridge turns about the drive whose encoder is controlled, or between both; without that about
    the joint's own origin, which may be such a drive. `zero` is what the record reads of drives in step, in its unit.
    """

    effect: ClassVar[str] = "gantry-racking"
    family: ClassVar[str] = "gantry"
    source: ClassVar[str] = "difference of the two encoders over their distance, 0.5 to 5 m: about 1e-3 rad/mm"
    alike: ClassVar[tuple[str, ...]] = ("cross-axis-compliance", "thermal-squareness")
    separate: ClassVar[str] = "log both encoders of the gantry, or measure two lines at the ends of the bridge"
    example: ClassVar[Mapping[str, object]] = {"joint": "X", "channel": "w_sync"}

    channel: str  # w_<name>, w_sync_<joint>, w_<name> less <joint>; without a record the joint across, or dir_<joint>
    motion: Rotation = "ec"
    by: str | None = None
    along: bool = True
    zero: Annotated[float, FIXED] = 0.0

    @model_validator(mode="after")
    def _of_friction(self) -> Self:
        if self.by is not None and not self.channel.startswith("dir_"):
            raise ValueError("by is the joint whose carriage friction holds back: with channel: dir_X only")
        return self

    @property
    def drivers(self) -> tuple[str, ...]:
        return (self.channel, self.by) if self.by else (self.channel,)

    def cost(self, scene: Scene) -> float:
        """Natural logarithm of the prior odds against it: without the drives' record or friction a mere compliance."""
        return 0.0 if self.channel.startswith("w_") or self.by else 5.0

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint = joint_as(machine, self.joint, "prismatic", self.effect)
        value, unit, size = channel(self.channel), "rad", 5e-5
        if self.channel.startswith("w_"):
            unit, size = f"rad/{self.channel}", 1e-3
            if self.channel == joint.difference or AHEAD_CHANNEL.fullmatch(self.channel):
                unit, size = "rad/mm", 1 / joint.spacing if joint.spacing else size
        elif not self.channel.startswith("dir_"):
            value = scaled(joint_as(machine, self.channel, "prismatic", self.effect), value)
        value = value - self.zero
        out = [EffectTerm(self.joint, "", unit, {self.motion: value}, size)]
        if self.channel.startswith("w_") and self.along:
            per = f"mm{unit.removeprefix('rad')}"
            out.append(EffectTerm(self.joint, "along", per, along(joint, value), PIVOT * size))
        if self.by:
            aside = scaled(joint_as(machine, self.by, "prismatic", self.effect), channel(self.by))
            out.append(EffectTerm(self.joint, "aside", unit, {self.motion: value * aside}, size))
        return out

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        pairs, zeros = list[tuple[Joint, str]](), dict[str, float]()
        for joint, name in product(scene.prismatic, scene.witnesses):
            if _second_drive(scene, name, joint):
                channel, values = f"{name} less {joint.name}", _ahead(scene, name, joint)
            elif _of_drives(name, joint) and not any(_second_drive(scene, name, j) for j in scene.prismatic):
                channel, values = name, scene.columns[name]
            else:
                continue
            pairs.append((joint, channel))
            middle = float(np.median(values))  # beside a large constant, which the geometry is as well, nothing shows
            zeros[channel] = float(f"{middle:.6g}") if abs(middle) > float(np.ptp(values)) else 0.0
        pairs += [(joint, other.name) for joint, other in crossing(scene)]
        pairs += [(joint, f"dir_{joint.name}") for joint in scene.prismatic if scene.both_ways(joint)]
        for joint, name in pairs:
            for motion in across(joint, "e"):
                zero = zeros.get(name, 0.0)
                yield cls(joint=joint.name, channel=name, motion=motion, zero=zero)
                if name.startswith("w_"):
                    yield cls(joint=joint.name, channel=name, motion=motion, along=False, zero=zero)
        for joint, other in crossing(scene):
            for motion in across(joint, "e") if scene.both_ways(joint) else ():
                yield cls(joint=joint.name, channel=f"dir_{joint.name}", motion=motion, by=other.name)


def _ahead(scene: Scene, name: str, joint: Joint) -> Array:
    """What a channel is beyond the position of a joint."""
    return scene.columns[name] - scene.columns[joint.name]


def _second_drive(scene: Scene, name: str, joint: Joint) -> bool:
    """Whether a channel is the position of a joint's second drive: it follows that of the joint to within a skew."""
    ahead = _ahead(scene, name, joint)
    most = MOST_SKEW_SHARE * (joint.travel[1] - joint.travel[0])
    return 0 < float(np.ptp(ahead)) < min(most, SAME_POSITION_SHARE * float(np.ptp(scene.columns[joint.name])))


def _of_drives(name: str, joint: Joint) -> bool:
    """Whether a column is by its name of a joint's two drives: ``w_sync``; ``w_x2`` of X; ``w_x1_x2``, of any joint."""
    word = name.lower()
    return (
        any(hint in word for hint in DRIVE_NAME_HINTS)
        or re.search(rf"(?<![a-z]){re.escape(joint.name.lower())}_?\d", word) is not None
        or re.search(r"(?<![a-z])([a-z]+)_?([12])(?!\d).*(?<![a-z])\1_?(?!\2)[12](?!\d)", word) is not None
    )
