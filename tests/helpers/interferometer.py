"""Records of error motions as instruments on a machine write them, made without the tool: targets to and fro with
overrun (ISO 230-2), each run from a zero of its own, in micrometres or microradians."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Array = NDArray[np.float64]
Motion = Callable[[Array, Array, Array, Array], Array]
"""An error motion (um, urad) of positions, sides of arrival, times (s) and temperatures (degC)."""

MILL = """errormodel: 1
name: Mill
chain:
  - {joint: X, type: prismatic, axis: x, travel: [0, 600]}
  - {shape: saddle}
  - {joint: Y, type: prismatic, axis: y, travel: [0, 450]}
  - {shape: column, offset: [0, 500, 300]}
  - {joint: Z, type: prismatic, axis: z, travel: [0, 400]}
  - {shape: head, offset: [0, -500, -250]}
  - {joint: C, type: rotary, axis: z, travel: [0, 360]}
tool: [0, 0, -120]
errors:
  shapes: all
  joints: {X: {spline: 4}, Y: {polynomial: 3}, Z: first-order, C: {harmonic: 2}}
"""


def targets(low: float, high: float, count: int, rng: np.random.Generator, scatter: float = 0.3) -> Array:
    """Target positions with random parts of the interval, so that no period hides between them."""
    q = np.linspace(low, high, count)
    q[1:-1] += rng.uniform(-scatter, scatter, count - 2) * (q[1] - q[0])
    return np.round(q, 2)


def passes(q: Array, runs: int, both: bool = True) -> tuple[Array, Array, Array]:
    """Positions, sides of arrival and numbers of the cycles of a test."""
    there = [(x, 1.0) for x in q]
    back = [(x, -1.0) for x in q[::-1]] if both else []
    rows = [(x, s, float(k)) for k in range(1, runs + 1) for x, s in (*there, *back)]
    a = np.array(rows)
    return a[:, 0], a[:, 1], a[:, 2]


def record(
    joint: str,
    motions: dict[str, Motion],
    q: Array,
    rng: np.random.Generator,
    *,
    runs: int = 5,
    both: bool = True,
    noise: float = 0.4,
    zeros: float = 30.0,
    step: float = 0.0,
    pause: float = 12.0,
    warm: float = 0.0,
    columns: Sequence[str] = ("run", "time", "T_bed"),
) -> pd.DataFrame:
    """A table in um and urad; `step` is what the instrument displays, `warm` the rise of the bed in K."""
    position, side, run = passes(q, runs, both)
    time = pause * np.arange(1.0, len(position) + 1)
    bed = 20.0 + warm * np.sin(0.8 * np.pi * time / time[-1])
    table: dict[str, Any] = {"joint": joint, joint: position}
    for name, motion in motions.items():
        zero = rng.normal(0, zeros, runs + 1)[run.astype(int)] if "run" in columns else rng.normal(0, zeros)
        read = motion(position, side, time, bed) + zero + rng.normal(0, noise, len(position))
        table[name] = np.round(read / step) * step if step else read
    extra = {"run": run.astype(int), "time": time, "T_bed": np.round(bed, 2), f"dir_{joint}": side.astype(int)}
    return pd.DataFrame(table | {c: extra[c] for c in columns})
