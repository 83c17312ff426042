"""What a concealed effect is to the simulator, and what an expert would accept as its name and place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from tests.proof.kinematics import MOTIONS, Array, Chain, Element, Motions
from tests.proof.plans import Path
from tests.proof.world import World

Rng = np.random.Generator
BOUND = {  # names that say which joint it is: that joint's own position or reversal drives it
    "backlash", "lost-motion", "hysteresis", "pitch-cyclic", "rail-waviness", "eccentricity", "wobble", "gear-cyclic",
    "servo-lag", "compensation-active", "higher-order-geometry", "local-defect", "contact-knee", "scale-expansion",
    "screw-heat", "warm-up", "ram-sag", "beam-sag", "telescoping-compliance", "thermal-bending", "joint-compliance",
}  # fmt: skip


@dataclass(frozen=True)
class Situation:
    """A machine on its path in its shop; the instrument stands at `station` (mm, in the reference's axes)."""

    chain: Chain
    path: Path
    world: World
    station: Array

    def __len__(self) -> int:
        return len(self.path)

    def share(self, joint: str) -> Array:
        """Position along the joint's travel, 0 to 1."""
        return self.chain[joint].share(self.path.q[joint])

    def now(self, history: Array) -> Array:
        """A history of the world at the rows' times."""
        return self.world.at(history, self.path.time)


Field = Callable[[Situation], Motions]
Instrument = Callable[[Situation, Array, float], Array]  # points (n, 3) as measured, amplitude -> what is read


@dataclass(frozen=True)
class Hidden:
    """A concealed effect of unit amplitude.

    `accept` are the names that count as right, `also` names that count as right where this survey cannot tell them from
    the truth (decided by the size that the difference has): experts use both for one thing. Any other name that cannot
    be told from it counts only with the truth beside it. `where` are the places by its nature, to which those are added
    that the survey cannot tell apart.
    """

    effect: str
    accept: tuple[str, ...]
    where: tuple[str, ...]
    field: Field | None = None
    instrument: Instrument | None = None
    witness: Callable[[Situation, float], Mapping[str, Array]] | None = None
    also: tuple[str, ...] = ()
    period: float | None = None
    note: str = ""
    physical: float = 1.0  # most that it can be at the tool, over what is usual on a machine of that size
    factor: float | None = None  # the tool's parameter over the amplitude, where they compare
    needs: tuple[str, ...] = ()  # plans on which it makes sense; empty: all


def motion(n: int, **parts: Array | float) -> Array:
    """A six-motion (n, 6) from its parts by name."""
    out = np.zeros((n, 6))
    for name, value in parts.items():
        out[:, MOTIONS.index(name)] = value
    return out


def along(e: Element, value: Array) -> Array:
    """Motion along (about) a joint's axis."""
    out = np.zeros((len(value), 6))
    first = 3 if e.kind == "rotary" else 0
    out[:, first : first + 3] = value[:, None] * np.array(e.axis)
    return out


def crosswise(e: Element) -> list[int]:
    """Indices of the two coordinates across a joint's axis."""
    main = int(np.argmax(np.abs(e.axis)))
    return [k for k in range(3) if k != main]


def reach(chain: Chain) -> float:
    """A usual lever, mm: to turn an angle of unit size into a displacement of unit size."""
    sizes = [float(np.linalg.norm(e.offset)) for e in chain.elements] + [e.length for e in chain.prismatic]
    return max(sizes) / 2


def pick(rng: Rng, items: tuple[Element, ...] | list[Element]) -> Element | None:
    return items[int(rng.integers(len(items)))] if len(items) else None
