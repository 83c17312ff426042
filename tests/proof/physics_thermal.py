"""What heat does: scales and screws grow, members move and tilt, beams bow. The world's own temperatures drive it."""

from __future__ import annotations

import numpy as np

from tests.proof.hidden import Hidden, Rng, Situation, along, crosswise, pick, reach
from tests.proof.kinematics import Array, Chain, Motions
from tests.proof.world import elongation, lagged


def scale_expansion(chain: Chain, rng: Rng) -> Hidden | None:
    """A scale follows the air late, a little more so near its held end."""
    e = pick(rng, chain.prismatic)
    if e is None:
        return None
    tau, anchor, uneven = rng.uniform(0.02, 0.12), float(rng.choice([0.0, 0.5, 1.0])), rng.uniform(0, 0.15)

    def field(sit: Situation) -> Motions:
        span = sit.world.time[-1]
        air = sit.now(lagged(sit.world.air - 20, tau * span))
        late = sit.now(lagged(sit.world.air - 20, 2 * tau * span))
        u = sit.share(e.name) - anchor
        return {e.name: along(e, 0.2 * u * (air * (1 - uneven) + late * uneven * (1 + 0.3 * u)))}

    return Hidden("scale-expansion", ("scale-expansion",), (e.name,), field, also=("warm-up",))


def screw_heat(chain: Chain, rng: Rng) -> Hidden | None:
    """A ball screw is heated by its motor: the heat equation along it, integrated from its bearing on."""
    e = pick(rng, chain.prismatic)
    if e is None:
        return None

    def field(sit: Situation) -> Motions:
        return {e.name: along(e, 0.2 * elongation(sit.world, sit.share(e.name), sit.path.time, 0.0))}

    return Hidden("screw-heat", ("scale-expansion", "warm-up"), (e.name,), field)


def warm_up(chain: Chain, rng: Rng) -> Hidden | None:
    e = pick(rng, chain.prismatic)
    if e is None:
        return None
    anchor, power = rng.uniform(-0.3, 0.3), rng.uniform(0.85, 1.15)

    def field(sit: Situation) -> Motions:
        u = sit.share(e.name) - anchor
        return {e.name: along(e, np.sign(u) * np.abs(u) ** power * sit.now(sit.world.hidden))}

    return Hidden("warm-up", ("warm-up",), (e.name,), field, also=("scale-expansion",))


def spindle_growth(chain: Chain, rng: Rng) -> Hidden | None:
    last, tool = chain.elements[-1].name, np.array(chain.tools[0])
    k = int(np.argmax(np.abs(tool)))
    power, side = rng.uniform(0.9, 1.1), rng.uniform(-0.15, 0.15)

    def field(sit: Situation) -> Motions:
        warm = np.clip(sit.now(sit.world.spindle), 0, None) ** power * 0.2
        out = np.zeros((len(sit), 6))
        out[:, k], out[:, (k + 1) % 3] = np.sign(tool[k]) * warm, side * warm
        return {last: out}

    accept = ("spindle-growth", "structure-drift")
    return Hidden("spindle-growth", accept, (last, "tool"), field, also=("tracker-drift", "warm-up"))


def _drift(sit: Situation, mix: float) -> Array:
    return (1 - mix) * sit.now(sit.world.mean) + 0.3 * mix * sit.now(lagged(sit.world.mean, 600.0))


def structure_drift(chain: Chain, rng: Rng) -> Hidden | None:
    """A member moves as the slab beside it warms."""
    e = pick(rng, [e for e in chain.elements if e.kind == "shape"])
    assert e is not None
    k, second, mix = int(rng.integers(3)), rng.uniform(-0.2, 0.2), rng.uniform(0, 0.6)

    def field(sit: Situation) -> Motions:
        warm, out = _drift(sit, mix) * 0.3, np.zeros((len(sit), 6))
        out[:, k], out[:, (k + 1) % 3] = warm, second * warm
        return {e.name: out}

    also = ("tracker-drift", "warm-up", "spindle-growth")
    return Hidden("structure-drift", ("structure-drift",), (e.name,), field, also=also)


def thermal_squareness(chain: Chain, rng: Rng) -> Hidden | None:
    """A member between two slides tilts as one of its sides warms more than the other."""
    slides = [k for k, e in enumerate(chain.elements) if e.kind == "prismatic"]
    if len(slides) < 2:
        return None
    at = int(rng.integers(len(slides) - 1))
    one, other = chain.elements[slides[at]], chain.elements[slides[at + 1]]
    if any(e.kind == "rotary" for e in chain.elements[slides[at] : slides[at + 1]]):
        return None
    shapes = [e for e in chain.elements[slides[at] : slides[at + 1]] if e.kind == "shape"]
    member, about = shapes[0], np.cross(one.axis, other.axis)
    lever, mix = reach(chain), rng.uniform(0.6, 1.0)

    def field(sit: Situation) -> Motions:
        warm = mix * sit.now(sit.world.gradient) + (1 - mix) * sit.now(lagged(sit.world.gradient, 900.0))
        out = np.zeros((len(sit), 6))
        out[:, 3:] = 0.3 * warm[:, None] * about / lever
        return {member.name: out}

    accept = ("thermal-squareness", "structure-drift")
    where = (member.name, one.name)
    return Hidden("thermal-squareness", accept, where, field, also=("tracker-drift", "warm-up"))


def thermal_bending(chain: Chain, rng: Rng) -> Hidden | None:
    """A beam warmer on top bows up, less near its clamped end; the carriage's angle follows almost."""
    e = pick(rng, chain.prismatic)
    if e is None:
        return None
    side = crosswise(e)
    k = 2 if 2 in side else int(rng.choice(side))
    clamp, follow = rng.uniform(-0.15, 0.15), rng.uniform(0.75, 1.05)

    def field(sit: Situation) -> Motions:
        u, warm = sit.share(e.name), sit.now(sit.world.gradient) * 0.3
        bow, slope = 4 * u * (1 - u) * (1 + clamp * (u - 0.5)), 4 * (1 - 2 * u) / e.length
        turn = np.cross(e.axis, np.eye(3)[k])
        out = np.zeros((len(sit), 6))
        out[:, k] = warm * bow
        out[:, 3:] = follow * (warm * slope)[:, None] * turn
        return {e.name: out}

    return Hidden("thermal-bending", ("thermal-bending",), (e.name,), field)
