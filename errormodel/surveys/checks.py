"""Validation of the cells of a survey's table, and conversion into mm, rad, s and degC.

Checks run on whole columns; the first invalid cell is looked up only when one fails.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from errormodel.conventions import MOTIONS, ROTATIONS
from errormodel.drives import as_one
from errormodel.exceptions import InputError, NoRowsError, ReadValueError, nearest
from errormodel.files import without_apostrophes
from errormodel.formats.base import Table, as_numbers, spoken
from errormodel.instruments.base import LARGEST_SIGMA, LEAST_SIGMA
from errormodel.machine import Machine
from errormodel.surveys.columns import (
    FIRST_POSE,
    LENGTH_COLUMNS,
    MEASURED,
    MOTION_UNCERTAINTIES,
    ORIENTATION,
    READING_UNCERTAINTIES,
    READINGS,
    SIGMA_COLUMNS,
    Plan,
    first_pose,
    machine_columns,
    missing_joints,
    quantity_of,
    unit_of_column,
)
from errormodel.surveys.missing_values import below_absolute_zero, without_nines, zero_orientations, zeros
from errormodel.units import to_internal
from errormodel.yamlfile import shown

if TYPE_CHECKING:
    from errormodel.surveys.file import SurveyUnits

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FEW_CELLS = 0.1  # of the rows: so many wrong cells of a column are slips, more are another format; by judgement
# mm or rad; larger numbers are placeholders for "no value"; by judgement: 10 km is beyond any machine
LARGEST_READING = 1e7

TURNS = (
    "Write mrx mry mrz in rad, or say their unit (deg, mrad, urad): units: {mrx: deg, mry: deg, mrz: deg} in a "
    "survey.yaml, or --units mrx=deg,mry=deg,mrz=deg with errormodel import"
)


@dataclass(frozen=True)
class Part:
    """One file, or one part of a folder, checked and in internal units.

    Attributes
    ----------
    frame : DataFrame
        The file's columns under the toolkit's names, and ``row``, the data row from 1. Empty rows are removed.
    dated : bool
        Whether the times were dates; they are then seconds since 1970.
    notes : tuple of str
    """

    frame: pd.DataFrame
    dated: bool
    notes: tuple[str, ...]


@dataclass
class _Offences:
    """First invalid cell of every check, from which the first of the file is reported."""

    table: Table
    plan: Plan
    raw: pd.DataFrame
    commands: frozenset[str]  # columns without which a row says nothing
    found: list[tuple[int, int, str, str, str, type[InputError]]] = field(default_factory=list)

    def add(self, column: str, bad: Mask, what: str, cure: str, kind: type[InputError] = InputError) -> None:
        """Add the first cell where `bad` is true; ``{}`` in `what` stands for the cell, `kind` is what is raised."""
        count = int(bad.sum())
        if count:
            kind = ReadValueError if count <= FEW_CELLS * len(bad) else kind
            what += f" (as in {count - 1} more row{'s' * (count > 2)})" if count > 1 else ""
            at = int(bad.argmax())
            value = self.raw[column].iloc[at]
            text = shown(value) if isinstance(value, str) else f"{value:.10g}"
            row = int(self.raw.index[at])
            self.found.append((row, list(self.raw.columns).index(column), column, what.format(text), cure, kind))

    def raise_first(self) -> None:
        if self.found:
            row, _, column, found, cure, kind = min(self.found, key=lambda one: one[:5])
            raise kind(self.table.cell(row, self.plan.ours[column]), found, cure)


def left_out(table: Table) -> str:
    """Note on a part of several that holds nothing."""
    return f"{table.name} has no rows below its header, and is left out"


def read_part(table: Table, plan: Plan, machine: Machine, units: SurveyUnits, measured: bool) -> Part:
    """Read one file (or one part of a folder), check it and convert it to mm, rad, s and degC.

    Raises
    ------
    InputError
        About the first invalid cell.
    """
    ours = plan.ours
    raw, notes = table.read([ours[n] for n in plan.numbers], [ours[n] for n in plan.texts])
    raw = raw.rename(columns={theirs: our for our, theirs in ours.items()})[list(ours)]
    empty = np.logical_and.reduce([_is_empty(raw[name]) for name in raw])
    if empty.any():  # spreadsheets often add empty rows at the end
        between = np.flatnonzero(empty & (np.arange(len(raw)) < len(raw) - np.argmin(empty[::-1])))
        if len(between):
            notes = (*notes, f"nothing in {spoken((raw.index[between] + 1).tolist())}: left out")
        raw = raw[~empty]
    if raw.empty:
        raise NoRowsError(table.name)

    offences = _Offences(table, plan, raw, frozenset(name for j in machine.joints for name in j.columns))
    values = {name: _numbers(offences, name) for name in plan.numbers}
    dated = "time" in values and values["time"][1]
    if dated:
        notes = (*notes, "times given as dates, read as seconds")
    plain = {name: numbers for name, (numbers, is_date) in values.items() if not is_date}
    plain, more = without_nines(plain, [j.name for j in machine.joints], raw.index.to_numpy() + 1)
    notes = (*notes, *more)
    columns: dict[str, Any] = {
        name: _convert(name, plain[name], machine, units) if name in plain else values[name][0] for name in values
    }
    frame = pd.DataFrame(
        columns | {name: without_apostrophes(raw[name].str.strip()) for name in plan.texts}, index=raw.index
    )

    joint = frame["joint"].to_numpy(dtype=object) if "joint" in frame else np.full(len(frame), "", dtype=object)
    volumetric = joint == ""
    if plan.missing_joints:
        wanted = [j for j in plan.missing_joints if volumetric.any() or (joint == j).any()]
        if wanted:
            raise missing_joints(table, wanted, ())
    _check_commands(offences, frame, joint, machine)
    _check_measured(offences, frame, units)
    _check_labels(offences, frame, machine)
    offences.raise_first()
    frame["row"] = raw.index.to_numpy() + 1
    for name, rows, note in below_absolute_zero(frame):
        frame.loc[rows, name] = np.nan
        notes = (*notes, note)
    for rows, note in zeros(frame, [j.name for j in machine.joints]):
        frame.loc[rows, list(MEASURED)] = np.nan
        notes = (*notes, note)
    for rows, note in zero_orientations(frame, [j.name for j in machine.joints if j.type == "rotary"]):
        frame.loc[rows, list(ORIENTATION)] = np.nan
        notes = (*notes, note)
    if measured:
        notes = (*notes, *_nothing_measured(table, frame, volumetric))
    return Part(as_one(frame, machine, table.name), dated, notes)


def _is_empty(column: pd.Series[Any]) -> Mask:
    empty = column.isna() if pd.api.types.is_numeric_dtype(column) else column.str.strip() == ""
    return empty.to_numpy(dtype=bool)


def _numbers(offences: _Offences, name: str) -> tuple[Array, bool]:
    """A column as numbers in the user's unit, and whether it held dates."""
    column = offences.raw[name]
    if pd.api.types.is_numeric_dtype(column):
        values, dated = column.to_numpy(dtype=np.float64), False
    else:
        values, bad = as_numbers(column)
        dated = False
        if name == "time":
            seconds, no_date = _seconds(column)
            dated = bool(no_date.sum() < bad.sum())
            if dated:
                values, bad = seconds, no_date
        rest = "leave the row out" if name in offences.commands else "leave the cell empty if there is no value"
        found, cure = "{} is not a number", f"Correct this cell: write a number, or {rest}"
        if name == "time":  # every row has one, or none
            found, cure = "{}", "Write seconds, or dates such as 2024-03-12T10:00:00"
        offences.add(name, bad, found, cure)
    offences.add(name, np.isinf(values), "{}", "Write a finite number; leave the cell empty if there is no value")
    return values, dated


