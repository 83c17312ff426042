"""Linear models of three axes at random commands, with noise and an error that no parameter describes."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from errormodel.conventions import FRAME
from identification.diagnosis.linear.linear_model import LinearModel
from identification.estimation.noise import Noise
from identification.estimation.orthonormal_basis import orthonormal_basis
from tests.helpers.chains import Array
from tests.helpers.correlated_noise import drawn

ROWS = 240
Rng = np.random.Generator
NOISES: dict[str, Callable[[Rng], Array]] = {
    "white": lambda rng: rng.normal(size=3 * ROWS),
    "heavy tails": lambda rng: rng.standard_t(2, 3 * ROWS),
    "correlated": lambda rng: drawn(Noise(6.0, 1.5), rng, ROWS, 3),
    "drifting": lambda rng: drawn(Noise(60.0, 6.0), rng, ROWS, 3),
    "large at one end": lambda rng: rng.normal(size=3 * ROWS) * np.tile(np.linspace(0.3, 2, ROWS), 3),
}


def linear(error: Callable[[dict[str, Array]], Array], noise: Array, rng: Rng, tilts: bool = False) -> LinearModel:
    """Positions of three axes at random commands; `error` moves all along x, on top of fitted parabolas.

    With `tilts` it turns all about Y instead, which moves x by the height.
    """
    columns: dict[str, Array] = {name: rng.uniform(-1, 1, ROWS) for name in "XYZ"}
    columns |= {f"dir_{n}": np.sign(np.diff(columns[n], prepend=0.0)) for n in "XYZ"}
    columns |= {"time": np.arange(ROWS) * 20.0, "T_air": np.cumsum(rng.normal(0, 0.05, ROWS)) + 20}
    scene: Any = SimpleNamespace(columns=columns, moving=[SimpleNamespace(name=n, type="prismatic") for n in "XYZ"])
    shift = np.zeros((3, ROWS))
    shift[0] = error(columns) * (columns["Z"] if tilts else 1.0)
    smooth = np.vstack([np.ones(ROWS), *(columns[n] ** k for n in "XYZ" for k in (1, 2))])
    basis = orthonormal_basis(np.kron(np.eye(3), smooth.T))
    data = noise + shift.ravel()
    levers = {FRAME: np.vstack([np.kron(row, np.ones(ROWS)) for row in np.eye(6, 3)])}
    turn = np.concatenate([columns["Z"], np.zeros(ROWS), -columns["X"]])
    levers |= {n: np.vstack([levers[FRAME][:3], np.zeros((1, 3 * ROWS)), turn, np.zeros((1, 3 * ROWS))]) for n in "YZ"}
    index = np.tile(np.arange(ROWS), 3)
    return LinearModel(None, data - basis @ (basis.T @ data), basis, levers, {}, index, scene)  # type: ignore[arg-type]


def nothing(columns: dict[str, Array]) -> Array:
    return np.zeros(ROWS)
