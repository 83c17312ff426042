"""Effects that a survey cannot test, the reason, and the measurement that would show them.

An effect is looked for at every place that a full survey of the same machine (all joints moving, from both sides, with
two tools, temperatures, times, feeds and loads) would let it be looked for at. Where this survey lacks a channel, or
where the geometry takes up all that the effect does, it is untestable; what the machine cannot have is not mentioned.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import TOOL_CHANNELS
from errormodel.channels import root
from errormodel.effects import registry
from errormodel.effects.base import Effect
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.machine import Joint, joint_of
from identification.diagnosis.decisions.constants import ABSORBED, DECISIVE_ODDS, NEAR
from identification.diagnosis.decisions.log import UNRECORDED, DecisionLog
from identification.diagnosis.results.findings import Untestable
from identification.diagnosis.search.candidates import Scores

Variant = tuple[str, str, bool]
ROWS = 400  # of the full survey


def unseen(scene: Scene, scores: Scores, found: Collection[Effect], log: DecisionLog = UNRECORDED) -> list[Untestable]:
    """Untestable effects with their places, from the scores of all candidates; `found` effects are not among them."""
    detectable = _least_detectable(len(scores.candidates.effects))
    least: dict[Variant, tuple[float, float]] = {}
    for numbers in scores.candidates.of_key.values():
        place = variant_of(scores.candidates.effects[numbers[0]])
        before = least.get(place, (1.0, 0.0))
        least[place] = min(before[0], *scores.absorbed[numbers]), max(before[1], *scores.expected_delta_chi2[numbers])
    shown = set(map(variant_of, found))
    there = {(effect.effect, effect.where) for effect in found}  # seen by another clock or sensor
    out = []
    for name, kind in sorted(registry().items()):
        if kind.empirical or not kind.traits().physical:
            continue
        possible: dict[Variant, list[Effect]] = {}
        proposed = set(map(variant_of, kind.proposals(scene))) if scene.readings else set()
        for effect in kind.proposals(full_scene(scene)):
            if scene.shows(effect.where):
                possible.setdefault(variant_of(effect), []).append(effect)
        reasons: dict[str, list[str]] = {}
        both = len({changes for _, _, changes in possible}) > 1
        for variant, effects in possible.items():
            if variant in shown:
                continue
            where = variant[1] if not both else f"{variant[1]} {'as it changes' if variant[2] else 'if constant'}"
            part, expected_delta_chi2 = least.get(variant, (None, np.inf))
            if part is None and variant[:2] in there:
                continue
            if part is None and variant in proposed:
                log.add("not-in-readings", "not considered", effects[0], beside=" ".join(scene.readings))
                reasons.setdefault(f"none of the readings ({', '.join(scene.readings)}) depends on it", []).append(
                    where
                )
            elif part is None:
                lacks = _missing(effects, scene)
                log.add("not-recorded", "not considered", effects[0], beside=lacks)
                reasons.setdefault(lacks, []).append(where)
            elif expected_delta_chi2 < detectable and part > 1 - NEAR:
                log.add("below-noise", "not considered", effects[0], float(expected_delta_chi2), detectable)
                reason = "what the geometry leaves of it at its usual size stays within the noise"
                reasons.setdefault(reason, []).append(where)
            elif scene.readings and expected_delta_chi2 < detectable:
                log.add("below-noise", "not considered", effects[0], float(expected_delta_chi2), detectable)
                reason = "at its usual size it changes what was read by less than the noise"
                reasons.setdefault(reason, []).append(where)
            elif part > ABSORBED:
                log.add("hidden-by-geometry", "not considered", effects[0], float(part), ABSORBED)
                reasons.setdefault(f"the geometry absorbs {100 * part:.0f} % of it", []).append(where)
            elif untried := _by_unusable(effects, scene):
                for sensor, effect in untried.items():
                    log.add("sensor-not-tried", "not considered", effect, beside=_cannot_be_used([sensor], scene))
                lacks = "; ".join(f"by {s}, which cannot be used: {scene.unusable[s]}" for s in untried)
                reasons.setdefault(lacks, []).append(where)
        said = {place for places in reasons.values() for place in places}
        said |= {effect.where for effect in found if effect.effect == name}
        for joint in scene.moving:
            if joint.name not in said and (why := kind.unresolved(scene, joint)):
                log.compared("unresolved-positions", name, joint.name, joint.name, None, None, why)
                reasons.setdefault(f"{why[0].lower()}{why[1:].split(':')[0]}", []).append(joint.name)
        for reason, places in reasons.items():
            at = "" if len(places) == len(possible) else f"at {', '.join(places)}: "
            out.append(Untestable(name, at + reason, kind.recommended(scene.columns)))
    if scene.readings:
        out += _hidden_forms(scores, found, scene)
    return out


def _hidden_forms(scores: Scores, found: Collection[Effect], scene: Scene) -> Iterator[Untestable]:
    """Forms of motions beyond the model that lengths and angles cannot tell from it: they bias what is fitted."""
    hidden: dict[str, dict[str, str]] = {}
    for effect, part in zip(scores.candidates.effects, scores.absorbed, strict=True):
        motion, _, degree = effect.motion_form.partition(" of ")
        if motion and part > ABSORBED and effect not in found:
            hidden.setdefault(effect.effect, {}).setdefault(motion, degree)  # the lowest degree comes first
    for name, forms in hidden.items():
        words = "; ".join(
            f"of {d}: {', '.join(sorted(m for m in forms if forms[m] == d))}" for d in sorted({*forms.values()})
        )
        reason = f"{words}: the geometry absorbs all of it, so that fitted parameters may hold it"
        yield Untestable(name, reason, registry()[name].recommended(scene.columns))


def unconsidered(effect: Effect, scene: Scene) -> str:
    """That unusable sensors may be the cause of what time or another sensor drives; empty where none may be.

    At the place of the effect, of effects that a full survey would have proposed by them.
    """
    if not scene.unusable or not _changes(effect.drivers):
        return ""
    full, physical = full_scene(scene), (k for k in registry().values() if not k.empirical and k.traits().physical)
    untried = _by_unusable([e for kind in physical for e in kind.proposals(full) if e.where == effect.where], scene)
    said = " and ".join(f"{name} cannot be used ({scene.unusable[name]})" for name in untried)
    which = "it was not considered, and" if len(untried) == 1 else "they were not considered, and each"
    return f"{said}: {which} may be the cause." if untried else ""


def _by_unusable(effects: Sequence[Effect], scene: Scene) -> dict[str, Effect]:
    """Unusable sensors that would drive some of the effects, each with the first that it would."""
    out = dict[str, Effect]()
    for effect in effects:
        for name in map(root, effect.drivers):
            if name in scene.unusable:
                out.setdefault(name, effect)
    return out


def _cannot_be_used(names: Collection[str], scene: Scene) -> str:
    """That sensors cannot be used, and why."""
    return "; ".join(f"{name} cannot be used: {scene.unusable[name]}" for name in names)


def variant_of(effect: Effect) -> Variant:
    """An effect's word, its place, and whether it changes with warmth or time."""
    return effect.effect, effect.where, _changes(effect.drivers)


