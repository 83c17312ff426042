"""Rows of a survey that hold readings of observation models: columns, labels, and rows with the same unknowns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.approach import direction
from errormodel.arrays import Array, Index, Mask, as_rows
from errormodel.exceptions import InputError, nearest
from errormodel.observations.base import Observation
from errormodel.surveys.columns import OBSERVATION, READINGS, TOOL_COLUMNS, first_pose

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.chain import Chain
    from errormodel.machine import Machine


@dataclass(frozen=True)
class Group:
    """Rows of one observation that share all its unknowns.

    Attributes
    ----------
    label : name of the entry of ``observations:``; `run`: of the run, where an unknown has a value a run.
    observation : its model.
    index : (n,) row numbers in the table.
    readings : (n,) mm or rad, NaN where nothing was read.
    sigma : (n,) standard uncertainty of each (column ``u_length`` or ``u_angle``, else the entry's); None: estimated.
    """

    label: str
    run: str
    observation: Observation
    index: Index
    readings: Array
    sigma: Array | None

    def unknown(self, name: str) -> str:
        """Name of an unknown of this group: ``observation[A].x``, or ``observation[A, run 2].dead_path``."""
        return unknown_name(self.label, self.run if self.own(name) else "", name)

    def own(self, name: str) -> bool:
        """Whether an unknown has a value a run."""
        return any(q.per_run for q in self.observation.free if q.name == name)

    def channels(self, chain: Chain, table: pd.DataFrame) -> list[Array]:
        """Channels of the chain at each pose of the rows, the first pose first: each (n,), mm and rad.

        They are those of all rows of the table: what a joint did before a row, other instruments may have read.
        """
        out = chain.columns(table)
        if self.observation.poses > 1:
            out = [*chain.columns(start_of(table, chain.machine)), *out]
        return as_rows(*(c[self.index] for c in out))


def unknown_name(label: str, run: str, name: str) -> str:
    """Name of an unknown quantity of an observation; `run` is empty where it is one for all runs."""
    return f"observation[{label}, run {run}].{name}" if run else f"observation[{label}].{name}"


def is_unknown(name: str) -> bool:
    """Whether a name is one of an unknown quantity of an observation."""
    return name.startswith("observation[")


def observed(table: pd.DataFrame) -> Array:
    """Name of the observation of each row, (n,) of str; empty where it is none."""
    if OBSERVATION not in table:
        return np.full(len(table), "", dtype=object)
    return table[OBSERVATION].fillna("").to_numpy(dtype=object)


def start_of(table: pd.DataFrame, machine: Machine) -> pd.DataFrame:
    """The table at the first of two poses: columns ``from_<joint>`` and ``from_tool_x ...`` in place of the others."""
    names = [*(j.name for j in machine.joints), *TOOL_COLUMNS]
    values: dict[str, Any] = {n: table[first_pose(n)].fillna(table[n]) for n in names if first_pose(n) in table}
    for joint in machine.joints:  # the side of arrival is that at the second pose, unless it is stated
        side = direction(table, joint.name)
        name = f"dir_{joint.name}"
        own = (
            table[first_pose(name)].to_numpy(dtype=np.float64)
            if first_pose(name) in table
            else np.full_like(side, np.nan)
        )
        values[name] = np.where(np.isnan(own), side, own)
    return table.assign(**values)


def groups(table: pd.DataFrame, observations: Mapping[str, Observation], read: bool = True) -> Iterator[Group]:
    """Rows of each observation, in the order of the table; `read`: only those that hold a reading."""
    names = observed(table)
    runs = table["run"].astype(str).to_numpy(dtype=object) if "run" in table else np.full(len(table), "1", object)
    for label in dict.fromkeys(names[names != ""]):
        observation = observations[label]
        column = observation.reading
        readings = table[column].to_numpy(dtype=np.float64) if column in table else np.full(len(table), np.nan)
        rows = np.flatnonzero((names == label) & (np.isfinite(readings) if read else True))
        for run in dict.fromkeys(runs[rows]) if observation.by_run else [""]:
            index = rows[runs[rows] == run] if observation.by_run else rows
            if len(index):
                sigma = _sigma(table, observation, index, readings[index])
                yield Group(str(label), str(run), observation, index, readings[index], sigma)


def _sigma(table: pd.DataFrame, observation: Observation, index: Index, readings: Array) -> Array | None:
    declared = observation.uncertainty(readings)
    name = f"u_{observation.reading}"
    own = table[name].to_numpy(dtype=np.float64)[index] if name in table else np.full(len(index), np.nan)
    if np.isnan(own).all():
        return declared
    if declared is not None:
        return np.where(np.isnan(own), declared, own)
    if np.isnan(own).any():
        row = table.iloc[index[int(np.isnan(own).argmax())]]
        found = "a reading without a standard uncertainty, in an observation where others have one"
        cure = f"Give {name} in every row of it, or sigma: [a, b] in observations: of survey.yaml"
        raise InputError(f"{row['file']}, row {row['row']}, column {name}", found, cure)
    return own


def check_observations(
    table: pd.DataFrame, machine: Machine, observations: Mapping[str, Observation], measured: bool, source: str
) -> None:
    """Raise InputError where rows name no entry of ``observations:``, or lack what its model needs.

    Parameters
    ----------
    measured : whether readings are required; False for commands to simulate or predict.
    source : the survey, for messages.
    """
    names = observed(table)
    for name in dict.fromkeys(names[names != ""]):
        if name not in observations:
            row = table.iloc[int(np.argmax(names == name))]
            cure = f"Write observations: {{{name}: {{type: ...}}}} in a survey.yaml, with its model"
            cure = nearest(str(name), observations) if observations else cure
            raise InputError(f"{row['file']}, row {row['row']}, column {OBSERVATION}", f"'{name}', no entry", cure)
    for label, observation in observations.items():
        rows = names == label
        if not rows.any():
            raise InputError(source, f"no row is of the observation '{label}'", f"Name it in a column {OBSERVATION}")
        _check_rows(table, machine, label, observation, rows, measured)
    for column in READINGS:
        stray = (names == "") & table[column].notna().to_numpy() if column in table else np.zeros(0, dtype=bool)
        if stray.any():
            row = table.iloc[int(stray.argmax())]
            found = f"a reading in column {column} of which no one knows what it is of"
            cure = f"Name its entry of observations: (survey.yaml) in a column {OBSERVATION}"
            raise InputError(f"{row['file']}, row {row['row']}", found, cure)


def _check_rows(
    table: pd.DataFrame, machine: Machine, label: str, observation: Observation, rows: Mask, measured: bool
) -> None:
    first = table.iloc[int(rows.argmax())]
    where = f"{first['file']}, row {first['row']}"
    if measured and (observation.reading not in table or table.loc[rows, observation.reading].isna().all()):
        found = f"no reading of '{label}' ({observation.type}) in any of its rows"
        raise InputError(where, found, f"Write what was read in the column {observation.reading}")
    if observation.poses > 1:
        lacking = [j.name for j in machine.joints if first_pose(j.name) not in table]
        if lacking:
            found = (
                f"'{label}' ({observation.type}) has two poses a row, and there is no column {first_pose(lacking[0])}"
            )
            raise InputError(where, found, "Give the first pose as from_<joint>, the second under the joints' names")
        gaps = table[[first_pose(j.name) for j in machine.joints]].isna().to_numpy() & rows[:, None]
        if gaps.any():
            at, k = np.argwhere(gaps)[0]
            row = table.iloc[int(at)]
            place = f"{row['file']}, row {row['row']}, column {first_pose(machine.joints[k].name)}"
            raise InputError(place, "no commanded position", f"Write the first pose in every row of '{label}'")
