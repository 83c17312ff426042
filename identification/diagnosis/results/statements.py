"""The sentences of a finding: what was found and how large, in shop units, and the next measurement."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from errormodel.arrays import Array
from errormodel.channels import root
from errormodel.conventions import FRAME, INSTRUMENT, TOOL, TRANSLATIONS, Motion, iso_symbol, unit_of
from errormodel.effects.base import Effect
from errormodel.effects.unnamed import Unnamed
from errormodel.exceptions import enumerated
from errormodel.machine import Joint, Machine
from identification.diagnosis.data_checks.blunder import length
from identification.diagnosis.results.driver_words import causes, channel, duration
from identification.diagnosis.results.effect_size import Whole, constant
from identification.diagnosis.results.recorded_functions import CLOCK, ROW
from identification.diagnosis.results.residual_dependence import FIXED_TARGETS
from identification.results.parameter_table import chance, decimals, printed

SURE = 0.7  # probability below which a name is only one of several
HIDDEN = 0.05  # smaller shares that are collinear with the geometry are not mentioned
SECOND = 0.5  # of what the largest motion does at the tip: a second one is mentioned if it does as much
USUAL, LARGE = 2.0, 4.0  # physical sizes: up to there an effect is usual, up to there large
SPOKEN = {"period", "edge", "by_edge", "at", "width", "tau"}  # shape parameters with words of their own
ONE_WAY = 0.3  # of the larger of two waves, one in the sum and one in the difference: the other is not mentioned
LEAST_SEEN_UM = 0.01  # what is smaller is not said
MOST_TURNS = 3  # a turn: fewer are given as a period only
MACHINE_AXES: dict[Motion, str] = {"dx": "x", "dy": "y", "dz": "z", "ea": "x", "eb": "y", "ec": "z"}
PLACES = {FRAME: "the measuring frame", TOOL: "the tool", INSTRUMENT: "the instrument"}


def statement_of(whole: Whole, machine: Machine, absorbed: float, probability: float, others: Sequence[str]) -> str:
    """The sentence. `others`: explanations that this data cannot tell from it, as ``lost-motion of X``, in words."""
    main = whole.effects[0]
    name = subject(main)
    same = [main] if main.empirical else [e for e in whole.effects if e.effect == main.effect]
    driven = f"driven by {causes(same)}{shape(main, machine)}{_runs(whole)}"
    cause = "the same in all rows" if _steady(whole) else driven
    parts = [f"{name[0].upper()}{name[1:]}, {cause}: "]
    at_tip = [f"{length(whole.size_um)} rms at the tip"] if _determined(whole) else []
    parts.append("; ".join((*_figures(whole, machine), *at_tip)))
    if absorbed > HIDDEN:
        parts.append(f"; the geometry had hidden {100 * absorbed:.0f} % of it")
    parts.append(f". Probability {chance(probability)}")
    if probability < SURE and not main.empirical:
        parts.append(f": the name is uncertain{', it may as well be ' + ' or '.join(others[:3]) if others else ''}")
    return "".join(parts) + "."


def subject(effect: Effect) -> str:
    """An effect with its place."""
    place = PLACES.get(effect.where, effect.where)
    return f"an effect without a name at {place}" if effect.empirical else f"{effect.effect} of {place}"


def brief_of(whole: Whole, machine: Machine) -> str:
    """The name, place and size of a finding: ``beam-sag of X by 15 um (EZX)``."""
    name = subject(whole.effects[0])
    if not whole.tip:
        return name
    place = max(whole.tip, key=lambda p: whole.tip[p])
    if not _determined(whole):
        return f"{name} of a size that the data do not determine ({motion_name(place, machine)})"
    if {*whole.units.values()} == {"s"}:  # a delay moves as much as the machine is fast
        return f"{name} by {plus_minus(whole.amounts[0].value, 0.0, 's')}"
    value = abs(whole.amounts[0].value) if _steady(whole) else whole.range(place, _own(whole, place))[0]
    factor, unit = printed(unit_of(place[1]))
    size = f"{factor * value:.{max(0, 1 - math.floor(math.log10(max(factor * value, 1e-3))))}f}"
    total = f", {total}" if (total := _in_all(whole, place, sure=True)) else ""
    return f"{name} by {size} {unit.replace('µ', 'u')} ({motion_name(place, machine)}{total})"


def alike_of(places: Sequence[tuple[str, Motion]], machine: Machine) -> str:
    """That other motions do the same to the tip, as a sentence; empty where there are none."""
    said = enumerated([spoken(place, machine) for place in places], "or")
    return f"At the tip {said} would be the same: these data do not tell them apart." if said else ""


def named(explanation: str, probability: float | None) -> str:
    """Another explanation with its probability, if one is known."""
    return explanation if probability is None else f"{explanation} (probability {probability:.2f})"


def spoken(place: tuple[str, Motion], machine: Machine) -> str:
    """A motion of an element as one says it: ``dy of W (EYW)``."""
    element, motion = place
    if element in {j.name for j in machine.joints}:
        return f"{motion} of {element} ({iso_symbol(element, motion)})"
    return motion_name(place, machine)


def motion_name(place: tuple[str, Motion], machine: Machine) -> str:
    """A motion by its ISO name, or of a member by its id: ``EYW``, ``dz of the tool``."""
    element, motion = place
    if element in {j.name for j in machine.joints}:
        return iso_symbol(element, motion)
    if element in {s.name for s in machine.shapes}:
        return f"{motion} of {element}"
    # it may be turned against the machine, in whose axes it is moved
    axes = f" {'along' if motion in TRANSLATIONS else 'about'} {MACHINE_AXES[motion]} of the machine"
    return f"{motion} of {PLACES.get(element, element)}{axes if element == FRAME else ''}"


def position(joint: Joint | None, value: float) -> str:
    """A position or a distance of a joint."""
    if joint is not None and joint.type == "rotary":
        return f"{math.degrees(value):.4g} deg"
    return f"{value:.4g} mm" if joint is not None else f"{value:.4g}"


def driving(effect: Effect, machine: Machine) -> Joint | None:
    """The joint along which an effect has its period, place and width, if it is one."""
    names = {n.removeprefix("dir_") for n in effect.drivers[:1]}
    return next((j for j in machine.joints if j.name in names), None)


def period_of(effect: Effect, machine: Machine) -> float | None:
    """An effect's period as files have it: mm, or degrees of a rotary joint."""
    period = getattr(effect, "period", None)
    joint = driving(effect, machine)
    if period is None or (joint is None and getattr(effect, "edge", None) is not None):  # switches once
        return None
    return math.degrees(period) if joint is not None and joint.type == "rotary" else float(period)


