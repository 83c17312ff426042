"""Functions of everything that a survey recorded, with which residuals are compared in the test of independence.

Of one channel, of two channels, and of one channel, or two or three commands, times the effect of one error motion: a
motion that follows them. Beside the commands, sensors and the clock there are channels of the path: where a joint had
been before, where it last turned round, the mean of its recent positions, and hysteresis operators of two kinds, the
play and the relay (I. D. Mayergoyz, Mathematical Models of Hysteresis, 1991). A parameter that wanders or switches in
time is a motion that follows quick functions of the clock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from errormodel.arrays import Array, Index, Mask
from errormodel.channels import CLOCKS
from errormodel.conventions import MOTIONS, Motion
from errormodel.effects.base import Effect
from identification.diagnosis.linear.linear_model import LinearModel

ORDERS, ORDERS_OF_PAIR, ORDERS_OF_MOTION = 5, 4, 3  # cosines of a channel: waves down to 0.4, 0.5, 0.7 of its range
ORDERS_OF_SEVERAL = {2: 3, 3: 2}  # of each of two or three commanded channels that one motion follows
# cosines of the clock, of a parameter that wanders or switches, and the orders beyond which they count less: those of
# an exponential correlation over a tenth of the survey, and over a hundredth
QUICK_ORDERS, CORNERS = 100, (4.0, 32.0)
CYCLES = (2, 3, 4)  # rows after which something may repeat: nests or styli used in turn, a pawl
RECENT = 0.7  # weight of each position in the mean of recent ones, of that of the next
TRAVELS = (0.7, 0.95)  # the same of the distance travelled, which warms
PLAY = 0.5  # of a joint's range
RELAY = 0.3  # quantiles of a joint's positions, from either end, beyond which a relay switches
OTHER_RELAYS = (0.1, 0.15, 0.2, 0.25, 0.35, 0.4, 0.45)  # of the relays that a joint's own motions may follow
MOST_MOTIONS = 24
TINY = 1e-300
ALIKE = 0.99  # squared correlation of the levers of two motions, beyond which they are taken as one
(CLOCK, ROW), SET = CLOCKS, ("feed", "load")


@dataclass(frozen=True)
class Functions:
    """Functions of one to three channels.

    Attributes
    ----------
    channels : one to three names. ``before(X)``, ``before(before(X))``, ``turn(X)``, ``recent(X)``, ``play(X)``,
        ``relay(X)`` are of the path of X; ``travel(0.7)`` is the distance travelled in the last rows.
    factors : functions (n, k) over some rows of the survey, each of one channel; of several, all products count.
    index : (N,) which of these rows each observation is of.
    lever : (N,) whitened effect of a motion; None: none.
    filtered : what is done to functions (N, k) before they are compared; None: nothing.
    element, motion : whose whitened effect they are multiplied with; "" where each component of the points has
        coefficients of its own.
    """

    channels: tuple[str, ...]
    factors: tuple[Array, ...]
    index: Index
    lever: Array | None = None
    filtered: Callable[[Array], Array] | None = None
    element: str = ""
    motion: str = ""

    @property
    def by_row(self) -> Array:
        """The functions (n, k) over the survey's rows; made at each call, as all together would not fit the memory."""
        one, *others = self.factors
        for other in others:
            one = (one[:, :, None] * other[:, None, :]).reshape(len(one), -1)
        return one

    @property
    def values(self) -> Array:
        """The functions (N, k) at the observations, times the effect of the motion."""
        one = self.by_row[self.index]
        if self.lever is not None:
            one = self.lever[:, None] * one
        return one if self.filtered is None else self.filtered(one)

    def summed(self, whole: Array) -> Array:
        """Vectors (N, r) times the effect of the motion, summed over the observations of each row: (n, r)."""
        from scipy.sparse import csr_array

        assert self.lever is not None
        rows, seen = len(self.factors[0]), np.arange(len(self.index))
        return np.asarray(csr_array((self.lever, (self.index, seen)), shape=(rows, len(seen))) @ whole)


def only(parts: Sequence[Functions], keep: Mask) -> list[Functions]:
    """The same functions at some of the observations; of what they share, such as the lever of a motion, one copy."""
    copies: dict[int, NDArray[Any]] = {}

    def kept(own: NDArray[Any]) -> NDArray[Any]:
        if id(own) not in copies:
            copies[id(own)] = own[keep]
        return copies[id(own)]

    return [replace(p, index=kept(p.index), lever=None if p.lever is None else kept(p.lever)) for p in parts]


