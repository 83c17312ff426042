"""Drives, friction, gears, rails, scales and tables; a controller that is late."""

from __future__ import annotations

import numpy as np

from tests.proof.hidden import Hidden, Rng, Situation, along, crosswise, motion, pick, reach
from tests.proof.kinematics import Array, Chain, Element, Motions

TURNING = ("random", "rows", "lines", "large", "poor")


def _unit(chain: Chain, e: Element) -> float:
    """From mm at the tool to the joint's own unit."""
    return 1.0 if e.kind == "prismatic" else 1.0 / reach(chain)


def backlash(chain: Chain, rng: Rng) -> Hidden | None:
    e = pick(rng, chain.joints)
    assert e is not None
    wave, phase, unit = rng.uniform(0, 0.06), rng.uniform(0, 6), _unit(chain, e)

    def field(sit: Situation) -> Motions:
        gap = 0.5 * (1 + wave * np.sin(2 * np.pi * sit.share(e.name) + phase))
        return {e.name: along(e, gap * sit.path.dirs[e.name] * unit)}

    needs = ("random", "rows", "lines", "grid", "grid2", "levels", "large")
    return Hidden("backlash", ("backlash",), (e.name,), field, also=("hysteresis",), factor=unit, needs=needs)


def lost_motion(chain: Chain, rng: Rng) -> Hidden | None:
    e = pick(rng, chain.prismatic or chain.joints)
    assert e is not None
    rest, power, unit = rng.uniform(0.0, 0.2), rng.uniform(0.9, 1.5), _unit(chain, e)

    def field(sit: Situation) -> Motions:
        gap = rest + (1 - rest) * sit.share(e.name) ** power
        return {e.name: along(e, 0.5 * gap * sit.path.dirs[e.name] * unit)}

    needs = ("random", "rows", "lines", "grid2", "levels")
    return Hidden("lost-motion", ("lost-motion", "hysteresis"), (e.name,), field, also=("backlash",), needs=needs)


def plays(q: Array, moves: Array, widths: Array, weights: Array) -> Array:
    """Friction elements in parallel, each sticking until its spring has stretched by its width: sum of their forces.

    Prandtl's model, run through the real path from before the first row; forces are -1 to 1 of all that slips.
    """
    stretch = np.zeros(len(widths))
    out = np.empty(len(q))
    track = np.concatenate([[q[0] - moves[0]], q])
    for k in range(len(q)):
        stretch = np.clip(stretch + track[k + 1] - track[k], -widths, widths)
        out[k] = weights @ (stretch / widths)
    return out


def presliding(q: Array, moves: Array, width: float, power: float, steps: int = 24) -> Array:
    """Bouc-Wen friction ``dz/dx = (1 - |z|^p (0.6 sign(z dx) + 0.4)) / width`` integrated along the real path."""
    z, out = 0.0, np.empty(len(q))
    track = np.concatenate([[q[0] - moves[0]], q])
    for k in range(len(q)):
        way = track[k + 1] - track[k]
        n = max(1, min(int(steps * abs(way) / width), 40 * steps))
        dx = way / n
        if abs(dx) > width / 4:  # so long a move ends in full slip
            z, n = np.sign(way), 0
        for _ in range(n):
            z += dx / width * (1 - abs(z) ** power * (0.6 * np.sign(z * dx) + 0.4))
        z = float(np.clip(z, -1, 1))
        out[k] = z
    return out


def hysteresis(chain: Chain, rng: Rng) -> Hidden | None:
    e = pick(rng, chain.prismatic or chain.joints)
    assert e is not None
    width, smooth, unit = rng.uniform(0.03, 0.12) * e.length, bool(rng.integers(2)), _unit(chain, e)
    widths, weights = width * np.array([0.3, 0.7, 1.2, 1.8]), np.array([0.15, 0.35, 0.35, 0.15])
    power = rng.uniform(1.2, 2.5)

    def field(sit: Situation) -> Motions:
        q, moves = sit.path.q[e.name], sit.path.moves[e.name]
        force = presliding(q, moves, width, power) if smooth else plays(q, moves, widths, weights)
        return {e.name: along(e, 0.5 * force * unit)}

    return Hidden("hysteresis", ("hysteresis",), (e.name,), field, also=("backlash", "lost-motion"), needs=("wander",))


def tooth(x: Array, second: float, third: float, phase: float) -> Array:
    """A wave of period 2 pi that is no pure sine."""
    out: Array = np.sin(x) + second * np.sin(2 * x + phase) + third * np.sin(3 * x + 2 * phase)
    return out


