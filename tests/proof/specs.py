"""The list of cases: which machine, plan, noise and effects; by numbers that never change."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace

import numpy as np

from tests.proof.catalogue import BUILDERS, NAMED, PAIRS, UNNAMED, UNSEEN
from tests.proof.machines import BUILDERS as MACHINES
from tests.proof.machines import with_model

SEED = int(os.environ.get("PROOF_SEED", "20260_11"))  # of all worlds: another number, and no case was ever seen
TIMELESS = {  # effects for which a bare survey has all that is needed
    "rail-waviness", "higher-order-geometry", "local-defect", "contact-knee", "pitch-cyclic", "eccentricity", "wobble",
    "ram-sag", "beam-sag", "beam-torsion", "column-bending", "cross-axis-compliance", "joint-compliance",
}  # fmt: skip
USUAL = ("random", "rows", "levels", "lines")
POOR = ("poor", "oneway", "poor", "still")


@dataclass(frozen=True)
class Spec:
    """One case before anything is drawn. `seed` makes machine, path and world; a pair's halves share it.

    `after`: held-out poses come after the survey for half as long, while the world goes on; else over the same hours.
    """

    name: str
    kind: str  # empty | single | weak | mixture | pair | unnamed | unseen | blunder
    topology: str
    plan: str
    noise: str
    effects: tuple[str, ...] = ()
    delta: tuple[float, float] = (12.0, 60.0)
    seed: int = 0
    order: int = 2
    first: bool = False
    blunder: str = ""
    after: bool = False


def walkable(plan: str, topology: str) -> str:
    """The plan, or lines where a grid would have too many joints."""
    many = len(MACHINES[topology](np.random.default_rng(1)).joints) > 4
    return "lines" if plan in ("grid", "grid2") and many else plan


def suits(effect: str, topology: str) -> bool:
    """Whether a machine of that kind can have the effect."""
    rng = np.random.default_rng(1)
    return BUILDERS[effect](with_model(MACHINES[topology](rng), 2), rng) is not None


def plans_for(effect: str) -> tuple[str, ...]:
    """Plans on which an effect makes sense."""
    rng = np.random.default_rng(1)
    for topology in MACHINES:
        hidden = BUILDERS[effect](with_model(MACHINES[topology](rng), 2), rng)
        if hidden is not None:
            if hidden.needs:
                return hidden.needs
            return (*USUAL, "poor", "grid2", "large") if effect in TIMELESS else USUAL
    raise ValueError(effect)


def all_specs() -> list[Spec]:
    """The 330 cases, in an order in which any beginning is a fair sample."""
    one, two, three, four, five = (np.random.default_rng([SEED, k]) for k in range(5))
    drawn = [_single(one), _weak(two), _mixtures(three), _pairs(four), _unnamed(five)]
    groups = [_empty(), *drawn, _unseen(), _blunders()]
    named = [
        replace(s, name=f"{s.kind}-{k:03}", seed=s.seed or 1000 * g + k + 1)
        for g, group in enumerate(groups)
        for k, s in enumerate(group)
    ]
    ranks = {s.name: (k + 0.5) / len(g) for g in _by_kind(named) for k, s in enumerate(g)}
    return sorted(named, key=lambda s: ranks[s.name])


def _by_kind(specs: list[Spec]) -> list[list[Spec]]:
    return [[s for s in specs if s.kind == kind] for kind in dict.fromkeys(s.kind for s in specs)]


def _empty() -> list[Spec]:
    topologies, noises = list(MACHINES), ("white", "coloured", "tracker", "white", "coloured", "heavy")
    plans = (*USUAL, *POOR, "grid", "grid2", "wander", "random")
    out = []
    for k in range(100):
        plan = "large" if k in (37, 71, 95) else plans[k % len(plans)]
        order, first = (3, False) if k % 7 == 3 else (1, k % 2 == 0) if k % 7 == 5 else (2, False)
        noise = noises[(k + k // 12) % len(noises)]
        topology = topologies[(k + k // 10) % len(topologies)]
        out.append(Spec("", "empty", topology, walkable(plan, topology), noise, order=order, first=first))
    return out


def _one(rng: np.random.Generator, kind: str, effect: str, k: int, delta: tuple[float, float]) -> Spec:
    fit = [t for t in MACHINES if suits(effect, t)]
    plans = [p for p in plans_for(effect) if p not in ("large", "poor") or k % 3 == 2]
    noise = str(rng.choice(["white", "white", "tracker", "coloured", "heavy"]))
    order = int(rng.choice([1, 2, 2, 2, 3]))
    topology = str(rng.choice(fit))
    plan = walkable(str(rng.choice(plans)), topology)
    return Spec("", kind, topology, plan, noise, (effect,), delta, order=order)


def _single(rng: np.random.Generator) -> list[Spec]:
    out = [_one(rng, "single", name, k, (12.0, 60.0)) for k in range(3) for name in NAMED]
    return out[:96]


def _weak(rng: np.random.Generator) -> list[Spec]:
    names = [str(n) for n in rng.permutation(list(NAMED))[:16]]
    return [_one(rng, "weak", name, 0, (3.0, 8.0)) for name in names]


def _mixtures(rng: np.random.Generator) -> list[Spec]:
    out: list[Spec] = []
    while len(out) < 30:
        topology = str(rng.choice(list(MACHINES)))
        plan = str(rng.choice(["random", "rows"]))
        fit = [n for n in NAMED if suits(n, topology) and plan in plans_for(n) and n != "tilting-tripod"]
        count = 3 if len(out) % 3 == 2 else 2
        names = tuple(str(n) for n in rng.permutation(fit)[:count])
        noise = str(rng.choice(["white", "tracker", "coloured"]))
        out.append(Spec("", "mixture", topology, plan, noise, names, (22.0, 60.0)))
    return out


def _pairs(rng: np.random.Generator) -> list[Spec]:
    out = []
    for k, pair in enumerate(PAIRS):
        fit = [t for t in MACHINES if all(suits(e, t) for e in pair)] or [t for t in MACHINES if suits(pair[0], t)]
        both = [p for p in plans_for(pair[0]) if p in plans_for(pair[1]) and p not in ("large", "poor")]
        topology = str(rng.choice(fit))
        plan = walkable(str(rng.choice(both)), topology)
        halves = [effect for effect in pair if suits(effect, topology)]
        out += [Spec("", "pair", topology, plan, "white", (e,), (20.0, 60.0), seed=5000 + k) for e in halves]
    return out


def _unnamed(rng: np.random.Generator) -> list[Spec]:
    out = []
    for k in range(3):
        for name in UNNAMED:
            fit = [t for t in MACHINES if suits(name, t)]
            noise = str(rng.choice(["white", "tracker", "coloured"]))
            plan, topology = str(rng.choice(["random", "rows"])), str(rng.choice(fit))
            out.append(Spec("", "unnamed", topology, plan, noise, (name,), (18.0, 60.0), order=2 + (k == 2)))
    return out


def _unseen() -> list[Spec]:
    out = []
    straight = ("c-frame-mill", "bridge-cmm", "moving-column", "dual-gantry")
    for k in range(20):
        effect = list(UNSEEN)[k % len(UNSEEN)]
        _, plan = UNSEEN[effect]
        topology = straight[(k + k // 4) % 4]
        noise = ("white", "tracker", "coloured")[k % 3]
        out.append(Spec("", "unseen", topology, plan, noise, (effect,), order=2 + k % 2))
    return out


def _blunders() -> list[Spec]:
    kinds = ("outliers", "sign", "dead", "swap", "outliers", "unit", "dead", "sign", "outliers", "sign")
    topologies = list(MACHINES)
    return [Spec("", "blunder", topologies[(3 * k) % 10], "random", "white", blunder=b) for k, b in enumerate(kinds)]
