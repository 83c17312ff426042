"""Surveys of machines whose errors are known, without files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from errormodel.chain import Chain
from errormodel.instruments.base import Instrument
from errormodel.instruments.plain import Plain
from errormodel.machine import Machine, Vector
from errormodel.simulation import measured_at, random_points
from errormodel.survey import Survey
from errormodel.truth import Truth
from identification.estimation.result import Fit
from identification.results.analysis import Analysis
from identification.results.stored_fit import StoredFit
from identification.uncertainty.prediction import predict
from tests.helpers.chains import Array

OBLIQUE = np.array([0.48, 0.6, 0.64])
FAR = (1500.0, -1200.0, 550.0)  # 2 m
TURNED = tuple(Rotation.from_rotvec(np.radians(60) * OBLIQUE).as_euler("XYZ").tolist())


def measured(
    machine: Machine,
    p: Array,
    n: int = 200,
    seed: int = 0,
    noise: float | Instrument = 0.0,
    tools: tuple[Vector, ...] = (),
    frame: tuple[Any, Any] = (FAR, TURNED),
    points: pd.DataFrame | None = None,
    **more: Any,
) -> pd.DataFrame:
    """A survey's table: random poses (or `points`), exact positions and orientations, noise on the positions."""
    table = random_points(machine, n, seed) if points is None else points.copy()
    if tools:
        table[["tool_x", "tool_y", "tool_z"]] = np.resize(np.array(tools), (len(table), 3))
    values = dict(zip(Chain(machine).ids, p.tolist(), strict=True))
    seen = measured_at(machine, table, Truth(values, *frame), noise, seed)
    labels = {"run": "1", "file": "a.csv", "role": "fit", **more}
    return pd.concat([table, seen], axis=1).assign(**labels, row=np.arange(1, len(table) + 1))


def positions(table: pd.DataFrame) -> pd.DataFrame:
    return table.drop(columns=["mrx", "mry", "mrz"])


def survey(*tables: pd.DataFrame, frame: str = "shared", instrument: Instrument | None = None, **more: Any) -> Survey:
    table = pd.concat(tables, ignore_index=True)
    given: Mapping[str, Any] = {"refit": ("frame",), "source": Path("survey.yaml"), **more}
    return Survey(table, frame, instrument=instrument or Plain(type="plain"), **given)  # type: ignore[arg-type]


def rms(gap: Array) -> float:
    """Of vectors (n, 3) in mm, um."""
    return float(1e3 * np.sqrt(np.mean(np.sum(np.square(gap), axis=1))))


def stored(fit: Fit) -> StoredFit:
    """What prediction needs of a fit."""
    return Analysis(fit).stored


def prediction_error(fit: Fit, p: Array, seed: int = 99, **how: object) -> float:
    """Error of predictions at fresh poses, um."""
    return prediction_of(fit, measured(fit.chain.machine, p, 100, seed, **how))  # type: ignore[arg-type]


def prediction_of(fit: Fit, fresh: pd.DataFrame) -> float:
    """Error of predictions where the truth is known, um."""
    out = predict(stored(fit), survey(fresh))
    return rms((out[["mx", "my", "mz"]] - fresh[["mx", "my", "mz"]]).to_numpy())