def _seconds(column: pd.Series[str]) -> tuple[Array, Mask]:
    """ISO 8601 dates as seconds since 1970, and a mask of cells that are neither a date nor empty."""
    text = column.str.strip()
    text = text.where(text.str.match(r"\d{4}-?\d{2}-?\d{2}"), "")
    dates = pd.to_datetime(text, format="ISO8601", utc=True, errors="coerce").to_numpy(dtype="datetime64[us]")
    seconds = (dates - np.datetime64(0, "us")) / np.timedelta64(1, "s")
    return seconds, np.isnan(seconds) & (column.str.strip() != "").to_numpy(dtype=bool)


def _convert(name: str, values: Array, machine: Machine, units: SurveyUnits) -> Array:
    quantity = quantity_of(name, machine)
    return values if quantity is None else to_internal(values, unit_of_column(name, quantity, units), quantity)


def _check_commands(offences: _Offences, frame: pd.DataFrame, joint: NDArray[np.object_], machine: Machine) -> None:
    for j in machine.joints:
        for name in (j.name,) if j.name in frame else (drive for drive in j.drives if drive in frame):
            needed = (joint == "") | (joint == j.name)
            empty = frame[name].isna().to_numpy() & needed
            cure = f"Write the position of {name} in every row, or leave the row out"
            offences.add(name, empty, "no commanded position", cure)
    joints = {name for own in machine_columns(machine) for name in (own, first_pose(own))}
    for name in (n for n in offences.plan.numbers if n in LENGTH_COLUMNS or n in joints):
        far = np.abs(frame[name].to_numpy()) > LARGEST_READING
        offences.add(
            name, far, "{}, beyond any machine", "Leave the cell empty if there is no value, or check the unit"
        )