def recorded(linear: LinearModel, rows: Index) -> list[Functions]:
    """All functions, at all observations, by the channels' values in the `rows` that these are of, in their order."""
    plain, past = _channels(linear)
    bases = dict(_cosines_of(plain, rows, ORDERS))
    paths = {name: dict(_cosines_of(own, rows, ORDERS)) for name, own in past.items()}
    index = np.searchsorted(rows, linear.index)
    out = [Functions((name,), (f,), index) for name, f in bases.items()]
    out += [Functions((name,), (f,), index) for own in paths.values() for name, f in own.items()]
    low = {name: f[:, :ORDERS_OF_PAIR] for name, f in bases.items()}
    out += [Functions((a, b), (f, g), index) for (a, f), (b, g) in combinations(low.items(), 2)]
    for joint, own in paths.items():
        if joint in low:
            out += [Functions((joint, name), (low[joint], f[:, :ORDERS_OF_PAIR]), index) for name, f in own.items()]
    quick, relays = _quick(plain, rows), dict(_relays_of(plain, linear, rows))
    names = [n for n in (*(j.name for j in linear.scene.moving), *SET) if n in bases]
    for element, motion, lever in _levers(linear):
        for count, orders in ORDERS_OF_SEVERAL.items():
            for several in combinations(names, count):
                factors = tuple(bases[n][:, :orders] for n in several)
                out.append(Functions(several, factors, index, lever, element=element, motion=motion))
        for name, f in {**bases, **paths.get(element, {})}.items():
            for values in quick if name == CLOCK else [f[:, :ORDERS_OF_MOTION]]:
                out.append(Functions((name,), (values,), index, lever, element=element, motion=motion))
        for values in relays.get(element, ()):
            out.append(Functions((f"relay({element})",), (values,), index, lever, element=element, motion=motion))
    return out


def wandering(linear: LinearModel, rows: Index) -> list[Functions]:
    """Motions that follow the clock down to quick changes: those of `recorded`."""
    quick, index = _quick(_channels(linear)[0], rows), np.searchsorted(rows, linear.index)
    return _of_each_motion(linear, (CLOCK,), quick, index)


def in_turns(linear: LinearModel, rows: Index) -> list[Functions]:
    """Motions that follow the place of a row in a cycle of a few rows, ``cycle(2)``."""
    number, index = np.arange(len(next(iter(linear.scene.columns.values())))), np.searchsorted(rows, linear.index)
    turns = {f"cycle({k})": (number % k).astype(float) for k in CYCLES}
    functions = list(_cosines_of(turns, rows, max(CYCLES)))
    return [part for name, values in functions for part in _of_each_motion(linear, (name,), [values], index)]


def in_one_motion(linear: LinearModel, effects: Sequence[Effect]) -> list[Functions]:
    """Single motions of joints that follow what moves a whole element in several motions alike.

    A station that is knocked moves in all directions; what moves in one only is a state of a joint.
    """
    if linear.rows is None:
        return []
    courses, channels = list[Array](), dict[str, None]()
    for effect in effects:
        moved = [value for term in linear.terms([effect]) for value in term.motion.values()]
        one, *others = (np.asarray(value, float) for value in moved)
        # what is the same in all rows, as a target's place, is no course
        if others and np.ptp(one) > 0 and all(np.array_equal(one, other) for other in others):
            courses.append(one - one.mean())
            channels |= dict.fromkeys(effect.drivers)
    together = [np.column_stack(courses)] if courses else []
    return _of_each_motion(linear, tuple(channels), together, linear.rows.number)


def _of_each_motion(
    linear: LinearModel, channels: tuple[str, ...], functions: Sequence[Array], index: Index
) -> list[Functions]:
    """Every motion that follows each of some functions (n, k) of the same channels."""
    return [
        Functions(channels, (values,), index, lever, element=element, motion=motion)
        for element, motion, lever in (_levers(linear) if functions else ())
        for values in functions
    ]


def _quick(plain: Mapping[str, Array], rows: Index) -> list[Array]:
    """Functions (n, k) of the clock, with each of the `CORNERS`."""
    clock = {CLOCK: plain[CLOCK]}
    return [f for corner in CORNERS for _, f in _cosines_of(clock, rows, QUICK_ORDERS, corner)]


def _channels(linear: LinearModel) -> tuple[dict[str, Array], dict[str, dict[str, Array]]]:
    """Channels (n,) over the survey's rows, and of each joint those of its path."""
    plain = dict(linear.scene.columns)
    length = len(next(iter(plain.values())))
    plain.setdefault(CLOCK, np.arange(length, dtype=float))
    past = {}
    steps = [np.abs(np.diff(plain[j.name], prepend=plain[j.name][:1])) for j in linear.scene.moving]
    whole = np.sum([step / max(float(np.mean(step)), TINY) for step in steps if np.isfinite(step).all()], axis=0)
    if np.size(whole) == length:
        plain |= {f"travel({kept:g})": _recent(np.append(whole[1:], 0.0), kept) for kept in TRAVELS}
    for joint in linear.scene.moving:
        q = plain[joint.name]
        if np.isfinite(q).all():
            before = np.append(q[:1], q[:-1])
            plain[f"before({joint.name})"] = before
            past[joint.name] = {
                f"before(before({joint.name}))": np.append(q[:1], before[:-1]),
                f"turn({joint.name})": _turned(q),
                f"recent({joint.name})": _recent(q),
                f"play({joint.name})": _play(q, PLAY * float(np.ptp(q)) / 2),
                f"relay({joint.name})": _relay(q, RELAY),
            }
    return plain, past


