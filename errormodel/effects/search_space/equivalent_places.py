"""Equivalent locations: elements of a chain at which a small motion has the same effect on the measured points.

A candidate is proposed once for each group of equivalent elements.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

from errormodel.conventions import FRAME, ROTATIONS, TOOL, TRANSLATIONS, Motion
from errormodel.effects.base import axis_motion
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.travel import direction, parallel


@lru_cache(maxsize=32)
def rotating(scene: Scene, motion: Motion | None = None) -> list[list[str]]:
    """Groups of elements at which a rotation (any, or `motion` only) acts alike, but for a constant lever."""
    groups, moving = [[FRAME]], {j.name: j for j in scene.moving}
    for element in scene.machine.elements:
        joint = moving.get(element.name)
        if joint and joint.type == "prismatic" and not (motion and parallel(joint.axis, direction(motion))):
            groups.append([])  # its errors are those of the carriage, after the motion
        groups[-1].append(element.name)
        if joint and joint.type == "rotary":
            groups.append([])  # its errors are applied before the rotation
    groups[-1].append(TOOL)
    return groups


@lru_cache(maxsize=8)
def translating(scene: Scene) -> list[list[str]]:
    """Groups of elements at which a translation acts alike: the sections between rotary joints."""
    turns = {j.name for j in scene.rotary}
    sections: list[list[str]] = [[]]
    for group in rotating(scene):
        sections[-1] += group
        if turns & set(group):
            sections.append([])
    return [s for s in sections if s]


def places(scene: Scene, driver: str) -> Iterator[tuple[str, Motion]]:
    """One element per location and motion: `driver` if present, else a joint along the motion, a joint, the first."""
    joints = {j.name: j for j in scene.machine.joints}
    for section in translating(scene):
        for motion in TRANSLATIONS:
            own = [n for n in section if n == driver]
            carriers = [n for n in section if n in joints and axis_motion(joints[n]) == motion]
            yield _first(own, carriers, [n for n in section if n in joints], section), motion
    for motion in ROTATIONS:
        for group in rotating(scene, motion):
            if group != [TOOL]:  # a rotation about the functional point displaces no point
                yield _first([n for n in group if n == driver], [n for n in group if n in joints], group), motion


def _first(*choices: list[str]) -> str:
    return next(names[0] for names in choices if names)
