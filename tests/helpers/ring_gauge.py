"""A simulated ring gauge compensated by `errormodel thermal` and as the paper does it."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from errormodel.arrays import Array
from errormodel.chain import TOOL_CHANNELS, Chain
from errormodel.conventions import MOTIONS
from errormodel.machine import Machine
from errormodel.survey import read_survey
from identification.results.analysis import Analysis
from identification.thermal_drift.drift_model import Thermal, thermal
from identification.thermal_drift.stepwise import stepwise
from identification.uncertainty.prediction import predict
from tests.helpers import thermal_cmm as cmm

SURVEY = (
    "errormodel: 1\nframe: fixed\nfiles:\n- {path: at_20.csv}\n- {path: drift.csv}\n- {path: other.csv, role: test}\n"
)


def thermal_model(machine: Machine, seed: int) -> Thermal:
    """The model of a simulated calibration at 20 degC, drift recordings, and another cycle."""
    tables = {"at_20": cmm.calibration(seed), "drift": cmm.drift_recordings(seed), "other": cmm.other_cycle(seed)}
    with tempfile.TemporaryDirectory() as folder:
        for name, table in tables.items():
            table.to_csv(Path(folder) / f"{name}.csv", index=False)
        (Path(folder) / "survey.yaml").write_text(SURVEY)
        return thermal(machine, read_survey(folder, machine))


def by_lags(result: Thermal, table: pd.DataFrame) -> Array:
    """Volumetric error (n, 3) in mm that `predict` gives for readings and their log of temperatures."""
    machine = result.fit.chain.machine
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ring.csv"
        table.drop(columns=["place", "ring"]).to_csv(path, index=False)
        said = predict(Analysis(result.fit).stored, read_survey(path, machine, measured=False))
    return said[["ex", "ey", "ez"]].to_numpy()


def by_regressions(result: Thermal, table: pd.DataFrame) -> Array:
    """The same with the geometry at 20 degC and, for the rest, regressions at each position."""
    errors = by_lags(result, table.assign(**dict.fromkeys(cmm.NAMES, 20.0)))
    taken, machine = result.recordings, result.fit.chain.machine
    sensors, chain = list(taken.sensors), Chain(machine)
    tool = dict(zip(TOOL_CHANNELS, machine.tool, strict=True))
    kernel = chain.kernel("levers", outputs=(0, 1, 2))
    arms = kernel(chain.columns(table.assign(**tool)), np.zeros(len(chain.ids))).reshape(-1, 6, 3, len(table))
    for own in taken.fit:
        found = stepwise(own.position, own.values, taken.survey.table[sensors].to_numpy()[own.rows])
        drift = found.predict(table[own.joint].to_numpy(), table[sensors].to_numpy())
        arm = arms[chain.element_names.index(own.joint), MOTIONS.index(own.motion)]
        errors = errors + (arm * drift).T
    return errors


def ring_errors(result: Thermal, seed: int, level: float) -> pd.DataFrame:
    """Measured minus true diameter, um, at each place: ``measured``, and compensated by ``regressions``, by ``lags``.

    True is what the ring has at its own temperature.
    """
    table = cmm.ring(seed, level)
    readings = table[["X", "Y", "Z"]].to_numpy()
    corrected = {
        "measured": readings,
        "regressions": readings + by_regressions(result, table),
        "lags": readings + by_lags(result, table),
    }
    out = []
    for place in range(1, len(cmm.PLACES) + 1):
        here = (table["place"] == place).to_numpy()
        true = cmm.RING * (1 + cmm.STEEL * (table["ring"][here].mean() - 20))
        errors = {name: 1e3 * (cmm.diameter(points[here]) - true) for name, points in corrected.items()}
        out.append({"place": place, "degC": 20 + level, **errors})
    return pd.DataFrame(out)
