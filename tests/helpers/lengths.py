"""Readings of lengths and angles by a simulation that shares no code with the product, and surveys of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from errormodel.chain import Chain
from errormodel.instruments.plain import Plain
from errormodel.machine import Joint, Machine
from errormodel.observations import registry
from errormodel.observations.base import Observation
from errormodel.survey import Survey
from identification.estimation.result import Fit
from tests.helpers.chains import Array
from tests.proof import kinematics

# Standard deviations of the errors that are drawn, of a good machine: 10 um, 20 urad, 20 um/m, 30 nrad/mm
SIZES = {"mm": 0.01, "rad": 2e-5, "1": 2e-5, "rad/mm": 3e-8}


def twin(machine: Machine) -> kinematics.Chain:
    """The machine as the independent simulation has it; its joints have polynomial or first-order errors."""
    return kinematics.Chain(tuple(_element(e) for e in machine.elements), (tuple(machine.tool),))


def _element(e: Any) -> kinematics.Element:
    if not isinstance(e, Joint):
        return kinematics.Element(e.name, "shape", tuple(e.offset), tuple(e.rotation))
    kinds = {(b.kind, b.n) for b in e.models.values()}
    kind, order = max(kinds, key=lambda k: k[1] or 0, default=("polynomial", 1))
    return kinematics.Element(e.name, e.type, axis=tuple(e.axis), travel=e.travel, model=(kind, order or 1))


def truth(machine: Machine, rng: np.random.Generator) -> dict[str, float]:
    """Random errors of the machine, by parameter."""
    chain = Chain(machine)
    return {i: float(rng.normal(0, SIZES[chain.parameters[chain.index[i]].unit])) for i in chain.machine_ids}


def tips(machine: Machine, values: Mapping[str, float], commands: pd.DataFrame) -> Array:
    """Actual positions (n, 3) of the functional point, mm, by the independent simulation."""
    chain = twin(machine)
    q = {j.name: commands[j.name].to_numpy(dtype=float) for j in machine.joints}
    n = len(commands)
    tool = (
        np.tile(machine.tool, (n, 1)) if "tool_x" not in commands else commands[[f"tool_{a}" for a in "xyz"]].to_numpy()
    )
    return kinematics.position(chain, q, tool, kinematics.geometry(chain, q, values, n))


def commands(machine: Machine, n: int, rng: np.random.Generator) -> pd.DataFrame:
    """Random commands over the travels."""
    return pd.DataFrame({j.name: rng.uniform(*j.travel, n) for j in machine.joints})


def distances(
    machine: Machine,
    values: Mapping[str, float],
    stations: Mapping[str, tuple[Array, float]],
    n: int,
    noise: float,
    rng: np.random.Generator,
) -> pd.DataFrame:
    """Distances from stations (place, dead path) to the target at the same random commands from each, with noise."""
    at = commands(machine, n, rng)
    actual = tips(machine, values, at)
    parts = []
    for label, (place, lacking) in stations.items():
        length = np.linalg.norm(actual - place, axis=1) - lacking + rng.normal(0, noise, n)
        parts.append(at.assign(observation=label, length=length))
    return pd.concat(parts, ignore_index=True)


def entry(**keys: Any) -> Observation:
    """An entry of ``observations:``."""
    return registry()[keys["type"]](**keys)


def survey(
    machine: Machine, table: pd.DataFrame, observations: Mapping[str, Observation], frame: Any = "shared"
) -> Survey:
    """A survey of readings, as it is read from files."""
    own = table.copy()
    for name, value in zip(("tool_x", "tool_y", "tool_z"), machine.tool, strict=True):
        own[name] = own.get(name, value)
    own[["mx", "my", "mz"]] = own[["mx", "my", "mz"]] if "mx" in own else np.nan
    own = own.assign(file="a.csv", role="fit", row=np.arange(1, len(own) + 1))
    own["run"] = own["run"].astype(str) if "run" in own else "1"
    return Survey(own, frame, ("frame",), Plain(), "a.csv", observations=dict(observations))  # type: ignore[arg-type]


def standardised(fit: Fit, values: Mapping[str, float]) -> dict[str, float]:
    """Error of each group over its standard uncertainty; `values` are true parameters and set-ups by name."""
    s = fit.solution
    starts = {name: start for view in fit.problem.readings for name, start in view.starts.items()}
    std = np.sqrt(np.diag(s.covariance)) * fit.inflation
    out = {}
    for k, j in enumerate(s.groups.base):
        true = sum(c * (values[m] - starts.get(m, 0.0)) for m, c in s.groups.members(k).items() if m in values)
        out[s.unknowns[j]] = float((s.values[j] - true) / std[k])
    return out
