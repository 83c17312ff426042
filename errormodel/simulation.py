"""Simulated surveys of a machine with known errors: exact kinematics, a measuring frame and the instrument's noise.

Units: mm and rad.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from errormodel.arrays import Array, as_rows
from errormodel.chain import TOOL_CHANNELS, Chain
from errormodel.channels import run_of
from errormodel.conventions import MOTIONS
from errormodel.exceptions import InputError, nearest
from errormodel.instruments.base import Instrument
from errormodel.machine import Machine, Vector
from errormodel.path_speed import RATE_CHANNEL
from errormodel.surveys.columns import MEASURED, ORIENTATION, first_pose
from errormodel.truth import Truth, read_truth, wrong_with

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.survey import Survey


def measured_at(
    machine: Machine, points: pd.DataFrame, truth: Truth, noise: float | Instrument = 0.0, seed: int = 0
) -> pd.DataFrame:
    """Measured points and orientations at given commands, with noise.

    Parameters
    ----------
    machine : Machine
    points : DataFrame
        Table of a :class:`~errormodel.survey.Survey` (joints and tool in mm and rad).
    truth : Truth
        Parameter values and measuring frame.
    noise : float or Instrument
        Standard deviation of each coordinate in mm, or an instrument.
    seed : int
        Of the random numbers.

    Returns
    -------
    DataFrame
        ``mx my mz`` in mm and ``mrx mry mrz`` (rotation vector, rad, without noise), in the measuring frame. They are
        NaN in rows about one joint's error motions, which have ``dx dy dz ea eb ec`` (mm, rad, without noise).
    """
    import pandas as pd
    from scipy.spatial.transform import Rotation

    chain = Chain(machine)
    rows, values = chain.columns(points), chain.vector(truth.parameters)
    about = points["joint"].to_numpy(dtype=object) if "joint" in points else np.full(len(points), "", dtype=object)
    whole = np.flatnonzero(about == "")
    pose = chain.kernel("actual")(as_rows(*(row[whole] for row in rows)), values)
    frame = Rotation.from_euler("XYZ", truth.rotation)
    measured, turned = np.zeros((0, 3)), np.zeros((0, 3))
    if len(whole):  # SciPy 1.15 has no rotation of no rows
        measured = frame.apply(pose[:3].T) + np.array(truth.translation)
        turned = (frame * Rotation.from_matrix(pose[3:].reshape(3, 3, -1).transpose(2, 1, 0))).as_rotvec()
    rng = np.random.default_rng(seed)
    if isinstance(noise, Instrument):
        measured = measured + noise.draw_noise(measured, rng)
    elif noise:
        measured = measured + rng.normal(0.0, noise, measured.shape)
    table = np.hstack([measured, turned])
    seen = pd.DataFrame(table, columns=[*MEASURED, *ORIENTATION], index=points.index[whole]).reindex(points.index)
    for name in dict.fromkeys(about[about != ""]):
        here = np.flatnonzero(about == name)
        motions = _motions(chain, name, as_rows(*(np.nan_to_num(row[here]) for row in rows)), values)
        seen.loc[points.index[here], list(MOTIONS)] = motions.T
    return seen


def _motions(chain: Chain, joint: str, rows: list[Array], values: Array) -> Array:
    """Six error motions of a joint, (6, n) in mm and rad."""
    own = [k for k, p in enumerate(chain.parameters) if p.element == joint]
    terms = chain.kernel("terms", tuple(chain.ids[k] for k in own))(rows).reshape(len(own) + 6, 6, -1)
    motions: Array = np.tensordot(values[own], terms[: len(own)], axes=1)
    return motions


def random_points(machine: Machine, count: int, seed: int = 0) -> pd.DataFrame:
    """Random poses, uniform over the travels, with the machine's tool; mm and rad."""
    import pandas as pd

    rng = np.random.default_rng(seed)
    columns: dict[str, Array] = {j.name: rng.uniform(*j.travel, count) for j in machine.joints}
    columns |= {name: np.full(count, value) for name, value in zip(TOOL_CHANNELS, machine.tool, strict=True)}
    return pd.DataFrame(columns)


def _runs_without_commands(chain: Chain, table: pd.DataFrame) -> tuple[str, ...]:
    """A sentence on each run that an effect goes with and no command is of."""
    runs = {*table["run"].astype(str)} if "run" in table else set[str]()
    own = dict.fromkeys(filter(None, map(run_of, chain.channels)))
    return tuple(
        f"no command is of run {run}: what the machine does in that run alone is zero here. Name the run of each "
        "command in a column run to have it"
        for run in own
        if run not in runs
    )


def _degrees(angles: Array) -> Array:
    """Angles (rad) in degrees, with the fewest digits that give the same angle: 30 and not 29.999999999999996."""
    degrees: Array = np.degrees(angles)
    short = np.round(degrees, 10)
    return np.where(np.isclose(np.radians(short), angles, rtol=1e-15, atol=0), short, degrees)


