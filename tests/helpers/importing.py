"""A mill that was measured by a tracker, as the files that the tracker, the controller and a logger would leave."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from errormodel import simulate

MILL = "vertical_three_axis"
ROWS = 40
NOISE = 0.002  # mm
FRAME = {"translation": (2000, -1500, 600), "rotation": (3, -2, 40)}
TRUTH = {"X.dx.1": 0.02, "Y.dy.1": -0.01}
CLOCK = 12.345  # s that the tracker's clock is ahead of the controller's


def poses(seed: int = 5, rows: int = ROWS) -> pd.DataFrame:
    """Random poses over the travels, in mm with three decimals."""
    rng = np.random.default_rng(seed)
    low, high = np.array([-370, -200, 130]), np.array([370, 200, 620])
    return pd.DataFrame(rng.uniform(low, high, (rows, 3)).round(3), columns=["X", "Y", "Z"])


def points(commands: pd.DataFrame, seed: int = 3, noise: float = NOISE, **frame: tuple[float, ...]) -> np.ndarray:
    """What a tracker would measure there, (n, 3) mm."""
    where = FRAME | frame
    measured = simulate(MILL, commands, TRUTH, noise=noise, seed=seed, **where)  # type: ignore[arg-type]
    return measured[["mx", "my", "mz"]].to_numpy()


def spatialanalyzer(measured: np.ndarray, names: list[str] | None = None) -> str:
    """A point list of SpatialAnalyzer."""
    head = "// SpatialAnalyzer SA 2024.1  ( x64 )\n// AXES = CARTESIAN: X,  Y,  Z (mm)\n"
    names = names or [f"P{k}" for k in range(1, len(measured) + 1)]
    rows = zip(names, measured, strict=True)
    return head + "".join(f"Mill,  Main,  {name},  {x:.6f},  {y:.6f},  {z:.6f}\n" for name, (x, y, z) in rows)


def programme(commands: pd.DataFrame) -> str:
    """An NC programme that overruns each pose and waits there."""
    lines = ["%", "(measuring programme)", "G21 G90 G94 F2000", "G0 Z620"]
    for x, y, z in commands[["X", "Y", "Z"]].to_numpy():
        lines += [f"G1 X{x - 5:.3f} Y{y - 3:.3f} Z{z + 2:.3f}", f"G1 X{x:.3f} Y{y:.3f} Z{z:.3f}", "G4 P3"]
    return "\n".join([*lines, "M30", "%"]) + "\n"


def logs(folder: Path, seed: int = 7, rows: int = 20) -> pd.DataFrame:
    """``controller.csv`` (50 Hz, commanded and read back) and ``tracker.csv`` (20 Hz, a clock of its own).

    The machine follows its commands 30 ms late. Returned are the poses.
    """
    rng = np.random.default_rng(seed)
    q = poses(seed, rows).to_numpy().round(2)
    path = []
    for k in range(rows):
        if k:
            steps = int(np.abs(q[k] - q[k - 1]).max() / 100 / 0.02) + 2
            path += [q[k - 1] + a * (q[k] - q[k - 1]) for a in (1 - np.cos(np.linspace(0, np.pi, steps))) / 2]
        path += [q[k]] * (75 + int(rng.integers(0, 20)))
    told, time = np.array(path), 0.02 * np.arange(len(path))
    late = np.column_stack([np.interp(time - 0.03, time, told[:, k]) for k in range(3)])
    read = late + rng.normal(0, 5e-4, late.shape)
    names = ["X_cmd", "Y_cmd", "Z_cmd", "X_act", "Y_act", "Z_act"]
    table = pd.DataFrame(np.column_stack([told, read]).round(4), columns=names)
    table.insert(0, "t [s]", time.round(3))
    table.to_csv(folder / "controller.csv", index=False, sep=";", decimal=",")
    exact = points(pd.DataFrame(late, columns=["X", "Y", "Z"]), noise=0.0)
    when = np.arange(2.0, time[-1] - 2, 0.05)
    seen = np.column_stack([np.interp(when, time, exact[:, k]) for k in range(3)])
    seen += rng.normal(0, 0.003, seen.shape)
    pd.DataFrame(
        {"Time [s]": (when + CLOCK).round(3), **{f"{a} [m]": (seen[:, k] / 1e3).round(8) for k, a in enumerate("XYZ")}}
    ).to_csv(folder / "tracker.csv", index=False)
    return pd.DataFrame(q, columns=["X", "Y", "Z"])
