"""Effects without a name, of forms drawn at random: each generator of random numbers gives another one.

Compositions of functions of one to three channels, states that switch unseen, parameters that wander, and memories of
the path.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from tests.proof.hidden import Hidden, Rng, Situation, crosswise, motion, reach
from tests.proof.kinematics import Array, Chain, Element, Motions

Series = Callable[[Situation], Array]  # (n,) of about unit size
SWITCHES_S, WANDERS_S = (400.0, 4000.0), (600.0, 6000.0)  # mean time in a state; correlation time
STEP_S = 30.0  # of a wandering parameter
IDLE = ("w_humidity", "w_pressure", "w_current")


def nameless(chain: Chain, rng: Rng) -> Hidden | None:
    """One drawn effect: a displacement across a joint or a tilt of it, by a form of one of four kinds."""
    e = chain.joints[int(rng.integers(len(chain.joints)))]
    tilts = bool(rng.random() < 0.5)
    unit = 1 / reach(chain) if tilts else 1.0
    name = ("ea", "eb", "ec")[int(rng.integers(3))] if tilts else f"d{'xyz'[int(rng.choice(crosswise(e)))]}"
    kind = int(rng.integers(4))
    channels = list[str]()
    series = (partial(_composition, channels), _switching, _wandering, _memory)[kind](chain, rng)
    also = {0: ("cross-axis-compliance", "beam-torsion", "column-bending"), 3: ("hysteresis",)}.get(kind, ())
    if kind == 0 and channels == [e.name]:  # an error motion along its own travel has a name
        also = (*also, "higher-order-geometry")

    def field(sit: Situation) -> Motions:
        return {e.name: motion(len(sit), **{name: unit * series(sit)})}

    return Hidden("nameless", ("unnamed", *also), (e.name,), field, note="abcd"[kind], physical=4.0)


def _place(sit: Situation, name: str) -> Array:
    return np.asarray(2 * sit.share(name) - 1)


def _some(chain: Chain, rng: Rng, count: int) -> list[Element]:
    return [chain.joints[k] for k in rng.permutation(len(chain.joints))[:count]]


def _composition(channels: list[str], chain: Chain, rng: Rng) -> Series:
    """A function of a function of one to three `channels`, which it appends: joints, and records of the shop."""
    count = int(rng.integers(1, 4))
    channels += [e.name for e in _some(chain, rng, count)]
    parts: list[Series] = [partial(_place, name=name) for name in channels]
    if count < 3 and rng.random() < 0.5:
        channel = str(rng.choice(IDLE))
        channels.append(channel)
        parts.append(lambda sit: _standard(sit.now(sit.world.idle[channel]), sit.world.idle[channel]))
    weights, bend, phase = rng.normal(size=len(parts)), rng.uniform(1.0, 3.0), rng.uniform(0, 6)
    outer = int(rng.integers(3))

    def series(sit: Situation) -> Array:
        values = [part(sit) for part in parts]
        mixed = sum(w * v for w, v in zip(weights, values, strict=True)) / np.linalg.norm(weights)
        product = np.prod(np.stack([1.0 + 0.5 * v for v in values]), axis=0)
        inner = (mixed, product, mixed * product)[outer]
        out: Array = np.sin(bend * inner + phase) + 0.5 * np.tanh(2 * bend * mixed)
        return out

    return series


def _standard(values: Array, whole: Array) -> Array:
    out: Array = (values - whole.mean()) / whole.std()
    return out


def _switching(chain: Chain, rng: Rng) -> Series:
    """A state that switches between two values at random times, and moves alike whatever the machine does."""
    seed, mean = int(rng.integers(2**31)), rng.uniform(*SWITCHES_S)

    def series(sit: Situation) -> Array:
        own, at, edges = np.random.default_rng(seed), 0.0, list[float]()
        while at < sit.path.time.max():
            at += own.exponential(mean)
            edges.append(at)
        out: Array = 2.0 * (np.searchsorted(edges, sit.path.time) % 2) - 1.0
        return out

    return series


def _wandering(chain: Chain, rng: Rng) -> Series:
    """A parameter that follows an Ornstein-Uhlenbeck process."""
    seed, kept = int(rng.integers(2**31)), float(np.exp(-STEP_S / rng.uniform(*WANDERS_S)))

    def series(sit: Situation) -> Array:
        own, steps = np.random.default_rng(seed), int(sit.path.time.max() / STEP_S) + 2
        out = np.zeros(steps)
        for k, news in enumerate(own.normal(0, np.sqrt(1 - kept**2), steps - 1)):
            out[k + 1] = kept * out[k] + news
        return np.asarray(np.interp(sit.path.time, STEP_S * np.arange(steps), out))

    return series


def _memory(chain: Chain, rng: Rng) -> Series:
    """What a joint's earlier positions leave behind: those one to three rows before, their mean, or a relay."""
    (e,), kind, lag = _some(chain, rng, 1), int(rng.integers(3)), int(rng.integers(1, 4))
    bend, kept, edge = rng.uniform(1.0, 4.0), rng.uniform(0.5, 0.9), rng.uniform(0.2, 0.4)

    def series(sit: Situation) -> Array:
        u = 2 * sit.share(e.name) - 1
        if kind == 0:
            return np.asarray(np.tanh(bend * np.concatenate([np.full(lag, u[0]), u[:-lag]])))
        out, state = np.zeros(len(u)), 0.0
        for k, now in enumerate(u):
            if kind == 1:
                out[k] = state
                state = kept * state + (1 - kept) * now
            else:
                state = 1.0 if now > 1 - 2 * edge else -1.0 if now < 2 * edge - 1 else state
                out[k] = state
        return out * (2.0 if kind == 1 else 1.0)

    return series
