"""Surveys: commanded positions and measured points or error motions in one table, in mm and rad."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from errormodel.approach import direction, one_way_each
from errormodel.conventions import MOTIONS
from errormodel.drives import check_series, in_step
from errormodel.effects.axis_blunder import mended
from errormodel.exceptions import InputError, NoRowsError, nearest
from errormodel.formats import data_frame, open_tables
from errormodel.formats.base import Table
from errormodel.instruments.base import Instrument
from errormodel.machine import Machine
from errormodel.observations.base import Observation
from errormodel.surveys.checks import Part, left_out, read_part, run_labels
from errormodel.surveys.clock_notes import clock_notes
from errormodel.surveys.columns import (
    MEASURED,
    MOTION_UNCERTAINTIES,
    ORIENTATION,
    SIGMA_COLUMNS,
    TOOL_COLUMNS,
    Plan,
    check_map,
    check_units,
)
from errormodel.surveys.diameters import refuse_diameters
from errormodel.surveys.file import (
    BudgetEntry,
    FileEntry,
    Frame,
    Refit,
    SurveyForm,
    SurveyUnits,
    TargetPlace,
    read_form,
)
from errormodel.surveys.gaps import filled
from errormodel.surveys.observations import check_observations
from errormodel.surveys.plausibility import check_sizes
from errormodel.surveys.record import RecordForm
from errormodel.surveys.states import planned
from errormodel.surveys.target_places import places_of
from errormodel.surveys.temperature_steps import step_notes
from errormodel.surveys.temperatures import fahrenheit_notes
from errormodel.surveys.touched_places import note_read_again, with_nominal_commands
from errormodel.surveys.travels import travel_notes
from errormodel.yamlfile import Document

if TYPE_CHECKING:
    from errormodel.surveys.logs import Log

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Survey:
    """A survey in internal units: one row per measurement.

    Attributes
    ----------
    table : DataFrame
        One row per measurement, index 0..n-1, in mm, rad, s, degC, mm/min and kg. Always present: the joints by name,
        ``tool_x tool_y tool_z`` (the machine's where the file has none), ``mx my mz`` (NaN: not measured), ``run``,
        ``file`` (as the user wrote it), ``role`` and ``row`` (data row of the file, from 1). Present if any file has
        them, and NaN in the others: ``mrx mry mrz``, ``time``, ``dir_<joint>``, ``T_*``, ``w_*``, ``feed``, ``load``,
        ``sigma_x sigma_y sigma_z``; with single readings ``observation``, ``length`` or ``angle``, ``u_length``,
        ``u_angle``, ``from_<joint>`` (the first of two poses); with rows about one joint's error motions ``joint``
        (empty for volumetric rows), ``dx dy dz ea eb ec`` and their uncertainties ``u_dx`` ... ``u_ec``. A position is
        NaN only in rows about another joint.
    frame : {"shared", "per-run", "per-file", "fixed"}
        Rows that share a measuring frame; fixed: it is the machine's own.
    refit : tuple of {"frame", "tool"}
        What is estimated anew for a test file.
    instrument : Instrument
    sized : bool
        Whether the instrument's uncertainties are absolute; else relative to each other, with mean 1.
    source : Path
        The path that the user gave.
    notes : tuple of str
        Warnings to print.
    budget : tuple of BudgetEntry
        Uncertainties that the data do not contain.
    frame_rotation : tuple of float, or None
        Rotation ``Rx Ry Rz`` (rad) of the machine's reference into the measuring frame, where the points do not
        determine it.
    record : RecordForm, or None
        The block ``test:``: who tested what, when, with which instrument, and which limits hold.
    motions_of : str
        The joint whose error motions the points stand for; empty where points were measured.
    observations : mapping
        Models of single readings by the names in the column ``observation``.
    scatter : bool
        Whether the rows' standard uncertainties are the scatter of the single readings whose means they hold: they
        weigh the rows, and the noise of the means shows in the residuals.
    of_tool : frozenset of str
        Files whose readings were along the axes of the tool; the table has them in those of the reference.
    labelled : bool
        Whether a file has a column ``run``; else all rows are of one run, whose label nobody gave.
    clock_zero : float or None
        When ``time`` is 0, in s since 1970, where the times were given as dates.
    places : mapping
        Of targets whose places are not known exactly, by name (with the file, where several state another place).
    indicated : bool
        Whether rows had indicated positions as commands and the place of what was touched as what was measured: the
        table has nominal commands in them, and the difference in what was measured, whose signs are known so.
    """

    table: pd.DataFrame
    frame: Frame
    refit: tuple[Refit, ...]
    instrument: Instrument
    source: Path
    notes: tuple[str, ...] = ()
    budget: tuple[BudgetEntry, ...] = ()
    motions_of: str = ""
    sized: bool = True
    frame_rotation: tuple[float, float, float] | None = None
    record: RecordForm | None = None
    observations: Mapping[str, Observation] = field(default_factory=dict)
    scatter: bool = False
    of_tool: frozenset[str] = frozenset()
    labelled: bool = True
    clock_zero: float | None = None
    places: Mapping[str, TargetPlace] = field(default_factory=dict)
    indicated: bool = False

    def __len__(self) -> int:
        return len(self.table)

    def commands(self, joints: Sequence[str]) -> Array:
        """Commanded positions, (n, len(joints)) in mm or rad."""
        return self._columns(joints)

    @property
    def name(self) -> str:
        """Name of the source without its folder, as results state it."""
        return name_of(self.source)

    @property
    def tool(self) -> Array:
        """Functional points in the last frame, (n, 3) in mm."""
        return self._columns(TOOL_COLUMNS)

    @property
    def measured(self) -> Array:
        """Measured coordinates in the measuring frame, (n, 3) in mm; NaN where not measured."""
        return self._columns(MEASURED)

    def _columns(self, names: Sequence[str]) -> Array:
        return self.table[list(names)].to_numpy(dtype=np.float64)

    def rows(self, which: NDArray[np.bool_]) -> Survey:
        """Survey of the rows where the mask `which`, (n,), is true."""
        return replace(self, table=self.table[which].reset_index(drop=True))

    @property
    def fit(self) -> Survey:
        """Rows from which the parameters are estimated."""
        return self.rows((self.table["role"] == "fit").to_numpy(dtype=bool))

    @property
    def test(self) -> list[Survey]:
        """Held-out files, one survey each."""
        held_out = self.table["role"] == "test"
        files = self.table["file"][held_out].unique()
        return [self.rows((held_out & (self.table["file"] == file)).to_numpy(dtype=bool)) for file in files]

    def direction(self, joint: str) -> Array:
        """Direction of approach of a joint, +-1, (n,): see :func:`errormodel.approach.direction`."""
        return direction(self.table, joint)


def read_survey(source: Path | str | pd.DataFrame, machine: Machine, measured: bool = True) -> Survey:
    """Read a survey: a table, a folder of its parts, or a ``survey.yaml`` that names tables.

    Parameters
    ----------
    source : Path, str or DataFrame
        A file or folder; or a table with the columns of a survey's file (mm, degrees for rotary joints).
    machine : Machine
        Names the joints and gives the tool.
    measured : bool
        Whether measured columns are required; False for commands to simulate or predict.

    Returns
    -------
    Survey
        Its table in mm and rad.

    Raises
    ------
    InputError
        About the first fault, with file, row and column or line and key.
    """
    logs: list[Log] = []
    if isinstance(source, pd.DataFrame):
        path = Path(data_frame.FRAME_TABLE_NAME)
        form, document, _ = read_form(path)
        opened: list[tuple[FileEntry, list[Table]]] = [(form.files[0], [data_frame.table_of(source)])]
    else:
        path = Path(source)
        form, document, folder = read_form(path)
        if form.logs:
            from errormodel.surveys.raw import open_logs

            logs = open_logs(form.logs, folder, machine)
        opened = [(entry, _opened(entry, folder, machine, logs)) for entry in form.files]
    check_map(
        document, machine, form.columns, [table for entry, tables in opened if not entry.format for table in tables]
    )
    notes: dict[str, None] = dict.fromkeys(form.all_notes() if measured else ())  # in order, and each once
    of_tool = frozenset(entry.path for entry, _ in opened if entry.axes == "tool")
    parts: list[Part] = []
    forms = [_own_form(form, entry, tables[0]) for entry, tables in opened]
    plans = [
        [planned(table, machine, own.columns, measured) for table in tables]
        for (_, tables), own in zip(opened, forms, strict=True)
    ]
    named = (name for plan, f in zip(plans, forms, strict=True) if f is form for one in plan for name in one.ours)
    check_units(document, machine, form.units, named)
    for (entry, tables), own, settings in zip(opened, plans, forms, strict=True):
        part = _read_file(entry, tables, own, machine, settings, measured)
        if logs and not entry.format:  # those of a raw file have been joined to it
            from errormodel.surveys.logs import part_with_logs

            part = part_with_logs(part, logs, entry.path)
        # results state the file as survey.yaml does, or by its name: the same wherever the command is run
        label = entry.path if document.data else name_of(Path(entry.path))
        part.frame["file"] = label
        notes |= dict.fromkeys(f"{label}: {note}" for note in part.notes)
        notes |= dict.fromkeys(f"{label}: {note}" for note in check_series(part.frame, machine, label))
        read_as = getattr(tables[0], "read_as", None) if entry.format else None
        notes |= dict.fromkeys(check_sizes(part.frame, machine, settings.units, label, measured, read_as))
        parts.append(part)
    if measured and all(entry.role == "test" for entry in form.files):
        raise document.error(("files",), "only test files", "Give at least one file the role fit")
    zero = _clock_zero(parts)
    table = mended(assemble(parts, machine), machine)
    scatter = [getattr(tables[0], "scatter", False) for entry, tables in opened if entry.role == "fit"]
    check_observations(table, machine, form.observations, measured, str(path))
    table, more = filled(table) if measured else in_step(table, machine)  # states for a prediction have no time series
    notes |= dict.fromkeys(more)
    notes |= dict.fromkeys(travel_notes(table, machine))
    if measured:
        notes |= dict.fromkeys(clock_notes(table, machine))
        notes |= dict.fromkeys((*fahrenheit_notes(table), *step_notes(table)))
        notes |= dict.fromkeys(_side_notes(table, machine, form.frame))
    _check_budget(form, document, machine, [str(c) for c in table.columns])
    rotation = None
    if form.frame_rotation is not None:
        x, y, z = np.radians(form.frame_rotation).tolist()
        rotation = (x, y, z)
    touched = list[str]()
    if measured:
        refuse_diameters(table, machine)
        table, touched = with_nominal_commands(table, machine, form.frame, rotation)
        notes |= dict.fromkeys((*touched, *note_read_again(table, machine, form.frame)))
    return Survey(
        table, form.frame, tuple(form.refit), form.instrument, path, tuple(notes), tuple(form.budget),
        frame_rotation=rotation, record=form.test, observations=form.observations, scatter=all(scatter),
        of_tool=of_tool, labelled=any("run" in part.frame for part in parts), clock_zero=zero,
        places=places_of(form.files), indicated=bool(touched),
    )  # fmt: skip


def name_of(path: Path) -> str:
    """Name of a file or folder, as results state it."""
    return path.name if path.name not in ("", "..") else path.resolve().name


def _opened(entry: FileEntry, folder: Path, machine: Machine, logs: list[Log]) -> list[Table]:
    if not entry.format:
        return open_tables(folder / entry.path, entry.path)
    from errormodel.surveys.raw import open_entry

    return [open_entry(entry, folder, machine, logs)]


def _own_form(form: SurveyForm, entry: FileEntry, table: Table) -> SurveyForm:
    """The settings of one file: a raw file has columns and units of its own, and is converted already."""
    units = getattr(table, "units", None) if entry.format else None
    return form if units is None else form.model_copy(update={"columns": {}, "units": SurveyUnits(**units)})


def _side_notes(table: pd.DataFrame, machine: Machine, frame: Frame) -> Iterator[str]:
    """Notes on the direction of approach in rows about a joint's own error motions."""
    for joint in (j.name for j in machine.joints if "joint" in table):
        own = (table["joint"] == joint).to_numpy(dtype=bool)
        side = direction(table, joint)[own]
        if len(np.unique(side)) < 2:
            continue
        name = f"dir_{joint}"
        if name not in table or table[name][own].isna().any():
            yield (
                f"no {name} in rows about {joint}: the side of arrival is taken from the order of the rows, as of a "
                "test to and fro that overruns its last target (ISO 230-2)"
            )
        if frame != "fixed" and one_way_each(side, table["run"][own].to_numpy()):
            yield (
                f"each run of {joint} goes one way only, and comes from a zero of its own: backlash cannot be "
                "distinguished from the zeros. Give the way there and back one label of run"
            )


def _check_budget(form: SurveyForm, document: Document, machine: Machine, columns: list[str]) -> None:
    """Raise InputError about a budget entry that acts on a quantity which this survey does not have."""
    own = (c for c in columns if c.startswith("T_") or c == "load")
    valid = ["prediction", "scale", *(j.name for j in machine.joints), *TOOL_COLUMNS, *own]
    for k, entry in enumerate(form.budget):
        if entry.acts not in valid:
            found = f"'{entry.acts}', which this survey does not have"
            raise document.error(("budget", k, "acts"), found, nearest(entry.acts, valid))


def _read_file(
    entry: FileEntry, tables: list[Table], plans: list[Plan], machine: Machine, form: SurveyForm, measured: bool
) -> Part:
    """All parts of a file as one, with continuous row numbers."""
    for table, plan in zip(tables, plans, strict=True):
        other = sorted(plan.ours.keys() ^ plans[0].ours.keys())
        if other:
            found = f"not the same columns as in {tables[0].name}: {', '.join(other)}"
            raise InputError(f"{table.name}, header", found, "Give all parts of a folder the same columns")
    parts, empty = [], list[str]()
    for table, plan in zip(tables, plans, strict=True):
        try:
            parts.append(read_part(table, plan, machine, form.units, measured))
        except NoRowsError:
            if len(tables) == 1:
                raise
            empty.append(left_out(table))
    if not parts:
        raise NoRowsError(entry.path)
    if len({part.dated for part in parts}) > 1:
        raise InputError(entry.path, "times as dates in some parts, as numbers in others", "Write all in one way")
    frame = parts[0].frame
    if len(parts) > 1:
        frame = pd.concat([part.frame for part in parts], ignore_index=True)
        frame["row"] = np.arange(1, len(frame) + 1)
    frame["role"] = entry.role
    notes = empty + [note for plan in plans for note in plan.notes] + [note for part in parts for note in part.notes]
    return Part(frame, parts[0].dated, tuple(notes))


def _clock_zero(parts: list[Part]) -> float | None:
    """The first of all times that are dates, s since 1970; None where none are."""
    return min((float(part.frame["time"].min()) for part in parts if part.dated), default=None)


def assemble(parts: list[Part], machine: Machine) -> pd.DataFrame:
    """Table of a :class:`Survey`: all files, with the columns that are always present."""
    if (zero := _clock_zero(parts)) is not None:
        for part in parts:
            if part.dated:  # one origin for all files, so that their times remain comparable
                part.frame["time"] -= zero
    table = pd.concat([part.frame for part in parts], ignore_index=True)
    for name in (*(j.name for j in machine.joints), *MEASURED):
        if name not in table:
            table[name] = np.nan
    for name, value in zip(TOOL_COLUMNS, machine.tool, strict=True):
        table[name] = table[name].fillna(value) if name in table else value
    if "sigma" in table:
        for name in SIGMA_COLUMNS:
            table[name] = table[name].fillna(table["sigma"]) if name in table else table["sigma"]
    table["run"] = run_labels(table["run"].fillna("")) if "run" in table else "1"
    about = "joint" in table and bool((table["joint"].fillna("") != "").any())
    motions = [name for name in (*MOTIONS, *MOTION_UNCERTAINTIES) if name in table]
    if about:
        table["joint"] = table["joint"].fillna("")
        for name in MOTIONS:
            if name not in table:
                table[name] = np.nan
    else:
        table = table.drop(columns=[*motions, "joint"], errors="ignore")
    first = [
        *(j.name for j in machine.joints),
        *TOOL_COLUMNS,
        *MEASURED,
        *ORIENTATION,
        "joint",
        *MOTIONS,
        *MOTION_UNCERTAINTIES,
    ]
    first += ["run", "time", "file", "role", "row"]
    front = [name for name in first if name in table]
    return table[[*front, *(name for name in table if name not in (*front, "sigma"))]]
