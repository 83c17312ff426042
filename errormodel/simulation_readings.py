"""Simulated readings of observation models (lengths, angles): exact kinematics, set-ups that are stated or assumed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, rotation_matrix
from errormodel.chain import Chain
from errormodel.exceptions import InputError, nearest
from errormodel.observation_kernel import kernels_of
from errormodel.observations.base import Observation
from errormodel.surveys.columns import OBSERVATION
from errormodel.surveys.observations import Group, groups, observed
from errormodel.truth import Truth

if TYPE_CHECKING:
    import pandas as pd

SetUps = Mapping[str, Mapping[str, float]]


def readings_at(
    chain: Chain,
    table: pd.DataFrame,
    observations: Mapping[str, Observation],
    truth: Truth,
    fixed: bool = False,
    noise: float | str = 0.0,
    rng: np.random.Generator | None = None,
) -> dict[str, Array]:
    """Readings of the rows of observations, by column: ``length`` (mm) and ``angle`` (rad); NaN in other rows.

    Parameters
    ----------
    table : commands, mm and rad.
    truth : parameters, measuring frame, and unknown numbers of set-ups by observation (``set_ups``).
    fixed : whether the measuring frame is the machine's own.
    noise : standard deviation of a length, mm (an angle then has none); "instrument": as declared for each row.

    Raises
    ------
    InputError
        An unknown of a set-up has no value, or no uncertainty is declared for "instrument".
    """
    out: dict[str, Array] = {}
    rng = rng or np.random.default_rng(0)
    for group in groups(table, observations, read=False):
        observation = group.observation
        values = _quantities(chain, table, group, truth, fixed)
        rows = group.channels(chain, table)
        scalars = np.append(chain.vector(truth.parameters), values)
        exact = kernels_of(chain, observation).kernel("value")(rows, scalars)[0]
        column = out.setdefault(observation.reading, np.full(len(table), np.nan))
        column[group.index] = exact + _noise(group, exact, noise, rng)
    return out


def _noise(group: Group, exact: Array, noise: float | str, rng: np.random.Generator) -> Array:
    drawn = rng.standard_normal(len(exact))
    if isinstance(noise, str):
        declared, own = group.observation.uncertainty(exact), group.sigma
        if own is not None and np.isfinite(own).all():  # a column, or readings that are there already
            sigma: Array | None = own
        else:
            sigma = declared
        if sigma is None or not np.isfinite(sigma).all():
            found = f"the observation '{group.label}' states no standard uncertainty"
            raise InputError(
                "noise", found, "Add sigma: [a, b] to it in survey.yaml, or give a standard deviation in mm"
            )
        return np.asarray(sigma * drawn)
    return np.asarray(noise * drawn if group.observation.reading == "length" else 0.0 * drawn)


def _quantities(chain: Chain, table: pd.DataFrame, group: Group, truth: Truth, fixed: bool) -> Array:
    """Numbers of a set-up in the order of its model: known, else as stated, else assumed."""
    observation = group.observation
    every = observation.quantities()
    known = {q.name: q.value for q in every if q.value is not None}
    if observation.point and {*known} >= {*observation.point} and not fixed:
        at = np.array([known[n] for n in observation.point]) - truth.translation
        known |= dict(zip(observation.point, (at @ rotation_matrix(truth.rotation)).tolist(), strict=True))
    stated = truth.set_ups.get(group.label, {})
    for name in stated:
        if name not in {q.name for q in observation.free}:
            found = f"'{name}', which is no unknown of it"
            cure = nearest(name, [q.name for q in observation.free])
            raise InputError(f"parameters, observations.{group.label}", found, cure)
    lacking = [q.name for q in observation.free if q.name not in stated]
    assumed: dict[str, float] = {}
    if lacking:
        rows = group.channels(chain, table)
        nominal, each = chain.kernel("nominal", (), {}, (0, 1, 2)), len(chain.channels)
        points = [nominal(rows[k : k + each]).T for k in range(0, len(rows), each)]
        try:
            assumed = dict.fromkeys(lacking, 0.0) | observation.assumed(points, {**known, **stated})
        except ValueError as error:
            found, _, cure = str(error).partition(". ")
            raise InputError(f"observation {group.label}", found, cure) from error
    values = {**assumed, **known, **stated}
    return np.array([values[q.name] for q in every])


def with_nominal(chain: Chain, table: pd.DataFrame, observations: Mapping[str, Observation]) -> pd.DataFrame:
    """The table with the readings of a machine without errors where rows of observations hold none."""
    read = {o.reading for o in observations.values()}
    bare = [g for g in groups(table, observations, read=False) if not np.isfinite(g.readings).all()]
    if not bare:
        return table
    labels = {g.label for g in bare}
    rows = np.isin(observed(table), [*labels])
    some = table.assign(**{OBSERVATION: np.where(rows, observed(table), "")})
    found = readings_at(chain, some, {n: o for n, o in observations.items() if n in labels}, Truth({}), fixed=True)
    return table.assign(
        **{c: np.where(np.isfinite(_column(table, c)), _column(table, c), found[c]) for c in read & {*found}}
    )


def _column(table: pd.DataFrame, name: str) -> Array:
    """A column of numbers, NaN where the table has none of that name."""
    return table[name].to_numpy(dtype=np.float64) if name in table else np.full(len(table), np.nan)
