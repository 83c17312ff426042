"""Records of error motions as instruments on a machine write them, made without the tool: targets to and fro with
overrun (ISO 230-2), each run from a zero of its own, in micrometres or microradians."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from errormodel.machine_file import read_machine
from errormodel.survey import read_survey
from identification.estimation.fit import fit_machine
from identification.results.store import save

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


UNITS = {"d": "um", "e": "urad"}


def screw(q: Array, side: Array, time: Array, bed: Array) -> Array:
    """Positioning of X, um: 20 um/m and a bow."""
    return 0.02 * q + 4 * np.sin(q / 150)


def play(um: float, motion: Motion = screw) -> Motion:
    """A motion with so much backlash."""
    return lambda q, side, time, bed: motion(q, side, time, bed) + um / 2 * side


def written(folder: Path, table: pd.DataFrame, **more: str) -> Path:
    """A survey.yaml beside the table, with the units of its deviations."""
    table.to_csv(folder / "data.csv", index=False)
    units = {c: UNITS[c[0]] for c in table if c in ("dx", "dy", "dz", "ea", "eb", "ec")} | more
    text = ", ".join(f"{k}: {v}" for k, v in units.items())
    path = folder / "survey.yaml"
    path.write_text(f"errormodel: 1\nfiles: [{{path: data.csv}}]\nunits: {{{text}}}\n")
    return path


def positioning(backlash: float = 0.0, seed: int = 1, joint: str = "X", **more: object) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    end = {"X": 580.0, "Y": 440.0, "Z": 390.0}[joint]
    motion = {"X": "dx", "Y": "dy", "Z": "dz"}[joint]
    return record(joint, {motion: play(backlash)}, targets(20, end, 11, rng), rng, **more)  # type: ignore[arg-type]


def fitted(folder: Path, mill: Path, table: pd.DataFrame, effects: str = "") -> Path:
    """The folder of a fit of the mill, whose file is written to `mill`, to a table."""
    mill.write_text(MILL + effects)
    machine = read_machine(str(mill))
    save(fit_machine(machine, read_survey(written(folder, table), machine)), folder / "fit")
    return folder / "fit"
