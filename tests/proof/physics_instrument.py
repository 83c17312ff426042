"""Instruments: a tracker that settles and tilts, is bumped, looks through warm air; targets and clocks that are off."""

from __future__ import annotations

import numpy as np

from tests.proof.hidden import Hidden, Rng, Situation, along, motion, reach
from tests.proof.kinematics import Array, Chain, Motions, rotations
from tests.proof.world import lagged


def _stand(sit: Situation, shift: Array, tilt: Array) -> Motions:
    """Motion of the measuring frame when the station moves and tilts about where it stands."""
    moved = sit.station - np.einsum("nij,j->ni", rotations(tilt), sit.station)
    return {"frame": np.hstack([shift + moved, tilt])}


def tracker_drift(chain: Chain, rng: Rng) -> Hidden | None:
    """Settling after power-on, two time constants, six directions, and a slow wandering of a tenth of it."""
    ways, tilts, fast = rng.normal(0, 1, 3), rng.normal(0, 0.7, 3), rng.uniform(0.06, 0.35)
    size, phase = reach(chain), rng.uniform(0, 6, 2)

    def field(sit: Situation) -> Motions:
        t = sit.path.time / sit.world.time[-1]
        one, two = 1 - np.exp(-t / fast), 1 - np.exp(-t / (3 * fast))
        restless = 0.05 * (np.sin(9 * t + phase[0]) + np.sin(23 * t + phase[1]))
        grown, late = one + restless, 0.6 * one + 0.4 * two
        return _stand(sit, grown[:, None] * ways, late[:, None] * tilts / size)

    return Hidden("tracker-drift", ("tracker-drift",), ("frame", "instrument"), field, also=("structure-drift",))


def station_shift(chain: Chain, rng: Rng) -> Hidden | None:
    """Somebody walks into the tripod: six constants from then on, which creep back a little."""
    ways, tilts, when = rng.normal(0, 1, 3), rng.normal(0, 0.7, 3), rng.uniform(0.25, 0.75)
    size, creep = reach(chain), rng.uniform(0, 0.08)

    def field(sit: Situation) -> Motions:
        since = sit.path.time / (sit.world.time[-1]) - when
        grown = np.where(since >= 0, 1 - creep * (1 - np.exp(-np.clip(since, 0, None) / 0.05)), 0.0)
        return _stand(sit, grown[:, None] * ways, grown[:, None] * tilts / size)

    return Hidden("station-shift", ("station-shift",), ("frame", "instrument"), field, also=("tracker-drift",))


def refraction(chain: Chain, rng: Rng) -> Hidden | None:
    """Warm air above a cold floor bends the beam down, with the square of the distance."""

    def instrument(sit: Situation, points: Array, amplitude: float) -> Array:
        away = points - sit.station
        flat = np.hypot(away[:, 0], away[:, 1])
        sunk = (flat / (2 * reach(sit.chain))) ** 2
        return np.column_stack([points[:, 0], points[:, 1], points[:, 2] - amplitude * sunk])

    return Hidden("refraction", ("refraction",), ("frame", "instrument"), instrument=instrument)


def air_refraction(chain: Chain, rng: Rng) -> Hidden | None:
    """As refraction, but the layering of the air comes and goes with the heat in the hall."""
    power = rng.uniform(1.9, 2.1)

    def instrument(sit: Situation, points: Array, amplitude: float) -> Array:
        away = points - sit.station
        flat = np.hypot(away[:, 0], away[:, 1])
        layers = sit.now(lagged(sit.world.gradient, 300.0)) / 2
        sunk = layers * (flat / (2 * reach(sit.chain))) ** power
        return np.column_stack([points[:, 0], points[:, 1], points[:, 2] - amplitude * sunk])

    also = ("thermal-bending", "structure-drift", "thermal-squareness", "tracker-drift")
    return Hidden("refraction", ("refraction",), ("frame", "instrument"), instrument=instrument, also=also)


def scale_ppm(chain: Chain, rng: Rng) -> Hidden | None:
    """The index of the air is wrong: all ranges are too long in proportion."""

    def instrument(sit: Situation, points: Array, amplitude: float) -> Array:
        out: Array = points + amplitude * (points - sit.station) / (2 * reach(sit.chain))
        return out

    return Hidden("scale-ppm", ("scale-ppm",), ("frame", "instrument"), instrument=instrument)


def target_offset(chain: Chain, rng: Rng) -> Hidden | None:
    """One reflector does not sit where its list of offsets has it."""
    if len(chain.tools) < 2:
        return None
    off, which = rng.normal(0, 1, 3), int(rng.integers(2))

    def field(sit: Situation) -> Motions:
        here = (sit.path.kind == which).astype(float)[:, None]
        return {"tool": np.hstack([here * off, np.zeros((len(sit), 3))])}

    return Hidden("target-offset", ("target-offset",), ("tool", chain.elements[-1].name), field)


def target_lost(chain: Chain, rng: Rng) -> Hidden | None:
    """The only reflector does not sit where it should: what the machine's last member takes on itself."""
    off = rng.normal(0, 1, 3)

    def field(sit: Situation) -> Motions:
        return {"tool": np.hstack([np.tile(off, (len(sit), 1)), np.zeros((len(sit), 3))])}

    return Hidden("target-offset", ("target-offset",), ("tool",), field)


def clock_offset(chain: Chain, rng: Rng) -> Hidden | None:
    """Measured on the fly by a clock that is late: all slides are seen where they will be a moment later."""
    if chain.rotary or len(chain.prismatic) < 2:
        return None

    def field(sit: Situation) -> Motions:
        return {e.name: along(e, -sit.path.dirs[e.name] * sit.path.feed / 6000.0) for e in chain.prismatic}

    names = ("instrument", "frame", *(e.name for e in chain.prismatic))
    accept = ("clock-offset", "servo-lag")
    return Hidden("clock-offset", accept, names, field, needs=("random", "large"))


def tilting_tripod(chain: Chain, rng: Rng) -> Hidden | None:
    """The stand tilts with the sun on one leg: drift of the instrument that a temperature explains."""
    name, size = str(rng.choice(["ea", "eb"])), reach(chain)

    def field(sit: Situation) -> Motions:
        tilt = motion(len(sit), **{name: sit.now(sit.world.gradient) / size})[:, 3:]
        return _stand(sit, np.zeros((len(sit), 3)), tilt)

    accept = ("tracker-drift", "structure-drift")
    return Hidden("tracker-drift", accept, ("frame", "instrument"), field, also=("thermal-squareness", "station-shift"))
