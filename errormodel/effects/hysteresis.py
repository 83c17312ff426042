"""Hysteresis of a joint by friction: the play operator of Prandtl and Ishlinskii.

A short reversal recovers only part of the reversal error. Units: mm along the axis, or rad about it; of another error
motion its own. A carriage that friction holds back at one rail yaws.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from errormodel.conventions import MOTIONS, ROTATIONS, Motion, unit_of
from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect, along
from errormodel.effects.families import Traits
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import Positive, reversal_size
from errormodel.effects.travel import usual_size
from errormodel.machine import Machine, joint_of

FINER = 1.6  # ratio of neighbouring widths; by judgement


class Hysteresis(JointEffect):
    """``size * (q - p)/width`` along the axis (mm) or about it (rad); p follows the position q with a play of `width`.

    `width` (mm, rad) is the travel needed for a complete reversal. After long moves the effect is that of backlash,
    ``size/2 * direction``. With `motion` it is another error motion of the joint, mm or rad.
    """

    effect: ClassVar[str] = "hysteresis"
    family: ClassVar[str] = "reversal"
    source: ClassVar[str] = "play operator of Prandtl and Ishlinskii; 0 to 50 um on machine tools"
    alike: ClassVar[tuple[str, ...]] = ("backlash", "lost-motion")
    separate: ClassVar[str] = "nested reversals: go back by 0.01, 0.1, 1 and 10 mm, and by large steps"
    example: ClassVar[Mapping[str, object]] = {"joint": "X", "width": 60.0}

    width: Positive
    motion: Motion | None = None

    @classmethod
    def traits(cls) -> Traits:
        """Friction has many plays of several widths, of which this is the one that fits best."""
        return replace(super().traits(), form_uncertainty=0.3)  # of later poses of five recordings

    def cost(self, scene: Scene) -> float:
        return 2.0  # log prior odds against it: backlash is the usual form

    @property
    def drivers(self) -> tuple[str, ...]:
        return (f"dir_{self.joint}",)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint = joint_of(machine, self.joint)
        left = (channel(self.joint) - channel(f"play({self.joint},{self.width:.6g})")) / self.width
        if self.motion is not None:
            return [EffectTerm(self.joint, "", unit_of(self.motion), {self.motion: left}, usual_size(self.motion))]
        unit, size = reversal_size(joint)
        return [EffectTerm(self.joint, "", unit, along(joint, left), size)]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        """Widths from the tenth percentile of the moves on; below it the effect is backlash.

        Of other motions than along the axis (of bearings: tilts) fewer, from a quarter of it on, as their reversal has
        no other name.
        """
        for joint in scene.moving:
            moves = np.abs(np.diff(scene.columns[joint.name]))
            if scene.both_ways(joint) and moves.any():
                first, widest = float(np.quantile(moves[moves > 0], 0.1)), np.ptp(scene.span(joint)) / 2
                kinds = MOTIONS if joint.type == "prismatic" else ROTATIONS  # bearings tilt an axis
                others = [m for m in kinds if m not in along(joint, 1.0)]
                yield from (cls(joint=joint.name, width=first / 4, motion=motion) for motion in others)
                for number in range(int(np.ceil(np.log(max(widest / first, 1)) / np.log(FINER)))):
                    for motion in (None, *others) if number % 2 == 0 else (None,):
                        yield cls(joint=joint.name, width=first * FINER**number, motion=motion)
