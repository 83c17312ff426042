"""The five-axis machine with rotary table and quill, as plain numbers that every contender starts from.

52 parameters at first order, 32 of them independent; mm and rad. The members T1 to T5 have no nominal offset.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# name, type, axis, travel: in order from the workpiece to the tool, each followed by a member T1 ... T5
JOINTS = (
    ("B", "rotary", (0.0, 1.0, 0.0), (0.0, 2 * math.pi)),
    ("X", "prismatic", (1.0, 0.0, 0.0), (-1250.0, 1250.0)),
    ("Z", "prismatic", (0.0, 0.0, 1.0), (900.0, 2200.0)),
    ("Y", "prismatic", (0.0, 1.0, 0.0), (350.0, 2500.0)),
    ("W", "prismatic", (0.0, 0.0, 1.0), (-800.0, -200.0)),
)
TOOL = (0.0, 0.0, -312.035)
MOTIONS = ("dx", "dy", "dz", "ea", "eb", "ec")
RANK = 32


def _ids() -> tuple[str, ...]:
    ids: list[str] = []
    for place, (name, kind, axis, _) in enumerate(JOINTS, start=1):
        scale = MOTIONS[axis.index(1.0)]
        motions = MOTIONS if kind == "rotary" else (scale, *MOTIONS[3:])
        ids += [f"{name}.{motion}.1" for motion in motions]
        ids += [f"T{place}.{motion}" for motion in MOTIONS]
    return tuple(ids)


IDS = _ids()  # the order of the 52 columns


def poses(n: int, share: float = 1.0, seed: int = 1) -> Array:
    """Random commands (n, 5), uniform over the middle `share` of every travel."""
    travel = np.array([joint[3] for joint in JOINTS])
    middle, half = travel.mean(axis=1), np.diff(travel, axis=1)[:, 0] / 2
    return middle + share * half * np.random.default_rng(seed).uniform(-1, 1, (n, len(JOINTS)))


def nominal(q: Array) -> Array:
    """Nominal position of the functional point in the reference on the table, (n, 3) mm."""
    b, x, z, y, w = q.T
    s, c, depth = np.sin(b), np.cos(b), z + w + TOOL[2]
    return np.column_stack([c * x + s * depth, y, c * depth - s * x])


def parameters(seed: int = 2) -> Array:
    """Plausible true values of the 52 parameters: 20 um, 20 urad, 50 um/m, 0.02 urad/mm."""
    size = np.array([_size(identity) for identity in IDS])
    return size * np.random.default_rng(seed).standard_normal(len(IDS))


def _size(identity: str) -> float:
    element, motion = identity.split(".")[:2]
    rate = element in ("X", "Y", "Z", "W")
    return (5e-5 if rate else 0.02) if motion.startswith("d") else (2e-8 if rate else 2e-5)


def measured(q: Array, design: Array, noise: float = 0.005, seed: int = 3) -> Array:
    """Measured positions (n, 3), mm, of a machine with :func:`parameters`; `design` is M, (n, 3, 52)."""
    error = design @ parameters()
    return nominal(q) + error + noise * np.random.default_rng(seed).standard_normal((len(q), 3))