def _turned(q: Array) -> Array:
    """Where the joint last turned round before each row."""
    side = np.sign(np.diff(q))
    turned = np.zeros(len(q), dtype=bool)
    turned[2:] = side[1:] * side[:-1] < 0
    return np.asarray(q[_latest(np.where(turned, np.arange(len(q)) - 1, 0))])


def _latest(rows: Index) -> Index:
    """The largest number up to each place."""
    return np.asarray(np.maximum.accumulate(rows))


def _recent(q: Array, kept: float = RECENT) -> Array:
    """Mean of the values before each row, the later ones counting more."""
    import pandas as pd

    means = pd.Series(q).ewm(alpha=1 - kept, adjust=False).mean().to_numpy()
    return np.append(q[:1], means[:-1])


def _play(q: Array, half: float) -> Array:
    """A follower with play of `half` on either side."""
    at, out = float(q[0]), []
    for x in q.tolist():
        at = min(max(at, x - half), x + half)
        out.append(at)
    return np.array(out)


def _relay(q: Array, beyond: float) -> Array:
    """A state that becomes 1 above a quantile, -1 below that from the other end, and stays between."""
    low, high = np.quantile(q, [beyond, 1 - beyond])
    state = np.where(q > high, 1.0, np.where(q < low, -1.0, 0.0))
    return np.asarray(state[_latest(np.where(state != 0, np.arange(len(q)), 0))])


def _relays_of(plain: Mapping[str, Array], linear: LinearModel, rows: Index) -> Iterator[tuple[str, list[Array]]]:
    """Joints and their `OTHER_RELAYS`, each (n, 1) over some rows of the survey."""
    for joint in linear.scene.moving:
        if np.isfinite(q := plain[joint.name]).all():
            own = {str(beyond): _relay(q, beyond) for beyond in OTHER_RELAYS}
            yield joint.name, [f for _, f in _cosines_of(own, rows, 1)]


def _cosines_of(
    channels: Mapping[str, Array], rows: Index, orders: int, corner: float | None = None
) -> Iterator[tuple[str, Array]]:
    """Names and smooth functions (n, k) over some rows of the survey of every channel that varies there."""
    for name, values in channels.items():
        own = values[rows]
        if np.isfinite(own).all() and np.ptp(own) > 0:
            yield name, _cosines(own, min(orders, len(np.unique(own)) - 1), corner)


def _cosines(values: Array, count: int, corner: float | None) -> Array:
    """Centred cosines (n, count) of the ranks of a channel; higher orders count less, from the `corner` or at once."""
    order = np.sort(values)
    rank = (np.searchsorted(order, values, "left") + np.searchsorted(order, values, "right")) / (2 * len(values))
    orders = np.arange(1, count + 1)
    less = np.sqrt(orders) if corner is None else np.hypot(1.0, orders / corner)
    out = np.cos(np.pi * np.outer(rank, orders)) / less
    return np.asarray(out - out.mean(axis=0))


def alike_motions(linear: LinearModel, element: str, motion: str, least: float = ALIKE) -> list[tuple[str, Motion]]:
    """Motions of other moved joints that do the same to the rows as a motion of an element.

    Parameters
    ----------
    least : squared correlation of their levers.
    """
    own = linear.levers[element][MOTIONS.index(motion)]
    whole = float(own @ own)
    return [
        (joint, other)
        for joint, other, unit in _unit_levers(linear)
        if joint != element and float(unit @ own) ** 2 >= least * whole > 0
    ]


def _levers(linear: LinearModel) -> Iterator[tuple[str, str, Array]]:
    """Element, motion and whitened effect (N,) of the motions of moved joints, each of those that are alike once."""
    seen = list[Array]()
    for joint, motion, unit in _unit_levers(linear):
        if len(seen) < MOST_MOTIONS and all(float(unit @ other) ** 2 < ALIKE for other in seen):
            seen.append(unit)
            yield joint, motion, unit * np.sqrt(len(unit))


def _unit_levers(linear: LinearModel) -> Iterator[tuple[str, Motion, Array]]:
    """Joint, motion and whitened effect (N,), of unit length, of each motion of moved joints that the rows show."""
    for joint in linear.scene.moving:
        for motion, lever in zip(MOTIONS, linear.levers.get(joint.name, ()), strict=False):
            if length := float(np.linalg.norm(lever)):
                yield joint.name, motion, lever / length
