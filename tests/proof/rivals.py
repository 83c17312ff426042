"""Textbook forms of effects, written again without the toolkit: what a name could mean, for judging look-alikes.

Each yields places, and blocks of columns (n, 3, k) that one finding of that name there could fit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations

import numpy as np

from tests.proof.hidden import along, crosswise
from tests.proof.kinematics import Array, Element
from tests.proof.physics_drives import plays
from tests.proof.projection import Bench
from tests.proof.world import STEP

Blocks = Iterator[tuple[str, Array]]
WAVES = np.geomspace(1.5, 24, 60)  # a travel


def _settling(bench: Bench) -> list[Array]:
    t = bench.sit.path.time / max(float(bench.sit.path.time[-1]), 1.0)
    return [t, *(1 - np.exp(-t / tau) for tau in (0.03, 0.05, 0.08, 0.13, 0.2, 0.35, 0.6, 1.2))]


def _temperatures(bench: Bench) -> list[Array]:
    """All sensors, as they are and behind lags."""
    out = []
    world, span = bench.sit.world, float(bench.sit.path.time[-1])
    for values in world.sensors.values():
        for tau in (0.0, 0.03, 0.06, 0.12, 0.25, 0.5):
            state, late = float(values[0]), np.empty_like(values)
            share = STEP / (tau * span + STEP)
            for k, value in enumerate(values):
                state += share * (value - state)
                late[k] = state
            out.append(bench.sit.now(late) - 20)
    return out


def _moved(bench: Bench, element: str, motion: Array) -> Array:
    out: Array = np.einsum("nij,nj->ni", bench.levers[element], motion)[:, :, None]
    return out


def _each(bench: Bench, element: str, scalars: list[Array], motions: range = range(6)) -> Blocks:
    """One motion of an element by all the scalars together."""
    for k in motions:
        lever = bench.levers[element][:, :, k]
        yield element, np.stack([lever * s[:, None] for s in scalars], axis=2)


def _structure(bench: Bench) -> list[str]:
    return ["frame", *(e.name for e in bench.sit.chain.elements)]


def structure_drift(bench: Bench) -> Blocks:
    for scalar in _temperatures(bench):
        for name in _structure(bench)[1:]:
            yield from _each(bench, name, [scalar])


def thermal_squareness(bench: Bench) -> Blocks:
    for scalar in _temperatures(bench):
        for name in _structure(bench)[1:]:
            yield from _each(bench, name, [scalar], range(3, 6))


def tracker_drift(bench: Bench) -> Blocks:
    for scalar in _settling(bench):
        yield "frame", bench.levers["frame"] * scalar[:, None, None]


def station_shift(bench: Bench) -> Blocks:
    for at in np.linspace(0.03, 0.97, 48):
        after = bench.sit.path.time >= at * bench.sit.path.time[-1]
        yield "frame", bench.levers["frame"] * after[:, None, None]


def warm_up(bench: Bench) -> Blocks:
    for scalar in _settling(bench):
        for e in bench.sit.chain.prismatic:
            grown = [along(e, scalar), along(e, scalar * bench.sit.share(e.name))]
            yield e.name, np.concatenate([_moved(bench, e.name, g) for g in grown], axis=2)
        for name in _structure(bench)[1:]:
            yield from _each(bench, name, [scalar])


def scale_expansion(bench: Bench) -> Blocks:
    for scalar in _temperatures(bench):
        for e in bench.sit.chain.prismatic:
            for anchor in (0.0, 0.5, 1.0):
                yield e.name, _moved(bench, e.name, along(e, scalar * (bench.sit.share(e.name) - anchor)))


def thermal_bending(bench: Bench) -> Blocks:
    warm = _temperatures(bench)
    behind = len(warm) // len(bench.sit.world.sensors)  # as many lags
    for e in bench.sit.chain.prismatic:
        u = bench.sit.share(e.name)
        for one, other in combinations(range(len(warm)), 2):
            if one % behind == other % behind:
                gap = warm[one] - warm[other]
                for k in crosswise(e):
                    yield e.name, _bent(bench, e, k, gap * u * (1 - u), gap * (1 - 2 * u))


def spindle_growth(bench: Bench) -> Blocks:
    for scalar in _temperatures(bench):
        yield from _each(bench, bench.sit.chain.elements[-1].name, [scalar], range(3))


def backlash(bench: Bench) -> Blocks:
    for e in bench.sit.chain.joints:
        yield e.name, _moved(bench, e.name, along(e, bench.sit.path.dirs[e.name]))


def lost_motion(bench: Bench) -> Blocks:
    for e in bench.sit.chain.joints:
        side = bench.sit.path.dirs[e.name]
        both = [along(e, side), along(e, side * bench.sit.share(e.name))]
        yield e.name, np.concatenate([_moved(bench, e.name, b) for b in both], axis=2)


def hysteresis(bench: Bench) -> Blocks:
    for e in bench.sit.chain.joints:
        q, moves = bench.sit.path.q[e.name], bench.sit.path.moves[e.name]
        for width in np.geomspace(0.005, 0.3, 10) * e.length:
            yield e.name, _moved(bench, e.name, along(e, plays(q, moves, np.array([width]), np.ones(1))))


def higher_order_geometry(bench: Bench) -> Blocks:
    """Polynomials in one motion, in a shift and an angle, and in a bend: a shift with its slope."""
    for e in bench.sit.chain.prismatic:
        u = 2 * bench.sit.share(e.name) - 1
        for order in (3, 4, 5, 7):
            powers = [u**k for k in range(1, order + 1)]
            slopes = [k * u ** (k - 1) for k in range(1, order + 1)]
            yield from _each(bench, e.name, powers)
            for k, m in ((k, m) for k in range(3) for m in range(3, 6)):
                blocks = [bench.levers[e.name][:, :, [k, m]] * p[:, None, None] for p in powers]
                yield e.name, np.concatenate(blocks, axis=2)
            for k in crosswise(e):
                bend = np.cross(e.axis, np.eye(3)[k])
                blocks = [
                    bench.levers[e.name][:, :, k] * p[:, None]
                    + np.einsum("nij,j->ni", bench.levers[e.name][:, :, 3:], bend) * (s * 2 / e.length)[:, None]
                    for p, s in zip(powers, slopes, strict=True)
                ]
                yield e.name, np.stack(blocks, axis=2)
    for e in bench.sit.chain.rotary:
        q = bench.sit.path.q[e.name]
        yield from _each(bench, e.name, [f(k * q) for k in (1, 2, 3) for f in (np.sin, np.cos)])


def cross_axis_compliance(bench: Bench) -> Blocks:
    for other in bench.sit.chain.joints:
        v = 2 * bench.sit.share(other.name) - 1
        for e in bench.sit.chain.joints:
            if e is not other:
                yield from _each(bench, e.name, [v, v**2, v**3])


def column_bending(bench: Bench) -> Blocks:
    for other in bench.sit.chain.prismatic:
        v = 2 * bench.sit.share(other.name) - 1
        for e in bench.sit.chain.prismatic:
            if e is not other:
                yield from _each(bench, e.name, [v], range(3, 6))
                for k in crosswise(e):
                    for h in (bench.sit.share(e.name), 1 - bench.sit.share(e.name)):
                        turn = np.eye(3)[k]
                        motion = np.zeros((len(v), 6))
                        motion[:, 3:] = (v * h)[:, None] * turn
                        motion[:, :3] = (v * h**2 / 2 * e.length)[:, None] * np.cross(turn, e.axis)
                        yield e.name, _moved(bench, e.name, motion)


def ground_compliance(bench: Bench) -> Blocks:
    for e in bench.sit.chain.prismatic:
        v = 2 * bench.sit.share(e.name) - 1
        for name in _structure(bench)[:2]:
            yield from _each(bench, name, [v, v**2, v**3], range(3, 6))


def beam_torsion(bench: Bench) -> Blocks:
    for e, load in _crossing(bench):
        give = 4 * bench.sit.share(e.name) * (1 - bench.sit.share(e.name))
        roll = [along(e, give), along(e, give * bench.sit.share(load.name))]
        turned = [np.roll(r, 3, axis=1) for r in roll]
        yield e.name, np.concatenate([_moved(bench, e.name, t) for t in turned], axis=2)


def _crossing(bench: Bench) -> list[tuple[Element, Element]]:
    slides = bench.sit.chain.prismatic
    return [(a, b) for a in slides for b in slides if a is not b]


def gantry_racking(bench: Bench) -> Blocks:
    for e, across in _crossing(bench):
        yield from _each(bench, e.name, [2 * bench.sit.share(across.name) - 1], range(3, 6))


def telescoping_compliance(bench: Bench) -> Blocks:
    for e in bench.sit.chain.prismatic:
        for u in (bench.sit.share(e.name), 1 - bench.sit.share(e.name)):
            for ratio in (1.1, 1.3, 1.8):
                give = 1 / (ratio - u) ** 2
                yield from _each(bench, e.name, [give, give * u], range(3, 6))


def ram_sag(bench: Bench) -> Blocks:
    for e in bench.sit.chain.prismatic:
        for u in (bench.sit.share(e.name), 1 - bench.sit.share(e.name)):
            for k in crosswise(e):
                for power in (2.0, 2.5, 3.0, 3.5, 4.0):
                    yield e.name, _bent(bench, e, k, u**power, u ** (power - 1))


def beam_sag(bench: Bench) -> Blocks:
    for e in bench.sit.chain.prismatic:
        u = bench.sit.share(e.name)
        arch = 4 * u * (1 - u)
        for k in crosswise(e):
            for power in (1.2, 2.0, 3.0):
                yield e.name, _bent(bench, e, k, arch**power, arch ** (power - 1) * (1 - 2 * u))


def _bent(bench: Bench, e: Element, k: int, shift: Array, slope: Array) -> Array:
    """A deflection across the axis and, free of it, an angle: two columns."""
    turn = np.cross(e.axis, np.eye(3)[k])
    parts = [np.zeros((len(shift), 6)), np.zeros((len(shift), 6))]
    parts[0][:, k] = shift
    parts[1][:, 3:] = slope[:, None] * turn / e.length
    return np.concatenate([_moved(bench, e.name, p) for p in parts], axis=2)


def contact_knee(bench: Bench) -> Blocks:
    for e in bench.sit.chain.prismatic:
        for at in np.linspace(0.1, 0.9, 17):
            yield from _each(bench, e.name, [np.clip(bench.sit.share(e.name) - at, 0, None)])


def local_defect(bench: Bench) -> Blocks:
    for e in bench.sit.chain.prismatic:
        for at in np.linspace(0.05, 0.95, 31):
            for width in (0.02, 0.05, 0.1):
                yield from _each(bench, e.name, [np.exp(-(((bench.sit.share(e.name) - at) / width) ** 2))], range(3))


def waves(bench: Bench) -> Blocks:
    for e in bench.sit.chain.prismatic:
        for times in WAVES:
            x = 2 * np.pi * times * bench.sit.share(e.name)
            yield from _each(bench, e.name, [np.sin(x), np.cos(x)])


FORMS: dict[str, Callable[[Bench], Blocks]] = {
    "structure-drift": structure_drift,
    "thermal-squareness": thermal_squareness,
    "tracker-drift": tracker_drift,
    "station-shift": station_shift,
    "warm-up": warm_up,
    "scale-expansion": scale_expansion,
    "spindle-growth": spindle_growth,
    "thermal-bending": thermal_bending,
    "backlash": backlash,
    "lost-motion": lost_motion,
    "hysteresis": hysteresis,
    "higher-order-geometry": higher_order_geometry,
    "cross-axis-compliance": cross_axis_compliance,
    "column-bending": column_bending,
    "ground-compliance": ground_compliance,
    "beam-torsion": beam_torsion,
    "gantry-racking": gantry_racking,
    "telescoping-compliance": telescoping_compliance,
    "ram-sag": ram_sag,
    "beam-sag": beam_sag,
    "contact-knee": contact_knee,
    "local-defect": local_defect,
    "rail-waviness": waves,
    "pitch-cyclic": waves,
}
