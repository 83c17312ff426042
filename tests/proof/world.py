"""The shop around a machine: air, heat in a slab and in a screw (heat equation), sensors on surfaces, idle channels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded

from tests.proof.kinematics import Array

STEP = 20.0  # s
Rng = np.random.Generator


@dataclass(frozen=True)
class World:
    """Histories on an even grid of time (s). Temperatures in degC; `screw` is (times, nodes), its rise in K."""

    time: Array
    air: Array
    mean: Array  # of a slab heated on one side, K above 20
    gradient: Array  # top minus bottom of the slab, K
    screw: Array
    spindle: Array  # K above 20
    hidden: Array  # a member that warms and settles, 0 to 1, and no sensor near it
    sensors: Mapping[str, Array]
    idle: Mapping[str, Array]  # w_ channels

    def at(self, history: Array, time: Array) -> Array:
        return np.interp(time, self.time, history)


def lagged(values: Array, tau: float, start: float | None = None) -> Array:
    """First-order lag on the grid."""
    out, share = np.empty_like(values), STEP / (tau + STEP)
    state = values[0] if start is None else start
    for k, value in enumerate(values):
        state += share * (value - state)
        out[k] = state
    return out


def heat_bar(
    inflow: Array, ambient: Array, *, nodes: int = 24, diffusion: float = 4.5e-4, loss: float = 2.5e-4, dt: float = STEP
) -> Array:
    """Rise (times, nodes) of a bar over its start: heat flows in at the first node and is lost all along.

    Implicit finite differences of ``dT/dt = D T_xx - loss (T - ambient)``, D per square of the bar's length in 1/s;
    `inflow` is the gradient ``-dT/dx`` at the first end per length of the bar, the other end is insulated.
    """
    h = 1.0 / (nodes - 1)
    r = diffusion * dt / h**2
    bands = np.zeros((3, nodes))
    bands[0, 1:], bands[2, :-1] = -r, -r
    bands[1] = 1 + 2 * r + loss * dt
    bands[0, 1] = bands[2, -2] = -2 * r
    state, out = np.zeros(nodes), np.empty((len(inflow), nodes))
    for k, (flow, air) in enumerate(zip(inflow, ambient, strict=True)):
        right = state + loss * dt * air
        right[0] += 2 * r * h * flow
        state = solve_banded((1, 1), bands, right)
        out[k] = state
    return out


def wander(rng: Rng, n: int, tau: float) -> Array:
    """Ornstein-Uhlenbeck process of unit standard deviation on the grid."""
    keep = np.exp(-STEP / tau)
    state, out = float(rng.normal()), np.empty(n)
    for k in range(n):
        state = keep * state + np.sqrt(1 - keep**2) * float(rng.normal())
        out[k] = state
    return out


def bursts(rng: Rng, time: Array, mean: float) -> Array:
    """Switched on and off at random, 0 or 1."""
    out, t, on = np.zeros(len(time)), float(time[0]), bool(rng.integers(2))
    while t < time[-1]:
        until = t + float(rng.exponential(mean)) + mean / 3
        if on:
            out[(time >= t) & (time < until)] = 1.0
        t, on = until, not on
    return out


def draw_world(rng: Rng, duration: float) -> World:
    """A shift in a shop, from half an hour before the first row."""
    time = np.arange(-1800.0, duration + 2 * STEP, STEP)
    n, span = len(time), duration
    swing = rng.uniform(1.0, 3.0) * np.sin(2 * np.pi * (time / (span * rng.uniform(0.8, 2.5)) + rng.uniform()))
    air = rng.uniform(19.0, 22.0) + swing + 0.25 * wander(rng, n, 1500.0)
    air = air - 0.8 * lagged(bursts(rng, time, span / 4), 200.0)
    lamps = lagged(bursts(rng, time, span / 3), 120.0)
    top = air + rng.uniform(1.5, 4.0) * lamps
    # a slab: two lumps for its faces around a core, each behind the one outside it
    face, core = lagged(top, span * rng.uniform(0.05, 0.12)), lagged(air, span * rng.uniform(0.12, 0.3))
    below = lagged(air, span * rng.uniform(0.05, 0.1))
    mean = 0.25 * face + 0.5 * (core + lagged(face - core, span * 0.1)) + 0.25 * below - 20
    gradient = face - below
    duty = bursts(rng, time, span / 5) * rng.uniform(0.5, 1.0)
    screw = heat_bar(duty * rng.uniform(5, 12), lagged(air - air[0], 900.0), loss=rng.uniform(2, 5) / span)
    motor = bursts(rng, time, span / 4)
    spindle = lagged(air - 20, 0.3 * span) + lagged(motor * rng.uniform(4, 9), span * rng.uniform(0.06, 0.15), 0.0)
    warm = np.clip(time + rng.uniform(0, 300), 0, None)
    fast, slow = span * rng.uniform(0.12, 0.25), span * rng.uniform(0.5, 0.9)
    hidden = 1 - 0.7 * np.exp(-warm / fast) - 0.3 * np.exp(-warm / slow)

    def sensor(temperature: Array, tau: float) -> Array:
        """On a surface: late, not at full height, a little off, noisy."""
        late = lagged(temperature, tau)
        whole = 20 + rng.uniform(0.86, 1.0) * (late - 20) + rng.normal(0, 0.15)
        return whole + rng.normal(0, 0.03, n)

    sensors = {
        "T_air": sensor(air, rng.uniform(30, 120)),
        "T_top": sensor(face, rng.uniform(60, 240)),
        "T_base": sensor(below, rng.uniform(60, 240)),
        "T_motor": sensor(20 + screw[:, 0], rng.uniform(60, 200)),
        "T_spindle": sensor(20 + spindle, rng.uniform(60, 240)),
        "T_coolant": 20.5 + 0.6 * wander(rng, n, 1200.0) + rng.normal(0, 0.03, n),
    }
    idle = {
        "w_humidity": 47 + 4 * wander(rng, n, 2500.0) + rng.normal(0, 0.1, n),
        "w_pressure": 6.1 + 0.05 * wander(rng, n, 300.0) + rng.normal(0, 0.006, n),
        "w_current": 1.2 + 0.2 * bursts(rng, time, span / 12) + rng.normal(0, 0.02, n),
    }
    return World(time, air, mean, gradient, screw, spindle, hidden, sensors, idle)


def elongation(world: World, along: Array, time: Array, anchor: float) -> Array:
    """Integral of the screw's rise from the anchor to a place along it (0 to 1), K per length, (n,)."""
    nodes = np.linspace(0, 1, world.screw.shape[1])
    step = nodes[1]
    inner = (world.screw[:, 1:] + world.screw[:, :-1]) / 2 * step
    total = np.concatenate([np.zeros((len(world.time), 1)), np.cumsum(inner, axis=1)], axis=1)
    row = np.interp(time, world.time, np.arange(len(world.time)))
    low = np.clip(row.astype(int), 0, len(world.time) - 2)
    part = (row - low)[:, None]
    mixed = (1 - part) * total[low] + part * total[low + 1]

    def read(u: Array) -> Array:
        place = np.clip(u, 0, 1) / step
        k = np.clip(place.astype(int), 0, len(nodes) - 2)
        f = place - k
        rows = np.arange(len(u))
        out: Array = (1 - f) * mixed[rows, k] + f * mixed[rows, k + 1]
        return out

    return read(along) - read(np.full(len(along), anchor))
