"""Files of surveys of one machine."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd

from errormodel.chain import Chain
from errormodel.machine import Joint, Machine, Shape

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
MACHINE = Machine(
    name="mill with a rotary table",
    elements=(
        Joint("B", "rotary", Y, (0.0, 2 * math.pi)),
        Shape("T1", (0.0, 0.0, 100.0)),
        Joint("X", "prismatic", X, (-500.0, 500.0)),
        Joint("Y", "prismatic", Y, (0.0, 600.0)),
        Joint("Z", "prismatic", Z, (200.0, 900.0)),
    ),
    tool=(1.0, 2.0, -150.0),
)
JOINTS = ("B", "X", "Y", "Z")


def poses(n: int = 40, machine: Machine = MACHINE, seed: int = 1) -> pd.DataFrame:
    """Commands over the travels (mm, deg) with measured positions in a turned and shifted frame (mm)."""
    rng = np.random.default_rng(seed)
    commands = {j.name: rng.uniform(*j.travel, n) for j in machine.joints}
    rows = [*commands.values(), *(np.full(n, v) for v in machine.tool)]
    points = Chain(machine).kernel("nominal", outputs=(0, 1, 2))(rows).T
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    points = points @ turn.T + [3000.0, -200.0, 50.0] + rng.normal(0, 0.01, (n, 3))
    frame = pd.DataFrame(
        {j.name: np.rad2deg(commands[j.name]) if j.type == "rotary" else commands[j.name] for j in machine.joints}
    )
    frame[["mx", "my", "mz"]] = points
    return frame


def write(folder: Path, text: str, name: str = "s.csv") -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def yaml(folder: Path, extra: str = "", files: str = "[{path: s.csv}]") -> Path:
    return write(folder, f"errormodel: 1\nfiles: {files}\n{extra}\n", "survey.yaml")
