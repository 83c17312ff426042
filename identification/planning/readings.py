"""Planned poses that are read by observations (lengths, angles), with coordinates or without."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from errormodel.exceptions import InputError
from errormodel.instruments.base import Instrument
from errormodel.simulation import measured_at
from errormodel.simulation_readings import readings_at
from errormodel.surveys.columns import MEASURED, OBSERVATION, SIGMA_COLUMNS
from errormodel.surveys.observations import observed
from errormodel.truth import Truth

if TYPE_CHECKING:
    from errormodel.chain import Chain
    from errormodel.observations.base import Observation
    from errormodel.survey import Survey
    from identification.planning.setup import Setup


def read_by(chain: Chain, setup: Setup, survey: Survey, noise: Instrument | float) -> Survey:
    """The survey of planned poses with a row of each pose for each observation, and one for its coordinates if asked.

    Parameters
    ----------
    survey : of the poses' coordinates, without errors.
    noise : standard uncertainty (mm) of lengths whose observation states none.

    Raises
    ------
    InputError
        An observation is bound to certain poses, or its uncertainty or place is not known.
    """
    import pandas as pd

    for label, observation in setup.observations.items():
        _check(label, observation, noise)
    table, count = survey.table, len(survey)
    parts = [table] if setup.coordinates else []
    for label, observation in setup.observations.items():
        own = table.drop(columns=[*SIGMA_COLUMNS], errors="ignore").assign(**dict.fromkeys(MEASURED, np.nan))
        own[OBSERVATION] = label
        if observation.sigma is None:
            own[f"u_{observation.reading}"] = np.full(count, noise)
        parts.append(own)
    every = pd.concat(parts, ignore_index=True)
    # pose by pose: all readings of one before the machine moves on
    every = every.iloc[np.argsort(np.tile(np.arange(count), len(parts)), kind="stable")].reset_index(drop=True)
    every["row"] = np.arange(1, len(every) + 1)
    every[OBSERVATION] = every[OBSERVATION].fillna("")
    read = readings_at(chain, every, setup.observations, Truth({}), fixed=setup.frame == "fixed")
    return replace(survey, table=every.assign(**read), observations=setup.observations)


def with_noise(chain: Chain, setup: Setup, survey: Survey, noise: Instrument | float, seed: int) -> Survey:
    """The survey of a nominal machine with noise in what was read."""
    table, rng = survey.table, np.random.default_rng([seed, 4])
    names = list(MEASURED)
    out = readings_at(
        chain, table, setup.observations, Truth({}), fixed=setup.frame == "fixed", noise="instrument", rng=rng
    )
    if setup.coordinates:
        seen = measured_at(chain.machine, table, Truth({}), noise, seed)[names].to_numpy()
        points = (observed(table) == "")[:, None]
        out |= dict(zip(names, np.where(points, seen, np.nan).T, strict=True))
    return replace(survey, table=table.assign(**out))


def _check(label: str, observation: Observation, noise: Instrument | float) -> None:
    where = f"--setup, observations: {label}"
    if observation.poses > 1 or not observation.anywhere:
        found = f"{observation.type}, which reads a circle, a line, a face or two poses and not any one"
        cure = "Plan with observations of single poses; which circles or lines tell what: `errormodel describe`"
        raise InputError(where, found, cure)
    if observation.sigma is None and (observation.reading == "angle" or isinstance(noise, Instrument)):
        unit = "rad and 1/mm" if observation.reading == "angle" else "mm and mm/mm"
        raise InputError(where, "no standard uncertainty", f"Write sigma: [a, b] in {unit}")