def periods_of(effect: Effect, machine: Machine) -> list[float]:
    """An effect's period along each of its drivers, as files have it: mm, s, or degrees of a rotary joint."""
    first, second = period_of(effect, machine), getattr(effect, "by_period", None)
    if first is None or second is None:
        return [] if first is None else [first]
    turning = {j.name for j in machine.joints if j.type == "rotary"}
    return [first, math.degrees(second) if effect.drivers[1] in turning else float(second)]


def shape(effect: Effect, machine: Machine) -> str:
    """Period, place, width and the like, in words; empty where an effect has none."""
    joint, words = driving(effect, machine), []
    joints = {j.name: j for j in machine.joints}
    if period_of(effect, machine) and (period := getattr(effect, "period", None)):
        turning = joint is not None and joint.type == "rotary"
        waves = (1, 2) if getattr(effect, "oval", False) else (1,)
        turns = f" ({' and '.join(f'{n * 2 * math.pi / period:.4g}' for n in waves)} a turn)" if turning else ""
        size = duration(period) if effect.drivers[0] == "time" else position(joint, period)
        if (second := getattr(effect, "by_period", None)) is not None:
            one, other = effect.drivers
            words.append(f"with periods of {size} of {one} and {position(joints.get(other), second)} of {other}")
        else:
            words.append(f"with a period of {size}{turns}")
    for driver, name in zip(effect.drivers, ("edge", "by_edge"), strict=False):
        if (edge := getattr(effect, name, None)) is not None:
            place = f"{edge:.5g} s" if driver == CLOCK else position(joints.get(driver), edge)
            words.append(
                f"from row {math.ceil(edge)} on" if driver == ROW else f"switching where {driver} passes {place}"
            )
    if (at := getattr(effect, "at", None)) is not None:
        words.append(f"from {at:.5g} s on" if "time" in effect.drivers else f"at {position(joint, at)}")
    if (row := getattr(effect, "row", None)) is not None:
        words.append(f"from row {math.ceil(row)} on")
    if width := getattr(effect, "width", None):
        words.append(f"within {position(joint, width)}")
    if effect.random and (every := getattr(effect, "every", None)):
        words.append(f"as a curve of splines {position(joint, every)} apart")
    if effect.random and getattr(effect, "pieces", None):
        words.append("as a surface of splines" if getattr(effect, "by", None) else "as a curve of splines")
    words += [
        f"with {name.replace('_', ' ')} {_shape_value(effect, name, machine)}"
        for name, kind in effect.shapes().items()
        if kind.said and name not in SPOKEN and getattr(effect, name) is not None
    ]
    return f", {', '.join(words)}" if words else ""


