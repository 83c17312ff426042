"""Alarm texts: the quantity, the size of its change, and the likely place of the cause on the machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from errormodel import effects
from errormodel.chain import Chain
from errormodel.conventions import ROTATIONS
from errormodel.machine import Joint
from identification.monitoring.control_limits import Judged
from identification.monitoring.quantities import NOISE_ID, ZERO_ID, Cycle, Watched
from identification.results.parameter_table import decimals

VERBS = {"range": "left its range", "drift": "drifts"}  # kinds of alarm of a single quantity
MOST_NAMED = 3  # quantities named in the alarm of all together, by share of the distance; by judgement


def look_at(chain: Chain, what: Watched) -> str:
    """Usual place of the cause of a change, in words."""
    if what.id == NOISE_ID:
        return "a loose target or sensor, vibration, or physics that the model lacks: run `errormodel diagnose` on it"
    joints = {j.name: j for j in chain.machine.joints}
    if (zero := ZERO_ID.fullmatch(what.id)) is not None:
        own = _of_joint(joints[zero["joint"]], zero["motion"])
        return f"{own}; or the mounting and zero of that sensor"
    if what.id not in chain.index:
        return "a collision, clamping, levelling, the foundation, or the guideways' straightness"
    known = chain.parameters[chain.index[what.id]]
    if what.id in chain.of_effects:
        spec = next(e for e, ids in zip(chain.machine.effects, chain.effect_ids, strict=True) if what.id in ids)
        return f"the {spec.effect} of {known.element}; to be sure: {effects.make(spec).separate}"
    if known.element in joints:
        return _of_joint(joints[known.element], known.motion)
    if known.motion in ROTATIONS:
        return f"squareness and parallelism at {known.element}: a collision, clamping, levelling, the foundation"
    return f"the position of {known.element}: tool or target mount, a collision, thermal growth"


def _of_joint(joint: Joint, motion: str) -> str:
    rotation = motion in ROTATIONS
    along = abs(joint.axis["abc".index(motion[1]) if rotation else "xyz".index(motion[1])]) > 0.5
    if joint.type == "rotary":
        if along:
            return f"the encoder and bearing of {joint.name}" if rotation else f"the axial bearing of {joint.name}"
        return f"the bearings of {joint.name}: tilt" if rotation else f"the bearings of {joint.name}: run-out"
    if not rotation:
        return (
            f"the scale or screw of {joint.name}, its temperature and compensation"
            if along
            else f"the straightness of {joint.name}'s guideway, its bed and levelling"
        )
    if along:
        return f"the level and twist of {joint.name}'s guideways"
    racking = "; with two drives, racking: compare both encoders and the drives' synchronisation"
    return f"the guideways and carriage bearings of {joint.name}{racking if motion == 'ec' else ''}"


def alarm_text(found: Sequence[Mapping[str, object]], capital: bool = False) -> str:
    """Short text of an alarm: the quantities by name, or all of them together."""
    names = [f"{a['name']} {VERBS[str(a['kind'])]}" for a in found if a["kind"] in VERBS]
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    text = ", ".join(names[:MOST_NAMED]) + more if names else "no quantity by itself, but all of them together"
    return text[:1].upper() + text[1:] if capital else text


def value_text(what: Watched, value: float, std: float) -> str:
    """A value with the number of digits that its standard uncertainty supports."""
    if not np.isfinite(value):
        return "-"
    shown = what.shown(value)
    if what.is_log:
        return f"{shown:.3g}"
    return f"{shown:.{decimals(abs(what.shown(std)))}f}"


def alarms(chain: Chain, what: tuple[Watched, ...], cycle: Cycle, judged: Judged) -> list[dict[str, object]]:
    """One entry per alarm: kind, ids, name and statement; ordered by p-value, drifts after ranges."""
    out: list[tuple[float, dict[str, object]]] = []
    std = cycle.std
    for k, w in enumerate(what):
        unit = f" {w.shown_unit}" if w.shown_unit else ""
        if judged.beyond[k]:
            now, mean, low, high = (
                value_text(w, v, std[k]) for v in (cycle.values[k], judged.mean[k], judged.low[k], judged.high[k])
            )
            text = (
                f"{w.name} left its normal range: {now}{unit}, where {judged.count[k]:.0f} cycles gave {mean} and "
                f"let expect {low} to {high}. Look at {look_at(chain, w)}"
            )
            out.append((judged.p[k], {"kind": "range", "ids": [w.id], "name": w.name, "statement": text}))
        elif judged.drifting[k]:
            way = "up" if judged.drift[k] > 0 else "down"
            now, mean = (value_text(w, v, std[k]) for v in (cycle.values[k], judged.mean[k]))
            text = (
                f"{w.name} drifts {way}: {now}{unit} after a mean of {mean}, each cycle within its range but too many "
                f"on one side. Wear or settling: look at {look_at(chain, w)}"
            )
            out.append((1.0, {"kind": "drift", "ids": [w.id], "name": w.name, "statement": text}))
    if judged.together_beyond and not judged.beyond.any():
        first = np.argsort(-judged.share)[:MOST_NAMED]
        names = ", ".join(f"{what[k].name} ({100 * judged.share[k]:.0f} %)" for k in first if judged.share[k] > 0)
        text = (
            f"the quantities together lie farther from their mean than cycles do, though each is within its range; "
            f"mostly {names}. Look at {look_at(chain, what[int(first[0])])}"
        )
        ids = [what[k].id for k in first if judged.share[k] > 0]
        out.append((2.0, {"kind": "together", "ids": ids, "statement": text}))
    return [entry for _, entry in sorted(out, key=lambda pair: pair[0])]
