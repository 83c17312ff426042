"""Ways in which people measure machines: random poses, grids walked like a plotter, lines there and back, poor ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tests.proof.kinematics import Array, Chain, Element

Rng = np.random.Generator


@dataclass(frozen=True)
class Plan:
    """How poses are chosen, and which columns are recorded."""

    name: str
    rows: tuple[int, int]
    tools: int = 2
    bare: bool = False  # no direction, time, temperature or other column
    approach: bool = False  # every pose is approached from a side that has nothing to do with the pose before


PLANS = {
    p.name: p
    for p in (
        Plan("random", (300, 520), approach=True),
        Plan("rows", (300, 520)),  # random poses one after the other
        Plan("grid", (250, 450), tools=1),
        Plan("grid2", (300, 600)),
        Plan("lines", (300, 600)),
        Plan("wander", (350, 600)),
        Plan("levels", (300, 500)),
        Plan("poor", (120, 120), tools=1, bare=True),
        Plan("oneway", (250, 400)),
        Plan("large", (3000, 3000), approach=True),
        Plan("still", (200, 400), approach=True),  # one temperature all the time
    )
}


@dataclass(frozen=True)
class Path:
    """Rows in their order: commands (mm, rad), the last move's way (mm, rad) and side, what else is known."""

    q: Mapping[str, Array]
    moves: Mapping[str, Array]
    dirs: Mapping[str, Array]
    tool: Array  # (n, 3)
    kind: Array  # index of the tool
    time: Array
    feed: Array
    load: Array

    def __len__(self) -> int:
        return len(self.time)


