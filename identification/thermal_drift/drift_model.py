"""Thermal model of a machine from drift recordings, validated on another thermal cycle.

Each error motion is regressed on a few lagged temperatures times polynomials of the position; the result is a machine
with drift effects, fitted jointly. Units: mm, rad, K, s.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from errormodel.arrays import Array
from errormodel.channels import columns
from errormodel.conventions import Motion, iso_symbol
from errormodel.effects.shared import warmth
from errormodel.effects.structure_drift import StructureDrift
from errormodel.effects.travel import polynomials, scaled
from errormodel.exceptions import InputError
from errormodel.machine import Machine, joint_of
from errormodel.simulation import measured_at
from errormodel.survey import Survey
from errormodel.truth import Truth
from identification.estimation.fit import fit_machine
from identification.estimation.result import Fit
from identification.runtime.progress import Progress, silent
from identification.thermal_drift.recordings import Drift, Recordings, recordings
from identification.thermal_drift.selection import centred, choose
from identification.thermal_drift.stepwise import stepwise

# Time constants of the lags, s: shortest, ratio and longest of a geometric series; zero lag is tried as well. By
# judgement: minutes for a spindle or screw to hours for a casting
SHORTEST_LAG_S, LAG_FACTOR, LONGEST_LAG_S = 300.0, 1.6, 14400.0
MOST_TRAVEL_ORDER = 2  # largest order of the polynomial along the travel, by judgement


@dataclass(frozen=True)
class Follows:
    """A temperature that an error motion follows: sensor, lag (s), order of the polynomial along the travel."""

    sensor: str
    tau: float
    order: int


@dataclass(frozen=True)
class MotionResult:
    """Drift of one error motion and its prediction in the test cycle.

    Root mean squares are in mm or rad, after subtraction of each recording's mean.

    Attributes
    ----------
    follows : temperatures in the model, in the order of their selection.
    positions : of the recordings to fit, mm or rad.
    drift : rms of the readings, without a model.
    stepwise : rms residual of stepwise regression on temperatures at each position.
    stepwise_r2 : smallest coefficient of determination of these regressions on their own data.
    lagged : rms residual of the fitted model.
    noise : standard deviation of one reading, the lower limit of any residual.
    rows : number of test readings.
    """

    joint: str
    motion: Motion
    symbol: str
    follows: tuple[Follows, ...]
    positions: tuple[float, ...]
    drift: float
    stepwise: float
    stepwise_r2: float
    lagged: float
    noise: float
    rows: int


@dataclass(frozen=True)
class Thermal:
    """Result of the thermal identification.

    Attributes
    ----------
    recordings : as used.
    motions : result of each error motion.
    fit : fit of the machine with its drift effects.
    predicted : for each test drift the values (n,) of the lagged model and of the stepwise regression, mm or rad.
    """

    recordings: Recordings
    motions: tuple[MotionResult, ...]
    fit: Fit
    predicted: tuple[tuple[Array, Array], ...]

    @property
    def left_beyond(self) -> tuple[float, float]:
        """Residual beyond the noise, in units of the noise, rms over all error motions: stepwise, lagged."""
        left = np.array([(m.stepwise / m.noise, m.lagged / m.noise) for m in self.motions])
        stepwise, lagged = np.sqrt(np.mean(np.maximum(left**2 - 1, 0), axis=0)).tolist()
        return stepwise, lagged

    def as_json(self) -> dict[str, Any]:
        """The content of ``thermal.json``: mm, rad, s."""
        r = self.recordings
        return {
            "schema": "errormodel.thermal/1",
            "machine": self.fit.chain.machine.name,
            "survey": r.survey.name,
            "groups": [list(g) for g in r.groups],
            "left_out": r.left_out,
            "motions": [asdict(m) for m in self.motions],
            "notes": list(r.notes),
        }


def thermal(machine: Machine, survey: Survey, progress: Progress = silent) -> Thermal:
    """Select temperatures and lags for each recorded error motion, fit the machine, and validate on the test cycle.

    Raises
    ------
    InputError
        The recordings are not usable (`identification.thermal_drift.recordings`), or the machine has a thermal model
        already.
    """
    if any(e.effect == StructureDrift.effect and e.options.get("std") for e in machine.effects):
        found = f"{StructureDrift.effect} with std: the machine has a thermal model already"
        raise InputError(f"{machine.source}, key effects", found, "Start from the machine without it")
    with progress("Reading the recordings"):
        taken = recordings(machine, survey)
        pairs = list(zip(taken.fit, taken.test, strict=True))
    with progress("Choosing temperatures and lags"):
        effects = _followed(machine, taken)
    with progress("Fitting the machine with them"):
        specs = (e.spec for own in effects for e in own)
        fit = fit_machine(replace(machine, effects=(*machine.effects, *specs)), _without_test_drifts(taken))
    with progress("Judging by the other cycle"):
        said = _by_model(fit, taken)
        usual = [_by_regression(taken, *pair) for pair in pairs]
    motions = tuple(map(_judged, pairs, effects, said, usual))
    return Thermal(taken, motions, fit, tuple(zip(said, (values for values, _ in usual), strict=True)))


def _without_test_drifts(taken: Recordings) -> Survey:
    """The survey without error motions of test files, which are evaluated here."""
    table = taken.survey.table
    return taken.survey.rows(((table["role"] == "fit") | (table["joint"] == "")).to_numpy(dtype=bool))


def _followed(machine: Machine, taken: Recordings) -> list[list[StructureDrift]]:
    """Drift effects of each error motion, one for each selected temperature."""
    table = taken.survey.table
    candidates = [(s, tau) for s in taken.sensors for tau in (0.0, *_lags(taken))]
    warm = np.column_stack([warmth(lambda name: columns(table, [name])[0], s, None, tau) for s, tau in candidates])
    out = []
    for drift in taken.fit:
        joint = joint_of(machine, drift.joint)
        u = scaled(joint, drift.position)
        shapes = np.column_stack(np.broadcast_arrays(*polynomials(MOST_TRAVEL_ORDER, u)))
        most = min(MOST_TRAVEL_ORDER, len(np.unique(drift.position)) - 1)
        tried = warm[drift.rows][:, :, None] * shapes[:, None, :]
        choice = choose(tried, drift.values, drift.series, most, drift.noise)
        own = [(*candidates[k], order) for k, order in choice.picked]
        std = float(f"{choice.width:.3g}")
        out.append(
            [
                StructureDrift(element=joint.name, motion=drift.motion, sensor=sensor, tau=tau, order=order, std=std)
                for sensor, tau, order in own
            ]
        )
    return out


def _lags(taken: Recordings) -> list[float]:
    """Time constants to try, s: geometric series up to the length of the longest recording."""
    longest = max(float(np.ptp(part["time"])) for _, part in taken.survey.fit.table.groupby(["file", "run"]))
    count = 1 + int(max(np.log(min(LONGEST_LAG_S, longest) / SHORTEST_LAG_S) / np.log(LAG_FACTOR), 0.0))
    return [float(f"{SHORTEST_LAG_S * LAG_FACTOR**k:.4g}") for k in range(count)]


def _by_model(fit: Fit, taken: Recordings) -> list[Array]:
    """Prediction (n,) of each test drift by the fitted machine, mm or rad."""
    named = fit.solution.named()
    truth = Truth({i: named[i] for i in fit.chain.machine_ids})
    said = measured_at(fit.chain.machine, taken.survey.table, truth)
    return [said[d.motion].to_numpy(dtype=np.float64)[d.rows] for d in taken.test]


def _by_regression(taken: Recordings, fit: Drift, test: Drift) -> tuple[Array, float]:
    """Prediction (n,) of a test drift by stepwise regression, and the smallest R^2 on the data that were fitted."""
    raw = taken.survey.table[list(taken.sensors)].to_numpy(dtype=np.float64)
    found = stepwise(fit.position, fit.values, raw[fit.rows])
    return found.predict(test.position, raw[test.rows]), float(found.r2.min())


def _judged(
    pair: tuple[Drift, Drift], effects: list[StructureDrift], said: Array, usual: tuple[Array, float]
) -> MotionResult:
    """Result of one error motion: residuals of model and regression in the test cycle."""
    fit, test = pair
    values, r2 = usual

    def rms(gap: Array) -> float:
        return float(np.sqrt(np.mean(np.square(centred(gap, test.series)))))

    return MotionResult(
        test.joint,
        test.motion,
        iso_symbol(test.joint, test.motion),
        tuple(Follows(e.sensor, e.tau, e.order) for e in effects),
        tuple(np.unique(fit.position).tolist()),
        rms(test.values),
        rms(test.values - values),
        r2,
        rms(test.values - said),
        test.noise,
        len(test.rows),
    )