def _runs(whole: Whole) -> str:
    """Whether a wave along two joints is one in their sum or their difference, in words."""
    main, size = whole.effects[0], len(whole.ids[0])
    # with edges there are fewer functions, with pieces more
    if not isinstance(main, Unnamed) or main.period is None or main.by_period is None or size != 4:
        return ""
    ss, sc, cs, cc = whole.values[:size].tolist()  # in the order of `waves`
    both = math.hypot(cc - ss, sc + cs), math.hypot(cc + ss, sc - cs)
    if ONE_WAY * max(both) < min(both):
        return ""
    return f", as one wave in {main.driver} {'+' if both[0] > both[1] else '-'} {main.by}"


def _shape_value(effect: Effect, name: str, machine: Machine) -> str:
    """A shape parameter in its unit."""
    unit, value = effect.unit_of_shape(name, machine), float(getattr(effect, name))
    if unit == "s":
        return duration(value)
    return f"{math.degrees(value):.4g} deg" if unit == "rad" else f"{value:.4g} {'' if unit == '1' else unit}".strip()


def _figures(whole: Whole, machine: Machine) -> Iterator[str]:
    """How large: the physical parameter where there is one, and the motions that show most."""
    main = whole.effects[0]
    other = [e.effect != main.effect or _grows(e) != _grows(main) for e in whole.effects]
    known = not (main.random or main.empirical or any(other))  # a size that can be compared with what is usual
    coefficients = _coefficients(whole, machine) if known else ""
    if coefficients:
        yield coefficients
    if main.random and whole.amounts:
        rms = whole.amounts[0]
        yield f"{plus_minus(rms.value, rms.std, rms.unit)} rms"
    ranked = sorted(whole.tip, key=lambda place: -whole.tip[place])
    if not ranked:  # beside all the others the data no longer tell it from the geometry
        return
    if _steady(whole):
        amount = whole.amounts[0]
        doubt = "" if _determined(whole) else _undetermined(whole)
        yield f"{spoken(ranked[0], machine)} is off by {plus_minus(amount.value, amount.std, amount.unit)}{doubt}"
        return
    shown = [p for p in ranked[:2] if whole.tip[p] >= SECOND * whole.tip[ranked[0]]]
    moves = [
        f"{spoken(place, machine)} by {plus_minus(*whole.range(place, _own(whole, place)), unit_of(place[1]))}"
        for place in shown
    ]
    if moves:
        usual = f", {_usual(_largest(whole, machine))}" if known and not coefficients else ""
        if not _determined(whole):
            usual = _undetermined(whole)
        elif sign := main.meaning_of_sign([a.value for a in whole.amounts]) if not any(other) else "":
            usual = f", {sign}"
        total = f", {total}," if (total := _in_all(whole, ranked[0])) else ""
        further = _further(whole, other, shown, machine)
        yield f"moves {' and '.join(moves)}{total} peak to peak over the rows{further}{usual}"