@lru_cache
def _changes(drivers: tuple[str, ...]) -> bool:
    return any("T_" in d or d == "time" for d in drivers)


def full_scene(scene: Scene) -> Scene:
    """The machine as a full survey would have it, with this survey's sensors, working, where it has any."""
    rng = np.random.default_rng(0)
    time: Array = 60.0 * np.arange(ROWS, dtype=np.float64)
    columns: dict[str, Array] = {}
    columns["time"] = time
    for joint in scene.machine.joints:
        columns[joint.name] = rng.uniform(*joint.travel, ROWS)
        columns[f"dir_{joint.name}"] = rng.choice([-1.0, 1.0], ROWS)
    others = () if scene.sensors else ("T_one", "T_two")
    for k, sensor in enumerate((*scene.sensors, *scene.unusable, *others)):
        columns[sensor] = 20 + np.sin(time / time[-1] * (k + 2))
    for name in ("feed", "load"):
        columns[name] = rng.choice([0.0, 1000.0, 2000.0], ROWS)
    tools = np.array([scene.machine.tool, tuple(1.5 * v + 20 for v in scene.machine.tool)])
    columns |= dict(zip(TOOL_CHANNELS, tools[np.arange(ROWS) % 2].T, strict=True))
    return replace(scene, columns=columns)


def _least_detectable(trials: int) -> float:
    """Delta chi-squared of one parameter whose log Bayes factor pays for `DECISIVE_ODDS` and all proposals tried."""
    paid = 2 * float(np.log(DECISIVE_ODDS * max(trials, 1)))
    return paid + float(np.log1p(paid))


def _missing(effects: Sequence[Effect], scene: Scene) -> str:
    """What a survey lacks for the one of some effects that asks for least."""
    lacks = [list(dict.fromkeys(_lacking(effect.channels(scene.machine), scene))) for effect in effects]
    fewest = min(lacks, key=len)
    if not fewest and scene.motions_of:
        return "none of the motions that it makes was read, or at too few positions"
    if fewest:
        return " and ".join(fewest)
    asked = {root(name) for effect in effects for name in effect.channels(scene.machine)}
    off = [j.name for j in scene.moving if j.name in asked and _beyond(scene, j)]
    if off:
        return f"most positions of {' and '.join(off)} lie outside the travel: another zero, or another travel"
    return "its positions are too few or too far apart"


def _beyond(scene: Scene, joint: Joint) -> bool:
    """Whether most positions of a joint lie outside its travel."""
    middle = float(np.median(scene.columns[joint.name]))
    return not joint.travel[0] <= middle <= joint.travel[1]


def _lacking(names: Sequence[str], scene: Scene) -> Iterator[str]:
    joints = {j.name for j in scene.machine.joints}
    for channel in map(root, names):
        if channel.startswith("dir_") and not scene.both_ways(joint_of(scene.machine, channel[4:])):
            yield f"{channel[4:]} always arrived from the same side"
        elif channel in joints and not scene.varies(channel):
            yield f"{channel} did not move"
        elif channel.startswith("T_") and not scene.sensors:
            yield _cannot_be_used(scene.unusable, scene) or "no temperature was recorded that changes"
        elif channel in scene.unusable:
            yield _cannot_be_used([channel], scene)
        elif channel in ("time", "feed", "load") and not scene.varies(channel):
            yield f"no {channel} was recorded that changes"
        elif channel in TOOL_CHANNELS and not any(scene.varies(c) for c in TOOL_CHANNELS):
            yield "only one tool was used"