def _check_measured(offences: _Offences, frame: pd.DataFrame, units: SurveyUnits) -> None:
    if ORIENTATION[0] in frame:
        vector = frame[list(ORIENTATION)].to_numpy()
        absent = np.isnan(vector)
        for k, name in enumerate(ORIENTATION):
            partial = absent[:, k] & ~absent.all(axis=1)
            offences.add(name, partial, "an orientation with a component missing", "Give mrx mry mrz or none of them")
            turned = np.linalg.norm(np.nan_to_num(np.clip(vector, -99, 99)), axis=1) > 2 * math.pi * (1 + 1e-6)
            offences.add(name, turned, "{} in a rotation vector longer than a turn", TURNS, ReadValueError)
    for name in ROTATIONS:
        if name in frame:
            large = np.abs(frame[name].to_numpy()) > 1
            found = f"{{}} {unit_of_column(name, 'angle', units)} as an error motion"
            cure = f"Write {name} in rad (1 urad is 1e-6), or say units: {{{name}: urad}} in a survey.yaml"
            offences.add(name, large, found, cure)
    for name in ("sigma", *SIGMA_COLUMNS, *MOTION_UNCERTAINTIES, *READING_UNCERTAINTIES):
        if name in frame:
            sigma = frame[name].to_numpy()
            cure = "Write a number above 0, or leave the cell empty"
            offences.add(name, sigma <= 0, "{} as a standard uncertainty", cure)
            low, high = LEAST_SIGMA, LARGEST_SIGMA
            found, cure = "{} as a standard uncertainty, which no instrument has", "Check its unit (mm, rad; k = 1)"
            offences.add(name, (sigma > 0) & (sigma < low) | (sigma > high), found, cure)


def _check_labels(offences: _Offences, frame: pd.DataFrame, machine: Machine) -> None:
    for name in offences.plan.numbers:
        if name.removeprefix(FIRST_POSE).startswith("dir_"):
            values = frame[name].to_numpy()
            bad = ~np.isnan(values) & (np.abs(values) != 1)
            offences.add(name, bad, "{} as a direction", "Write +1 or -1, or leave the cell empty")
    if "time" in frame:
        gaps = frame["time"].isna().to_numpy()
        if not gaps.all():
            cure = "Give every row of the file a time, or no row"
            written = ~_is_empty(offences.raw["time"])
            offences.add("time", gaps & written, "{}, which stands for no time", cure)
            offences.add("time", gaps, "no time", cure)
    if "run" in frame:
        gaps = (frame["run"] == "").to_numpy(dtype=bool)
        if not gaps.all():
            offences.add("run", gaps, "no label", "Give every row of the file a run, or no row")
    if "joint" in frame:
        names = [j.name for j in machine.joints]
        label = frame["joint"]
        bad = ~label.isin([*names, ""]).to_numpy(dtype=bool)
        if bad.any():
            wrong = str(label.iloc[int(bad.argmax())])
            offences.add("joint", bad, "{} is not a joint", nearest(wrong, names) + ", or an empty cell")


def _nothing_measured(table: Table, frame: pd.DataFrame, volumetric: Mask) -> tuple[str, ...]:
    def some(names: tuple[str, ...], rows: Mask) -> Mask:
        have = [n for n in names if n in frame]
        return frame[have].notna().to_numpy().any(axis=1) & rows if have else np.zeros(len(frame), dtype=bool)

    every = np.ones(len(frame), dtype=bool)
    empty = ~(some((*MEASURED, *ORIENTATION, *READINGS), every) | some(MOTIONS, ~volumetric))
    if empty.all():
        found = f"nothing measured in {'any row' if len(frame) > 1 else 'its row'}"
        raise InputError(table.name, found, "Fill in at least one of mx my mz")
    if not empty.any():
        return ()
    rows = frame.index[empty]
    more = f" and {len(rows) - 1} more" if len(rows) > 1 else ""
    return (f"nothing measured in row {int(rows[0]) + 1}{more}",)


def run_labels(text: pd.Series[str]) -> pd.Series[str]:
    """Normalised labels of runs: 1, 1.0 and 1.000 are one label, and an empty one is run 1."""
    return text.map({label: re.sub(r"^(\d+)\.0*$", r"\1", label) or "1" for label in text.unique()}).astype("str")