def _further(whole: Whole, other: Sequence[bool], shown: Sequence[tuple[str, Motion]], machine: Machine) -> str:
    """Motions that are not `shown`, and the terms of another form that refine the main effect's, in words."""
    places = [{p for p, rows in whole.motions.items() if whole.of(rows, ids).any()} for ids in whole.ids]
    aside = set[tuple[str, Motion]]().union(*(own for own in places if not own & places[0])) - {*shown}
    less = [spoken(p, machine) for p in sorted(aside, key=lambda place: -whole.tip[place])]
    terms = sum(differs and bool(own & places[0]) for differs, own in zip(other, places, strict=True))
    words = f", and {' and '.join(less)} less" if less else ""
    refining = f", with {terms} further term{'s' * (terms > 1)} that refine{'s' * (terms == 1)} its form"
    known = {root(d) for e, differs in zip(whole.effects, other, strict=True) if not differs for d in e.drivers}
    drivers = (d for e, differs in zip(whole.effects, other, strict=True) if differs for d in map(root, e.drivers))
    further = [channel(d) for d in dict.fromkeys(drivers) if d not in known]
    also = f" and depend{'s' * (terms == 1)} on {' and '.join(further)} as well" if further else ""
    if not terms:
        return words
    both = ""
    if shown and _own(whole, shown[0]) is not None:
        both = f" ({plus_minus(*whole.range(shown[0]), unit_of(shown[0][1]))} with {'them' if terms > 1 else 'it'})"
    return words + refining + also + both


def _in_all(whole: Whole, place: tuple[str, Motion], sure: bool = False) -> str:
    """How far the measuring frame was moved along all axes together, where it was along several; else empty.

    `sure`: without its standard uncertainty.
    """
    shift = whole.shift(place) if place[0] == FRAME else None
    return f"in all by {plus_minus(shift[0], 0.0 if sure else shift[1], 'mm')}" if shift else ""


def _own(whole: Whole, place: tuple[str, Motion]) -> list[str] | None:
    """Parameters of the name itself, where other forms move the same and the name has a size without them."""
    main = whole.effects[0]
    own = [i for effect, ids in zip(whole.effects, whole.ids, strict=True) if effect.effect == main.effect for i in ids]
    if main.empirical or len(own) == len(whole.every):
        return None
    return own if whole.of(whole.motions[place], own).any() else None


def _undetermined(whole: Whole) -> str:
    """That the data do not determine a size, and what they show of it."""
    shown = f"; beyond what the geometry could be as well they show {length(whole.seen_um)} rms of it"
    return ": the data do not determine this size" + (shown if whole.seen_um >= LEAST_SEEN_UM else "")


def _determined(whole: Whole) -> bool:
    """Whether the largest of its motions is known better than to its own size."""
    if not whole.tip:
        return True
    value, std = whole.range(max(whole.tip, key=lambda place: whole.tip[place]))
    if _steady(whole):
        value, std = whole.amounts[0].value, whole.amounts[0].std
    return std <= abs(value)


def _steady(whole: Whole) -> bool:
    """Whether it moves nothing from row to row."""
    return constant(whole.values @ whole.motions[place] for place in whole.tip)