def outward(table: pd.DataFrame, machine: Machine) -> pd.DataFrame:
    """Table of commands in the units of a file: rotary joints in degrees."""
    table = table.copy()
    for name in (n for j in machine.joints if j.type == "rotary" for n in (j.name, first_pose(j.name))):
        if name in table:
            table[name] = _degrees(table[name].to_numpy(dtype=np.float64))
    return table


def simulate(
    machine: Machine | str | Path | Mapping[str, Any],
    points: int | str | Path | pd.DataFrame | Survey,
    parameters: Mapping[str, float] | str | Path | None = None,
    *,
    translation: Vector = (0.0, 0.0, 0.0),
    rotation: Vector = (0.0, 0.0, 0.0),
    noise: float | Instrument | Literal["instrument"] = 0.0,
    observations: Mapping[str, Mapping[str, float]] | None = None,
    seed: int = 0,
) -> pd.DataFrame:
    """Simulate a survey of a machine whose errors are known, in exact (finite) kinematics.

    Parameters
    ----------
    machine : Machine, str, Path or dict
    points : int, str, Path, DataFrame or Survey
        So many random poses over the travels, or the commands of a survey.
    parameters : dict, str, Path or None
        ``{id: value}`` in mm, rad and their ratios, or a file with ``parameters:`` and ``frame:``.
    translation, rotation : (3,)
        Measuring frame, mm and degrees (``Rx Ry Rz``): ``measured = rotation @ actual + translation``.
    noise : float, Instrument or "instrument"
        Standard deviation of each coordinate in mm; or an instrument; or that of the survey given as `points`.
    observations : dict or None
        Unknown numbers of set-ups by observation, such as ``{"A": {"x": 900, "y": 0, "z": 0}}``, mm and rad, where
        `parameters` is no file that states them.
    seed : int
        Of the random poses and the noise.

    Returns
    -------
    DataFrame
        Commands (mm, degrees) and ``mx my mz`` (mm), a survey that `identification.fit` takes. Rows of an observation
        have its reading (``length`` in mm, ``angle`` in rad) and no position. ``attrs["notes"]``: sentences on runs of
        which no command is.

    Raises
    ------
    InputError
        The machine, the commands or a parameter's id cannot be read.

    Examples
    --------
    >>> from errormodel import simulate
    >>> simulate("vertical_three_axis", 3, {"X.dx.1": 0.02}).shape[0]
    3
    """
    from errormodel.effects.axis_blunder import marred
    from errormodel.instruments.plain import Plain
    from errormodel.machine_file import read_machine
    from errormodel.simulation_readings import readings_at
    from errormodel.survey import Survey, read_survey
    from errormodel.surveys.observations import observed

    model = machine if isinstance(machine, Machine) else read_machine(machine)
    survey: Survey | None = None
    if isinstance(points, int):
        table = random_points(model, points, seed)
    else:
        survey = points if isinstance(points, Survey) else read_survey(points, model, measured=False)
        table = survey.table
    instrument: Instrument = Plain() if survey is None else survey.instrument
    entries = {} if survey is None else survey.observations
    if noise == "instrument" and not instrument.stated and not entries:
        cure = "Add `instrument:` with its uncertainties to survey.yaml, or give a standard deviation in mm"
        raise InputError("noise", "the survey names no instrument with uncertainties", cure)
    chain = Chain(model)
    if survey is None and "time" not in chain.channels and any(map(RATE_CHANNEL.fullmatch, chain.channels)):
        table = table.assign(time=0.0)  # random poses are measured at rest
    if isinstance(parameters, str | Path):
        truth = read_truth(Path(parameters), chain)
    else:
        for identity, value in (parameters or {}).items():
            if wrong := wrong_with(identity, value, chain):
                raise InputError(f"parameters, {identity}", *wrong)
        a, b, c = np.radians(rotation).tolist()
        truth = Truth(parameters or {}, translation, (a, b, c), observations or {})
    if unknown := [label for label in truth.set_ups if label not in entries]:
        found = f"no observation '{unknown[0]}' in the survey"
        raise InputError("parameters, observations", found, nearest(unknown[0], entries))
    measured = measured_at(model, table, truth, instrument if noise == "instrument" else noise, seed)
    # simulated orientations have no noise, unlike measured ones: those of the survey are removed without replacement
    stale = ["file", "role", "row", *ORIENTATION]
    result = table.drop(columns=stale, errors="ignore")
    for name in measured.columns.difference(stale, sort=False):
        result[name] = measured[name]
    if survey is not None and entries:
        rng = np.random.default_rng([seed, 1])
        level = noise if isinstance(noise, str | int | float) else 0.0
        read = readings_at(chain, table, entries, truth, survey.frame == "fixed", level, rng)
        own = observed(table) != ""
        result.loc[own, list(MEASURED)] = np.nan
        result = result.assign(**read)
        if own.all():  # nothing but readings
            result = result.drop(columns=list(MEASURED))
    out = outward(marred(result, model), model)
    out.attrs["notes"] = _runs_without_commands(chain, table)
    return out