def walk(chain: Chain, plan: Plan, rng: Rng, rows: int, duration: float | None = None) -> Path:
    """A path of that plan; `duration` (s) is drawn if it is not given."""
    table = _STYLES.get(plan.name, _random)(chain, rng, rows)
    n = len(next(iter(table.values())))
    q = {j.name: _rounded(j, table[j.name]) for j in chain.joints}
    moves = {name: np.diff(v, prepend=v[0] - (v[1] - v[0]) if n > 1 else v[0]) for name, v in q.items()}
    dirs = {name: _sides(m) for name, m in moves.items()}
    if plan.approach:
        dirs = {j.name: rng.choice([-1.0, 1.0], n) for j in chain.joints}
        moves = {j.name: dirs[j.name] * 0.02 * j.length for j in chain.joints}
    count = min(plan.tools, len(chain.tools))
    kind = np.sort(np.arange(n) % count) if plan.name in ("grid2", "lines", "levels") else rng.integers(count, size=n)
    gaps = rng.uniform(12, 45, n) + (rng.uniform(size=n) < 0.01) * rng.uniform(300, 900, n)
    time = np.cumsum(gaps) - gaps[0]
    if n > 1000:
        time *= 0.3
    if duration is not None:
        time *= duration / time[-1]
    feed = rng.choice([1500.0, 3000.0, 6000.0], n)
    load = np.repeat(rng.choice([0.0, 25.0, 60.0], n // 20 + 1), 20)[:n]
    return Path(q, moves, dirs, np.array(chain.tools)[kind], kind, np.round(time, 1), feed, load)


def later(chain: Chain, plan: Plan, rng: Rng, rows: int, begin: float, end: float) -> Path:
    """Poses of another visit, anywhere in the travels, between two times (s)."""
    again = plan
    if plan.name not in ("wander", "oneway"):
        again = PLANS["random"] if plan.approach else PLANS["rows"]
    path = walk(chain, again, rng, rows, end - begin)
    kind = rng.integers(min(plan.tools, len(chain.tools)), size=len(path))
    time = np.round(path.time + begin, 1)
    return Path(path.q, path.moves, path.dirs, np.array(chain.tools)[kind], kind, time, path.feed, path.load)


def _rounded(joint: Element, q: Array) -> Array:
    if joint.kind == "rotary":
        return np.radians(np.round(np.degrees(q), 3))
    return np.round(q, 3)


def _sides(moves: Array) -> Array:
    """Side of arrival; a joint that rested keeps it."""
    out, side = np.empty(len(moves)), 1.0
    for k, m in enumerate(moves):
        side = float(np.sign(m)) if m else side
        out[k] = side
    return out


def _random(chain: Chain, rng: Rng, rows: int) -> dict[str, Array]:
    return {j.name: rng.uniform(*j.travel, rows) for j in chain.joints}


def _grid(chain: Chain, rng: Rng, rows: int) -> dict[str, Array]:
    """Levels of all joints, the last one fastest and there and back like a plotter; positions a little off the grid."""
    joints = chain.joints
    counts = np.array([j.model[1] + 1 if j.kind == "prismatic" else 5 for j in joints])
    while np.prod(counts) < rows:
        counts[int(np.argmin(counts + 0.01 * np.arange(len(joints))))] += 1
    order = list(rng.permutation(len(joints)))
    walked: list[list[int]] = [[]]
    for k in order:
        walked = [
            [*row, level]
            for i, row in enumerate(walked)
            for level in (range(counts[k]) if i % 2 == 0 else reversed(range(counts[k])))
        ]
    levels = np.array(walked)[:, np.argsort(order)]
    out = {}
    for k, j in enumerate(joints):
        at = j.travel[0] + j.length * (levels[:, k] + 0.0) / max(counts[k] - 1, 1)
        # a controller does not stop at the last hundredth: keep clear of the ends, and vary the pitch of the grid
        out[j.name] = j.travel[0] + (at - j.travel[0]) * 0.97 + 0.015 * j.length
    return out


def _lines(chain: Chain, rng: Rng, rows: int) -> dict[str, Array]:
    """Lines of one joint there and back at random places of the others, then diagonals."""
    joints, parts, done = chain.joints, [], 0
    number = 0
    while done < rows:
        n = int(rng.integers(11, 19))
        place = {j.name: rng.uniform(*j.travel) for j in joints}
        part = {name: np.full(2 * n, value) for name, value in place.items()}
        moved = [joints[number % len(joints)]] if number % 4 else list(joints)
        for j in moved:
            ends = sorted(rng.uniform(*j.travel, 2)) if len(moved) > 1 else [j.travel[0], j.travel[1]]
            there = np.linspace(ends[0], ends[1], n) + rng.normal(0, 0.004 * j.length, n)
            there = np.clip(np.sort(there), *j.travel)
            part[j.name] = np.concatenate([there, there[::-1]])
        parts.append(part)
        number, done = number + 1, done + 2 * n
    return {j.name: np.concatenate([p[j.name] for p in parts])[:rows] for j in joints}


def _wander(chain: Chain, rng: Rng, rows: int) -> dict[str, Array]:
    """Long and short moves mixed, 0.2 to 60 % of the travel, with many small reversals."""
    out = {}
    for j in chain.joints:
        place, track = rng.uniform(*j.travel), []
        for _ in range(rows):
            step = j.length * 10 ** rng.uniform(-2.7, -0.2) * rng.choice([-1, 1])
            if not j.travel[0] <= place + step <= j.travel[1]:
                step = -step
            place = float(np.clip(place + step, *j.travel))
            track.append(place)
        out[j.name] = np.array(track)
    return out


def _levels(chain: Chain, rng: Rng, rows: int) -> dict[str, Array]:
    """One joint kept at a level for a while, at eight of them; the others anywhere."""
    out = _random(chain, rng, rows)
    j = chain.joints[int(rng.integers(len(chain.joints)))]
    out[j.name] = np.repeat(rng.permutation(np.linspace(*j.travel, 8)), rows // 8 + 1)[:rows]
    return out


def _oneway(chain: Chain, rng: Rng, rows: int) -> dict[str, Array]:
    """Random poses in the order of the first slide's (or first joint's) position: it only ever moves one way."""
    out = _random(chain, rng, rows)
    name = (chain.prismatic or chain.joints)[0].name
    out[name] = np.sort(out[name])
    return out


_STYLES = {
    "grid": _grid, "grid2": _grid, "lines": _lines, "wander": _wander, "levels": _levels, "oneway": _oneway,
}  # fmt: skip
