"""Physics that no list has a word for: products of drivers, square waves, odd drivers."""

from __future__ import annotations

import numpy as np

from tests.proof.hidden import Hidden, Rng, Situation, along, crosswise, motion, pick, reach
from tests.proof.kinematics import Array, Chain, Element, Motions


def _two(chain: Chain, rng: Rng) -> tuple[Element, Element]:
    joints = list(chain.prismatic) if len(chain.prismatic) > 1 else list(chain.joints[:3])
    one, two = (joints[k] for k in rng.permutation(len(joints))[:2])
    return one, two


def _cross(e: Element, rng: Rng) -> str:
    return f"d{'xyz'[int(rng.choice(crosswise(e)))]}"


def _idle(sit: Situation, name: str) -> Array:
    values = sit.now(sit.world.idle[name])
    out: Array = (values - sit.world.idle[name].mean()) / sit.world.idle[name].std()
    return out


def chequer(chain: Chain, rng: Rng) -> Hidden | None:
    """Fields of a chequer board in two joints."""
    one, two = _two(chain, rng)
    a, b, phase = int(rng.integers(2, 4)), int(rng.integers(2, 4)), rng.uniform(0, 6, 2)
    name = _cross(one, rng)

    def field(sit: Situation) -> Motions:
        x = np.sin(2 * np.pi * a * sit.share(one.name) / 2 + phase[0])
        y = np.sin(2 * np.pi * b * sit.share(two.name) / 2 + phase[1])
        return {one.name: motion(len(sit), **{name: np.sign(x) * np.sign(y)})}

    return Hidden("chequer", ("unnamed", "cross-axis-compliance"), (one.name, two.name), field)


def humidity(chain: Chain, rng: Rng) -> Hidden | None:
    """A wooden member swells: a motion that goes with the humidity."""
    e = pick(rng, chain.joints)
    assert e is not None
    name = _cross(e, rng)

    def field(sit: Situation) -> Motions:
        return {e.name: motion(len(sit), **{name: _idle(sit, "w_humidity")})}

    return Hidden("humidity", ("unnamed",), (e.name,), field)


def humid_scale(chain: Chain, rng: Rng) -> Hidden | None:
    """A scale of carbon fibre: length goes with humidity."""
    e = pick(rng, chain.prismatic)
    if e is None:
        return None

    def field(sit: Situation) -> Motions:
        return {e.name: along(e, (sit.share(e.name) - 0.2) * _idle(sit, "w_humidity"))}

    return Hidden("humid-scale", ("unnamed",), (e.name,), field)


def pressure_side(chain: Chain, rng: Rng) -> Hidden | None:
    """Air bearings: a reversal error that changes its sign with the pressure."""
    e = pick(rng, chain.prismatic or chain.joints)
    assert e is not None
    unit = 1.0 if e.kind == "prismatic" else 1 / reach(chain)

    def field(sit: Situation) -> Motions:
        return {e.name: along(e, unit * sit.path.dirs[e.name] * _idle(sit, "w_pressure"))}

    return Hidden("pressure-side", ("unnamed",), (e.name,), field)


def current_step(chain: Chain, rng: Rng) -> Hidden | None:
    """A magnet is switched on and off: a square wave in time that only the current knows."""
    e = pick(rng, chain.joints)
    assert e is not None
    name = _cross(e, rng)

    def field(sit: Situation) -> Motions:
        return {e.name: motion(len(sit), **{name: np.sign(_idle(sit, "w_current"))})}

    return Hidden("current-step", ("unnamed",), (e.name,), field)


def triple(chain: Chain, rng: Rng) -> Hidden | None:
    """A product of three joints."""
    joints = list(chain.prismatic) if len(chain.prismatic) > 2 else list(chain.joints[:3])
    one, two, three = (joints[k] for k in rng.permutation(len(joints))[:3])
    name, power = _cross(one, rng), rng.uniform(0.6, 1.6)

    def field(sit: Situation) -> Motions:
        u, v, w = (2 * sit.share(e.name) - 1 for e in (one, two, three))
        return {one.name: motion(len(sit), **{name: np.sign(u) * np.abs(u) ** power * v * w})}

    accept = ("unnamed", "cross-axis-compliance", "beam-torsion")
    return Hidden("triple", accept, (one.name, two.name, three.name), field)


def feed_nod(chain: Chain, rng: Rng) -> Hidden | None:
    """The head nods with the square of the feed, whichever way it comes."""
    last = chain.elements[-1]

    def field(sit: Situation) -> Motions:
        return {last.name: motion(len(sit), dz=(sit.path.feed / 6000.0) ** 2)}

    return Hidden("feed-nod", ("unnamed",), (last.name,), field)


def lubrication(chain: Chain, rng: Rng) -> Hidden | None:
    """Every quarter of an hour a pulse of oil lifts a carriage, which then sinks again."""
    e = pick(rng, chain.prismatic or chain.joints)
    assert e is not None
    name, every, decay = _cross(e, rng), rng.uniform(600, 1200), rng.uniform(0.25, 0.5)

    def field(sit: Situation) -> Motions:
        since = np.mod(sit.path.time + 100.0, every) / every
        return {e.name: motion(len(sit), **{name: np.exp(-since / decay)})}

    return Hidden("lubrication", ("unnamed",), (e.name,), field, period=every)


def beat(chain: Chain, rng: Rng) -> Hidden | None:
    """A wave whose pitch depends on the place of another joint."""
    one, two = _two(chain, rng)
    name, phase = _cross(one, rng), rng.uniform(0, 6)

    def field(sit: Situation) -> Motions:
        wave = np.sin(2 * np.pi * (1.3 + 1.6 * sit.share(two.name)) * sit.share(one.name) + phase)
        return {one.name: motion(len(sit), **{name: wave})}

    return Hidden("beat", ("unnamed", "cross-axis-compliance"), (one.name, two.name), field)


def cusp(chain: Chain, rng: Rng) -> Hidden | None:
    """A motion of one joint that has a cusp in the position of another."""
    one, two = _two(chain, rng)
    name, at = _cross(one, rng), rng.uniform(0.3, 0.7)

    def field(sit: Situation) -> Motions:
        bent = np.abs(sit.share(two.name) - at) ** 0.6 * np.sign(sit.share(one.name) - 0.5)
        return {one.name: motion(len(sit), **{name: bent})}

    return Hidden("cusp", ("unnamed", "cross-axis-compliance"), (one.name, two.name), field)