def pitch_cyclic(chain: Chain, rng: Rng) -> Hidden | None:
    e = pick(rng, chain.prismatic)
    if e is None:
        return None
    pitch = float(rng.choice([5.0, 8.0, 10.0, 12.0, 16.0, 20.0]))
    second, phase, wear = rng.uniform(0, 0.3), rng.uniform(0, 6), rng.uniform(-0.35, 0.35)

    def field(sit: Situation) -> Motions:
        wave = tooth(2 * np.pi * sit.path.q[e.name] / pitch + phase, second, 0.08, phase)
        return {e.name: along(e, wave * (1 + wear * (2 * sit.share(e.name) - 1)))}

    needs = ("random", "rows", "lines", "large")
    return Hidden("pitch-cyclic", ("pitch-cyclic",), (e.name,), field, period=pitch, needs=needs)


def rail_waviness(chain: Chain, rng: Rng) -> Hidden | None:
    e = pick(rng, chain.prismatic)
    if e is None:
        return None
    length, phase, sharp = e.length / rng.uniform(3.5, 9.0), rng.uniform(0, 6), rng.uniform(0.3, 0.9)
    k, angle, wear = int(rng.choice(crosswise(e))), bool(rng.integers(2)), rng.uniform(-0.3, 0.3)

    def field(sit: Situation) -> Motions:
        wave = np.arcsin(sharp * np.sin(2 * np.pi * sit.path.q[e.name] / length + phase)) / np.arcsin(sharp)
        wave = wave * (1 + wear * (2 * sit.share(e.name) - 1))
        name = f"e{'abc'[k]}" if angle else f"d{'xyz'[k]}"
        return {e.name: motion(len(sit), **{name: wave / (reach(chain) if angle else 1.0)})}

    also = ("higher-order-geometry",)
    needs = ("random", "rows", "lines", "large")
    return Hidden("rail-waviness", ("rail-waviness",), (e.name,), field, also=also, period=length, needs=needs)


def eccentricity(chain: Chain, rng: Rng) -> Hidden | None:
    turning = [e for e in chain.rotary if e.length > np.pi]
    e = pick(rng, turning)
    if e is None:
        return None
    times = 2 if e.model[0] == "harmonic" else 1
    phase, other, lever = rng.uniform(0, 6), rng.uniform(0, 0.2), reach(chain)

    def field(sit: Situation) -> Motions:
        q = sit.path.q[e.name]
        return {e.name: along(e, (np.sin(times * q + phase) + other * np.sin((times + 1) * q)) / lever)}

    also = ("higher-order-geometry",)
    accept = ("eccentricity",)
    return Hidden("eccentricity", accept, (e.name,), field, also=also, period=2 * np.pi / times, needs=TURNING)


def wobble(chain: Chain, rng: Rng) -> Hidden | None:
    e = pick(rng, [e for e in chain.rotary if e.length > 1.5 * np.pi])
    if e is None:
        return None
    times = 2 if e.model[0] == "harmonic" else 1
    phase, other, lever = rng.uniform(0, 6), rng.uniform(0.5, 1.1), reach(chain)
    one, two = crosswise(e)

    def field(sit: Situation) -> Motions:
        q = times * sit.path.q[e.name]
        out = np.zeros((len(sit), 6))
        out[:, 3 + one], out[:, 3 + two] = np.sin(q + phase) / lever, other * np.cos(q + 0.8 * phase) / lever
        return {e.name: out}

    also = ("higher-order-geometry",)
    return Hidden("wobble", ("wobble",), (e.name,), field, also=also, period=2 * np.pi / times, needs=TURNING)


def gear_cyclic(chain: Chain, rng: Rng) -> Hidden | None:
    e = pick(rng, chain.rotary)
    if e is None:
        return None
    teeth, phase, lever = int(rng.integers(18, 110)), rng.uniform(0, 6), reach(chain)
    second, run_out = rng.uniform(0.1, 0.35), rng.uniform(0.1, 0.35)

    def field(sit: Situation) -> Motions:
        q = sit.path.q[e.name]
        wave = tooth(teeth * q + phase, second, 0.1, phase) * (1 + run_out * np.sin(q + phase))
        return {e.name: along(e, wave / lever)}

    needs = ("random", "rows", "large")
    return Hidden("gear-cyclic", ("gear-cyclic",), (e.name,), field, period=2 * np.pi / teeth, needs=needs)


