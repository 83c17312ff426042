"""Hysteresis: friction remembers the path, so that a short move back undoes only part of a reversal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from errormodel.effects.base import Channels, Effect, EffectTerm, JointEffect, along
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import Positive
from errormodel.machine import Machine, joint_of


class Hysteresis(JointEffect):
    """``size * (position - what follows it with a play)/width`` along the axis (mm, or rad about it).

    `width` (mm, rad) is how far the joint must move to turn wholly; after long moves it is ``size/2 * direction``, as
    backlash.
    """

    effect: ClassVar[str] = "hysteresis"
    family: ClassVar[str] = "reversal"
    source: ClassVar[str] = "play operator of Prandtl and Ishlinskii; 0 to 50 um on machine tools"
    alike: ClassVar[tuple[str, ...]] = ("backlash", "lost-motion")
    separate: ClassVar[str] = "nested reversals: go back by 0.01, 0.1, 1 and 10 mm, and by large steps"
    example: ClassVar[Mapping[str, object]] = {"joint": "X", "width": 60.0}

    width: Positive

    @property
    def cost(self) -> float:
        return 2.0  # plain backlash is the usual form

    @property
    def drivers(self) -> tuple[str, ...]:
        return (f"dir_{self.joint}",)

    def terms(self, channel: Channels, machine: Machine) -> list[EffectTerm]:
        joint = joint_of(machine, self.joint)
        unit, size = ("mm", 0.02) if joint.type == "prismatic" else ("rad", 5e-5)
        left = channel(self.joint) - channel(f"play({self.joint},{self.width:.6g})")
        return [EffectTerm(self.joint, "", unit, along(joint, left / self.width), size)]

    @classmethod
    def proposals(cls, scene: Scene) -> Iterator[Effect]:
        """Widths that one move in ten does not overcome: with smaller ones it is backlash."""
        for joint in scene.moving:
            moves = np.abs(np.diff(scene.columns[joint.name]))
            if scene.both_ways(joint) and moves.any():
                width = float(np.quantile(moves[moves > 0], 0.1))
                while width < np.ptp(scene.span(joint)) / 2:
                    yield cls(joint=joint.name, width=width)
                    width *= 1.6
