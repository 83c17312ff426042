"""Discrepancy of a finding from its textbook form: further empirical terms of the same motion by the same cause."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, islice, product

import numpy as np

from errormodel.arrays import Array
from errormodel.channels import CLOCKS, root
from errormodel.conventions import MOTIONS
from errormodel.effects.base import Effect
from errormodel.effects.travel import legendre
from errormodel.effects.unnamed import Unnamed
from errormodel.machine import Joint
from identification.diagnosis.decisions.constants import DEPARTURES, LITTLE, MUCH
from identification.diagnosis.linear.linear_model import LinearModel
from identification.diagnosis.search.criteria import base_channels, moves
from identification.diagnosis.search.model import EffectModel
from identification.diagnosis.search.scoring import Step

PIECES = 10  # of each joint's range, of a surface; of a period
FORMS = ("linear", "square", "cubic")
OVERTONES = (1, 2, 3, 5)  # steps have the odd ones
SMOOTH = 8  # functions of one position
CHANGES = 4  # of them, by which the size of a wave changes along the travel
# what follows one of them, or a witness, is no form of what does not
DISTINCT = {"feed", "load", "point_x", "point_y", "point_z"}


def forms(linear: LinearModel, effect: Effect) -> Iterator[Effect]:
    """Empirical terms at the effect's place by its drivers (lagged too, where it is warmth), along its joint's travel.

    Of a wave without a name also what it may be instead of a sine; of a course in time none.
    """
    if is_course(effect):
        return
    if isinstance(effect, Unnamed) and effect.period and not effect.random:
        yield from _repeating(effect, effect.period)
    joint = next((j for j in linear.scene.moving if j.name == effect.where), None)
    for element, motion in sorted(moves(linear, effect)):
        for driver in _drivers(linear, effect):
            center, half = _range(linear, driver)
            if half <= 0 or not np.isfinite(half):
                continue
            common = {"element": element, "motion": motion, "driver": driver, "center": center, "half_range": half}
            for form in FORMS[: 1 if driver.startswith("dir_") else 3]:
                yield Unnamed.model_validate({**common, "form": form})
            if joint is not None and driver != joint.name:
                by_center, by_half = _range(linear, joint.name)
                both = {**common, "by": joint.name, "by_center": by_center, "by_half_range": by_half}
                rows = len(linear.scene.columns[joint.name])
                if any(j.name == driver for j in linear.scene.moving) and rows > (PIECES + 3) ** 2:
                    yield Unnamed.model_validate({**both, "pieces": PIECES})
                for form in FORMS:
                    yield Unnamed.model_validate({**both, "by_form": form})


def _repeating(wave: Unnamed, period: float) -> Iterator[Effect]:
    """What comes in pulses or steps as the wave does: any curve over its period; of two waves at once, overtones."""
    if not wave.by_period:
        yield wave.model_copy(update={"pieces": PIECES})
        return
    for n, m in product(OVERTONES, OVERTONES):
        if (n, m) != (1, 1):
            yield wave.model_copy(update={"period": period / n, "by_period": wave.by_period / m})


def discrepancy(linear: LinearModel, effect: Effect) -> tuple[float, float]:
    """Log Bayes factor and delta chi-squared of an effect's discrepancy from its textbook form.

    The discrepancy is a random effect over smooth functions of the drivers (M. C. Kennedy and A. O'Hagan, J. R. Stat.
    Soc. B 63 (2001) 425). Its standard deviation is a share of the effect's size, with the prior `DEPARTURES`.
    """
    if effect.random or effect.empirical:
        return 0.0, 0.0
    further = list(smooth_departures(linear, effect))
    if not further:
        return 0.0, 0.0
    own, values = linear.estimates([effect])
    columns = np.array(further)
    norms = np.linalg.norm(columns, axis=1)
    seen = norms > 0
    columns = columns[seen] / norms[seen, None] / np.sqrt(seen.sum())  # what no row shows takes nothing from the others
    random = linear.random_beside(effect, columns)
    size = float(np.linalg.norm(own.T @ values))
    if not len(random.values) or not size:
        return 0.0, 0.0
    evidence, part = max((random.evidence(part * size) - cost, part) for part, cost in DEPARTURES.items())
    if evidence <= 0:
        return 0.0, 0.0
    left = random.left((part * size) ** 2 / random.noise(part * size))
    return evidence, (random.square - float(left)) * linear.freedom / linear.square


def smooth_departures(linear: LinearModel, effect: Effect) -> Iterator[Array]:
    """Columns (N,) of smooth functions of the drivers, in the motions that the effect makes; of a wave, as a wave."""
    if effect.overtone(1) is not None:
        yield from _of_wave(linear, effect)
        return
    joints = [j for j in linear.scene.moving if j.name in map(root, effect.drivers)]
    shapes = [list(_smooth(linear, j)) for j in joints]
    series = [s for own in shapes for s in own]
    series += [a * b for one, other in combinations(shapes, 2) for a in one[:3] for b in other[:3]]
    for element, motion in sorted(moves(linear, effect)):
        for s in series:
            yield linear.levers[element][MOTIONS.index(motion)] * s
    if len(joints) < len(set(map(root, effect.drivers))):
        for form in forms(linear, effect):
            if isinstance(form, Unnamed) and "cubic" in (form.form, form.by_form):
                yield from linear.columns(form)[0][:, : len(linear.index)]


def _of_wave(linear: LinearModel, wave: Effect) -> Iterator[Array]:
    """A wave that is no sine (overtones), and one whose size and phase change along the travel."""
    size = len(linear.index)
    for number in OVERTONES:
        further = wave.overtone(number)
        columns = linear.columns(further or wave)[0][:, :size]
        yield from (c for c in columns if number > 1)
        for joint in (j for j in linear.scene.moving if j.name == wave.where):
            yield from (c * s for c in columns for s in islice(_smooth(linear, joint), CHANGES))


def _smooth(linear: LinearModel, joint: Joint) -> Iterator[Array]:
    """Series (N,) of a joint's position: Legendre polynomials, or harmonics of a turn."""
    q = linear.channel(joint.name)
    if joint.type == "rotary":
        for k in range(1, 1 + SMOOTH // 2):
            yield from (np.sin(k * q), np.cos(k * q))
    else:
        low, high = linear.scene.span(joint)
        for k in range(1, 1 + SMOOTH):
            yield legendre(k, (2 * q - low - high) / (high - low))


def _drivers(linear: LinearModel, effect: Effect) -> list[str]:
    names = list(dict.fromkeys(map(root, effect.drivers)))
    if any(n.startswith("T_") or n == "time" for n in names):
        warm = [n for n in names if n.startswith("T_")] or list(linear.scene.sensors)
        span = linear.scene.worked
        names = [*names, *warm, *(["time"] if span else [])]
        names += [f"lag({n},{span / part:.4g})" for n in warm if span for part in (32, 12, 5)]
    return list(dict.fromkeys(names))


def _range(linear: LinearModel, name: str) -> tuple[float, float]:
    """Middle and half range of a channel as the survey has it, to four digits: they go into the model's file."""
    values = linear.channel(name)
    low, high = float(values.min()), float(values.max())
    return float(f"{(low + high) / 2:.4g}"), float(f"{(high - low) / 2:.4g}")


def refined(model: EffectModel, step: Step) -> int | None:
    """Number of the finding that an effect refines, or None."""
    return refinement_of(model, step)[0]


def refinement_of(model: EffectModel, step: Step) -> tuple[int | None, str]:
    """Number of the finding that an effect refines, or None, and the name of the rule that says so.

    It has the same motion at the same place by the same driver: what a wrong lag or exponent leaves over.
    """
    linear = model.start
    for k, earlier in enumerate(model.steps):
        if earlier.parent is not None:
            continue
        one, other = earlier.effect, step.effect
        if one.random and not (one.empirical or other.empirical) and other.family != one.family:
            continue  # a free curve of the joint's position leaves nothing over: this is another effect
        if distinct(one, other) or (is_course(one) and not by_clock_alone(other)):
            continue
        there = one.where == other.where and base_channels(one) & base_channels(other)
        if there and (one.effect == other.effect or moves(linear, one) & moves(linear, other)):
            if apart(one, other) and not is_departure(model, k, other):
                continue
            return k, "same-motion-and-driver"
        if _is_surface(one) and base_channels(other) <= base_channels(one) and _motions(linear, one, other):
            return k, "remainder-of-surface"  # the remainder of a product follows either of its two drivers
    return None, ""


def is_course(effect: Effect) -> bool:
    """Whether an effect is a curve of one motion in time, which leaves nothing over that another channel drives."""
    curve = isinstance(effect, Unnamed) and effect.pieces is not None and effect.period is None
    return curve and by_clock_alone(effect)


def by_clock_alone(effect: Effect) -> bool:
    """Whether nothing but time, or the order of the rows, drives an effect."""
    return {*effect.drivers} <= {*CLOCKS}


def distinct(one: Effect, other: Effect) -> bool:
    """Whether a driver of only one of two effects makes them distinguishable (`DISTINCT`, or a witness)."""
    only = base_channels(other) - base_channels(one)
    if not other.empirical:
        only |= base_channels(one) - base_channels(other)
    return any(name in DISTINCT or name.startswith("w_") for name in only)


def could_refine(model: EffectModel, steps: Sequence[Step], best: Step) -> list[Step]:
    """Refinements of findings with nearly the best evidence, where the best may be their discrepancy as well."""
    could = [(s, refined(model, s)) for s in steps if s.evidence > (1 - MUCH) * best.evidence]
    of_its_causes = [(s, k) for s, k in could if k is not None and not other_causes(model, k, s.effect)]
    return [s for s, k in of_its_causes if is_departure(model, k, best.effect)]


def further_causes(one: Effect, other: Effect) -> frozenset[str]:
    """Channels that drive another effect, and neither drive the one nor are its joint."""
    return base_channels(other) - base_channels(one) - {one.where}


def other_causes(model: EffectModel, number: int, effect: Effect) -> frozenset[str]:
    """The same of a finding but for positions of joints: what drives a finding may do so less at one end of another."""
    joints = {joint.name for joint in model.start.scene.moving}
    return further_causes(model.steps[number].effect, effect) - joints


def left_over(model: EffectModel, step: Step) -> int | None:
    """The finding of whose place and drivers a further effect is, if it explains less than `LITTLE` of it."""
    for k, earlier in enumerate(model.steps):
        one, other = earlier.effect, step.effect
        near = one.where == other.where and not further_causes(one, other)
        if earlier.parent is None and near and is_departure(model, k, other, LITTLE):
            return k
    return None


def is_departure(model: EffectModel, number: int, effect: Effect, share: float = MUCH) -> bool:
    """Whether a further effect explains less than `share` of a finding: it may be the finding's discrepancy."""
    group = [s for k, s in enumerate(model.steps) if number in (k, s.parent)]
    explained = model.without(group).square - model.linear.square
    return model.linear.square - model.linear.square_with(effect) < share * explained


def _is_surface(effect: Effect) -> bool:
    """Whether an effect is a form over two channels."""
    return effect.empirical and len(base_channels(effect)) > 1


def _motions(linear: LinearModel, one: Effect, other: Effect) -> set[str]:
    """Motions that both make, at whatever elements."""
    return {m for _, m in moves(linear, one)} & {m for _, m in moves(linear, other)}


def apart(one: Effect, other: Effect) -> bool:
    """Whether two effects at a place have different signatures: other shape parameters, a clock against a sensor."""
    named = not (one.empirical or other.empirical) and one.effect != other.effect
    by_clock = ("time" in one.drivers) != ("time" in other.drivers)
    return named and (type(one).shape != type(other).shape or by_clock or not (one.flexible or other.flexible))