def servo_lag(chain: Chain, rng: Rng) -> Hidden | None:
    """Behind the command by a little less than in proportion to the feed."""
    e = pick(rng, chain.prismatic)
    if e is None:
        return None
    power = rng.uniform(0.85, 1.0)

    def field(sit: Situation) -> Motions:
        return {e.name: along(e, -sit.path.dirs[e.name] * (sit.path.feed / 6000.0) ** power)}

    return Hidden("servo-lag", ("servo-lag",), (e.name,), field, needs=("random", "rows", "large"))


def compensation_active(chain: Chain, rng: Rng) -> Hidden | None:
    e = pick(rng, chain.prismatic)
    if e is None:
        return None
    points = int(rng.integers(6, 10))
    table = rng.normal(0, 1, points)
    table[[0, -1]] = 0.0

    def field(sit: Situation) -> Motions:
        return {e.name: along(e, np.interp(sit.share(e.name), np.linspace(0, 1, points), table))}

    also = ("higher-order-geometry", "local-defect", "pitch-cyclic")
    needs = ("random", "rows")
    return Hidden("compensation-active", ("compensation-active",), (e.name,), field, also=also, needs=needs)


def higher_order_geometry(chain: Chain, rng: Rng) -> Hidden | None:
    """A guide that is bent otherwise than the model's order allows: two broad dents and a root."""
    e = pick(rng, chain.prismatic)
    if e is None:
        return None
    k, angle = int(rng.choice(crosswise(e))), bool(rng.integers(2))
    a, b, mix = rng.uniform(0.15, 0.4), rng.uniform(0.6, 0.85), rng.uniform(-1, 1)

    def field(sit: Situation) -> Motions:
        u = sit.share(e.name)
        bent = np.exp(-(((u - a) / 0.25) ** 2)) - 0.8 * np.exp(-(((u - b) / 0.22) ** 2)) + 0.5 * mix * u**3.5
        name = f"e{'abc'[k]}" if angle else f"d{'xyz'[k]}"
        return {e.name: motion(len(sit), **{name: bent / (reach(chain) if angle else 1.0)})}

    also = ("rail-waviness", "beam-sag", "ram-sag", "telescoping-compliance", "contact-knee")
    return Hidden("higher-order-geometry", ("higher-order-geometry",), (e.name,), field, also=also)


def local_defect(chain: Chain, rng: Rng) -> Hidden | None:
    """A dent in a rail, steeper on one side."""
    e = pick(rng, chain.prismatic)
    if e is None:
        return None
    k, at, width = int(rng.choice(crosswise(e))), rng.uniform(0.2, 0.8), rng.uniform(0.02, 0.06)

    def field(sit: Situation) -> Motions:
        x = (sit.share(e.name) - at) / width
        return {e.name: motion(len(sit), **{f"d{'xyz'[k]}": np.exp(-(np.abs(x / np.where(x > 0, 1.4, 0.8)) ** 2.4))})}

    needs = ("random", "rows", "large", "wander")
    return Hidden("local-defect", ("local-defect",), (e.name,), field, also=("contact-knee",), needs=needs)


def contact_knee(chain: Chain, rng: Rng) -> Hidden | None:
    """A cover runs against a stop: nothing up to a place, then more and more, with a rounded corner."""
    e = pick(rng, chain.prismatic)
    if e is None:
        return None
    k, at, corner, angle = int(rng.choice(crosswise(e))), rng.uniform(0.45, 0.75), 0.02, bool(rng.integers(2))
    power = rng.uniform(0.95, 1.15)

    def field(sit: Situation) -> Motions:
        x = sit.share(e.name) - at
        beyond = (corner * np.logaddexp(0, x / corner) / (1 - at)) ** power
        name = f"e{'abc'[k]}" if angle else f"d{'xyz'[k]}"
        return {e.name: motion(len(sit), **{name: beyond / (reach(chain) if angle else 1.0)})}

    also = ("higher-order-geometry", "telescoping-compliance", "ram-sag", "rail-waviness")
    return Hidden("contact-knee", ("contact-knee",), (e.name,), field, also=also, needs=("random", "rows", "large"))


def one_way_backlash(chain: Chain, rng: Rng) -> Hidden | None:
    """Of the slide that never turns round in such a survey."""
    e = (chain.prismatic or chain.joints)[0]

    def field(sit: Situation) -> Motions:
        return {e.name: along(e, 0.5 * sit.path.dirs[e.name] * _unit(chain, e))}

    return Hidden("backlash", ("backlash",), (e.name,), field)
