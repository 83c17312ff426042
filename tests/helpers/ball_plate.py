"""A calibrated ball plate of 5 x 5 balls, probed forth and back."""

from __future__ import annotations

import numpy as np
import pandas as pd


def plate(
    seed: int = 0, run: str = "plate1", time: float = 0.0, at: tuple[float, float, float] = (60.0, 60.0, 30.0)
) -> pd.DataFrame:
    """Commands as indicated (mm) by a machine that is 2e-5 too long in X, beside calibrated coordinates."""
    rng = np.random.default_rng(seed)
    steps = np.array([[40.0 * i, 40.0 * k, 0.0] for k in range(5) for i in range(5)])
    balls = (steps + np.random.default_rng(1).normal(0, 0.05, (25, 3))).round(5)
    order = [*range(25), *reversed(range(25))]
    indicated = balls[order] / [1 + 2e-5, 1, 1] + at + rng.normal(0, 4e-4, (50, 3))
    table = pd.DataFrame(indicated.round(5), columns=["X", "Y", "Z"])
    table[["mx", "my", "mz"]] = balls[order]
    return table.assign(run=run, time=time + 35.0 * np.arange(50))
