"""Candidate grid of empirical terms: locations, motions, and functions of one channel or products of two.

Units are those of the channels: mm, rad, s and degC.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations, permutations, product

import numpy as np

from errormodel.conventions import MOTIONS, ROTATIONS, TRANSLATIONS
from errormodel.effects.search_space.equivalent_places import places, translating
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import frequencies
from errormodel.effects.travel import length
from errormodel.machine import joint_of

Fields = Mapping[str, object]
WAVES_PER_TRAVEL = np.arange(1, 3.01, 0.25)  # periods per travel of a wave; longer waves are polynomials
# terms periodic in time: fewest periods in the recording, and shortest period in s; by judgement
FEWEST_CYCLES, SHORTEST_CYCLE_S = 4, 240.0
MOST_CYCLE_PROPOSALS = 10_000  # most candidates periodic in time: more exceed the memory
SURFACE_PIECES = 4  # spline intervals per travel of a surface over two joints; by judgement
PLATE_WAVES_PER_TRAVEL = np.arange(0.5, 3.01, 0.5)  # periods per travel of waves in two joints at once; by judgement


def lattice(scene: Scene) -> Iterator[Fields]:
    """Fields of `errormodel.effects.unnamed.Unnamed`, one mapping per candidate."""
    yield from _single(scene)
    yield from _runs(scene)
    yield from _waves(scene)
    yield from _cycles(scene)
    yield from _products(scene)
    yield from _chequers(scene)
    yield from _surfaces(scene)


def _single(scene: Scene) -> Iterator[Fields]:
    """One channel, linear or cubic, at every location; a joint's own position at the joint itself is geometry."""
    for name in (*_joints(scene), *_others(scene)):
        for element, motion in places(scene, name):
            if element != name:
                for form in ("linear", "cubic"):
                    yield {"element": element, "motion": motion, "form": form, **_first(scene, name)}
    for name in _reversing(scene):
        for element, motion in places(scene, name):
            yield {"element": element, "motion": motion, "driver": f"dir_{name}"}


def _runs(scene: Scene) -> Iterator[Fields]:
    """An offset of one run at every location; at a joint also one in proportion to its position."""
    for name in scene.runs:
        for element, motion in places(scene, name):
            yield {"element": element, "motion": motion, "driver": name}
    for name, joint in product(scene.runs, _joints(scene)):
        for element, motion in places(scene, joint):
            if element == joint:
                yield {"element": element, "motion": motion, "driver": name, **_second(scene, joint)}


def _waves(scene: Scene) -> Iterator[Fields]:
    """Rotations that are periodic in another joint's position."""
    for name, count in product(_joints(scene), WAVES_PER_TRAVEL):
        for element, motion in places(scene, name):
            if element != name and motion in ROTATIONS:
                period = length(joint_of(scene.machine, name)) / float(count)
                yield {"element": element, "motion": motion, "driver": name, "period": period}


def _cycles(scene: Scene) -> Iterator[Fields]:
    """Translations that are periodic in time, as of a cooler, a compressor or a lubricator.

    Long recordings of many joints have too many: then only those at both ends of the chain, longest periods first.
    """
    if not scene.duration:
        return
    shortest = max(SHORTEST_CYCLE_S, 4 * scene.duration / len(scene.columns["time"]))
    rates = frequencies(scene.duration, FEWEST_CYCLES / scene.duration, 1 / shortest)
    spots = [(element, motion) for element, motion in places(scene, "time") if motion in TRANSLATIONS]
    if len(rates) * len(spots) > MOST_CYCLE_PROPOSALS:
        spots = [spot for spot in spots if spot[0] in (spots[0][0], spots[-1][0])]
    for rate, (element, motion) in product(rates[: MOST_CYCLE_PROPOSALS // len(spots)], spots):
        yield {"element": element, "motion": motion, "driver": "time", "period": float(f"{1 / rate:.6g}")}


def _products(scene: Scene) -> Iterator[Fields]:
    """Products of two positions at every location; at a joint, other channels times its position or its direction."""
    for one, two in combinations(_joints(scene), 2):
        for element, motion in places(scene, one):
            yield {"element": element, "motion": motion, **_first(scene, one), **_second(scene, two)}
    for joint in _joints(scene):
        grows = [{**_first(scene, name), **_second(scene, joint), "by_form": "affine"} for name in _others(scene)]
        if joint in _reversing(scene):
            others = (*_joints(scene), *_others(scene))
            grows += [{"driver": f"dir_{joint}", **_second(scene, name)} for name in others]
        for element, motion in places(scene, joint):
            if element == joint:
                for fields in grows:
                    yield {"element": element, "motion": motion, **fields}


def _chequers(scene: Scene) -> Iterator[Fields]:
    """Translations that are waves in two prismatic joints at once, as of a table that is not flat."""
    lengths = {j.name: length(j) for j in scene.prismatic}
    for section in translating(scene):
        for one, two in combinations([n for n in section if n in lengths], 2):
            for motion, k, n in product(TRANSLATIONS, PLATE_WAVES_PER_TRAVEL, PLATE_WAVES_PER_TRAVEL):
                first = {"driver": one, "period": lengths[one] / float(k)}
                second = {"by": two, "by_period": lengths[two] / float(n)}
                yield {"element": one, "motion": motion, **first, **second}


def _surfaces(scene: Scene) -> Iterator[Fields]:
    """Smooth motions over two joints of an arm, at the location of either joint."""
    turning = {j.name for j in scene.rotary}
    if len(turning) <= len(scene.prismatic):
        return
    for one, two in permutations(_joints(scene), 2):
        if turning & {one, two} and len(scene.columns[one]) > (SURFACE_PIECES + 3) ** 2:
            for motion in MOTIONS:
                yield {
                    "element": one,
                    "motion": motion,
                    **_first(scene, one),
                    **_second(scene, two),
                    "pieces": SURFACE_PIECES,
                }


def _joints(scene: Scene) -> list[str]:
    return [j.name for j in scene.moving]


def _others(scene: Scene) -> list[str]:
    """Varying channels that are no joint positions."""
    return [*scene.sensors, *scene.witnesses, *(n for n in ("time", "feed", "load") if scene.varies(n))]


def _reversing(scene: Scene) -> list[str]:
    return [j.name for j in scene.moving if scene.both_ways(j)]


def _scale(scene: Scene, name: str) -> tuple[float, float]:
    """Centre and half range of a channel to four digits: of a joint's travel, of another channel as recorded."""
    joint = next((j for j in scene.machine.joints if j.name == name), None)
    low, high = joint.travel if joint else (float(f(scene.columns[name])) for f in (np.min, np.max))
    return float(f"{(low + high) / 2:.4g}"), float(f"{(high - low) / 2:.4g}")


def _first(scene: Scene, name: str) -> Fields:
    center, half = _scale(scene, name)
    return {"driver": name, "center": center, "half_range": half}


def _second(scene: Scene, name: str) -> Fields:
    center, half = _scale(scene, name)
    return {"by": name, "by_center": center, "by_half_range": half}