def _coefficients(whole: Whole, machine: Machine) -> str:
    """A single physical parameter such as an expansion: at steady state, the sum over the lags of each sensor."""
    main = whole.effects[0]
    causes: dict[tuple[str, ...], dict[str, float]] = {}
    for effect, ids in zip(whole.effects, whole.ids, strict=True):
        causes.setdefault(effect.drivers, {}).update(dict.fromkeys(ids[:1], 1.0))
    sizes = _sizes(main, machine)
    units = {whole.units[i] for i in whole.every}
    single = all(len(ids) == 1 for ids in whole.ids) or units == {"1/(mm K)"}
    if len(units) != 1 or not single or units <= {"mm", "rad"} or not all(causes.values()):
        return ""
    (unit,), largest, said = units, 0.0, []
    for drivers, weights in causes.items():
        value, std = whole.total(weights)
        largest = max(largest, abs(value) / sizes[unit])
        of = f" of {channel(drivers[0])}" if len(causes) > 1 else ""
        said.append(_coefficient(value, std, unit, main, machine) + of)
    lags = " at steady state" if any(len(w) > 1 for w in causes.values()) else ""
    most = _coefficient(USUAL * sizes[unit], 0.0, unit, main, machine)
    sense = f" (positive: {positive})" if (positive := main.positive(machine)) else ""
    usual = f"{_usual(largest)} (up to {most})" if _determined(whole) else "which the data do not determine"
    return f"{' and '.join(said)}{lags}{sense}, {usual}"


def _sizes(effect: Effect, machine: Machine) -> dict[str, float]:
    """How large an effect's parameters can physically be (one standard deviation), by unit."""
    return {t.unit: t.size for t in effect.terms(lambda name: 1.0, machine)}


def _largest(whole: Whole, machine: Machine) -> float:
    """The largest of a finding's parameters in units of its physical size."""
    # a member may both shift and tilt: the main effect's own size where units are alike
    sizes = {unit: size for effect in reversed(whole.effects) for unit, size in _sizes(effect, machine).items()}
    return float(max(abs(v) / sizes[whole.units[i]] for i, v in zip(whole.every, whole.values.tolist(), strict=True)))


def _usual(ratio: float) -> str:
    word = "well within" if ratio <= USUAL / 2 else "within" if ratio <= USUAL else "larger than"
    return f"{word if ratio <= LARGE else 'far larger than'} what is usual"


def _coefficient(value: float, std: float, unit: str, effect: Effect, machine: Machine) -> str:
    """A parameter in its unit; a beam's curvature by its deflection at mid-travel."""
    joint = next((j for j in machine.joints if j.name == effect.where), None)
    if unit == "1/(mm K)" and joint is not None:
        arrow = (joint.travel[1] - joint.travel[0]) ** 2 / 8
        return f"{plus_minus(arrow * value, arrow * std, 'mm/K')} at mid-travel"
    return plus_minus(value, std, unit)


def _grows(effect: Effect) -> dict[str, object]:
    """What grows, whatever warms it."""
    return {k: v for k, v in effect.model_dump().items() if k not in effect.same_parameter()}


def plus_minus(value: float, std: float, unit: str) -> str:
    """A value with its standard uncertainty, in um, urad and the like, two digits of the uncertainty."""
    factor, word = printed(unit)
    word = word.replace("µ", "u")
    if not std:
        return f"{factor * value:.3g} {word}"
    places = decimals(factor * std)
    return f"{factor * value:.{places}f} +- {factor * std:.{places}f} {word}"


def unequal(effect: Effect, others: Sequence[Effect]) -> Iterator[Effect]:
    """Of other explanations, physics with another name."""
    return (o for o in others if o.effect != effect.effect and not o.empirical)


def next_measurement(effect: Effect, alternative: Effect | None, columns: Mapping[str, Array]) -> str:
    """The measurement to do; with an alternative that this data cannot distinguish, both by name.

    `columns`: the survey's channels by name; what they have already is not asked for.
    """
    own = effect.recommended(columns)
    if alternative is None:
        return f"measure {FIXED_TARGETS}" if effect.empirical and effect.drivers in ((CLOCK,), (ROW,)) else own
    other = alternative.recommended(columns)
    known = alternative.effect in effect.alike or effect.empirical or other == own
    how = own if known else f"{own}; {other}"
    return f"this data cannot tell {subject(effect)} from {subject(alternative)}: {how}"
