"""Raw files of a survey as its ``survey.yaml`` maps them: columns, units, commands, pairs, targets, logs.

A raw file is never changed. What is read from it, and what its rows belong to, stands in the map; a correction is a
line there.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.conventions import MOTIONS
from errormodel.exceptions import InputError, nearest
from errormodel.formats.base import as_numbers
from errormodel.formats.data_frame import FrameTable
from errormodel.machine import Machine
from errormodel.raw_formats.base import Asked, RawFile, ReadAs, Recording, called, format_of, open_raw, raw_formats
from errormodel.raw_formats.direction_words import sides
from errormodel.raw_formats.unit_words import unit_word
from errormodel.surveys.columns import (
    MEASURED,
    OBSERVATION,
    ORIENTATION,
    READING_UNCERTAINTIES,
    SIGMA_COLUMNS,
    TOOL_COLUMNS,
    first_pose,
    is_survey_column,
    quantity_of,
    unit_of_column,
)
from errormodel.surveys.file import FileEntry, LogEntry, RawEntry, SurveyUnits
from errormodel.surveys.logs import Log, with_logs
from errormodel.surveys.means import averaged
from errormodel.surveys.pairs import PairTable, read_pairs
from errormodel.surveys.side_by_side import one_below_the_other, reading_of
from errormodel.surveys.tool_axes import in_reference
from errormodel.units import UNIT_EXAMPLES, is_unit, of_diameters, to_internal

if TYPE_CHECKING:
    import pandas as pd

LABELS = ("point", "target", "station", "group")  # columns of text that only an import knows
UNSTATED = "no unit"  # begins the note of a format on what it takes for granted where a file states none
LEFT_OUT = "-"  # in place of a column's own name: it is not read
READ_BACK = "read_"  # before a joint: the position that the controller read back


@dataclass(frozen=True)
class RawTable(FrameTable):
    """The rows of a raw file with their commands; messages name the lines of the file."""

    lines: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()  # on how the raw files were read
    units: Mapping[str, str] = field(default_factory=dict)  # of columns whose unit was stated, as they now are
    read_as: Mapping[str, ReadAs] = field(default_factory=dict)  # of lengths and error motions
    scatter: bool = False  # standard uncertainties are only the scatter of the readings of which rows are means

    def read(self, numbers: Collection[str], texts: Collection[str]) -> tuple[pd.DataFrame, tuple[str, ...]]:
        frame, notes = super().read(numbers, texts)
        return frame, (*self.notes, *notes)

    def line(self, row: int) -> int | None:
        return self.lines[row] if row < len(self.lines) else None


def mapped(entry: RawEntry, folder: Path, machine: Machine, pairs: PairTable | None = None) -> Recording:
    """A raw file with the columns of the toolkit, in mm, degrees (rad where a survey has rad), s, degC, mm/min and kg.

    `pairs`: its rows that are read; text among the numbers of others is left alone.

    Raises
    ------
    InputError
        The file was changed since its import, a column is not there, or a unit does not suit it.
    """
    raw = open_raw(folder / entry.path, entry.path)
    if entry.sha256 and hashlib.sha256(raw.data).hexdigest() != entry.sha256:
        found = "it is not the file that was imported: its SHA-256 is another"
        raise InputError(entry.path, found, "Put the file back, or import it again")
    if pairs is not None:
        own = replace(raw, counts=pairs.has)
        recording = with_map(read_raw(own, entry, machine), entry, machine)
        if recording.a_row_each:
            return recording
    return with_map(read_raw(raw, entry, machine), entry, machine)


def read_raw(raw: RawFile, entry: RawEntry, machine: Machine) -> Recording:
    """A raw file under the names of its format."""
    form = format_of(raw, entry.format)
    asked = Asked(
        machine, entry.dates, entry.joint, tuple(entry.offsets), tuple(entry.at), entry.dialect, entry.circle,
        {word: unit for word, unit in entry.units.items() if word in form.columns}, entry.sheet,
    )  # fmt: skip
    return form.opened(called(raw, form, entry.columns), asked)


def with_map(recording: Recording, entry: RawEntry, machine: Machine) -> Recording:
    """A recording with the columns and units of its entry in ``survey.yaml``."""
    import pandas as pd

    frame = recording.frame
    columns: dict[str, Any] = {}
    units: dict[str, str] = {}
    taken: set[str] = set()
    form = raw_formats().get(entry.format)
    asked = entry.units
    if form is not None and form.columns:  # what its format has taken by these words
        rest = [{k: v for k, v in block.items() if k not in form.columns} for block in (entry.columns, entry.units)]
        entry = entry.model_copy(update=dict(zip(("columns", "units"), rest, strict=True)))
    for ours, theirs in entry.columns.items():
        if not is_column(ours, machine):
            names = (*(j.name for j in machine.joints), *MEASURED, *LABELS, "time", "run")
            raise InputError(f"{entry.path}, columns: {ours}", "no column of a survey", nearest(ours, names))
        if theirs == LEFT_OUT:  # under its own name, or under another, which then nobody maps
            taken.add(ours)
            continue
        name, sign = (theirs, 1.0) if theirs in frame else (theirs.removeprefix("-"), -1.0)
        if name not in frame:
            raise InputError(
                f"{entry.path}, columns: {ours}", f"no column '{theirs}'", nearest(theirs, map(str, frame))
            )
        if sign < 0 and frame[name].dtype.kind != "f":
            raise InputError(f"{entry.path}, columns: {ours}", f"'{theirs}' of text", "Write '-' before numbers only")
        columns[ours] = sign * frame[name] if sign < 0 else frame[name]
        taken.add(name)
        if name in recording.units:
            units[ours] = recording.units[name]
    for own in map(str, frame):
        if own not in taken and own not in columns:
            columns[own] = frame[own]
            if own in recording.units:
                units[own] = recording.units[own]
    read_as: dict[str, ReadAs] = {}
    for name, column in columns.items():
        stated_all = recording.length_unit if _is_coordinate(name, machine) and name not in units else ""
        unit = _unit_read(entry, machine, name, units.get(name, stated_all))
        columns[name] = _converted(entry, machine, name, column, unit)
        if unit and column.dtype.kind == "f":
            read_as[name] = ReadAs(name, unit)
    if entry.joint and "joint" not in columns and {*columns} & {*MOTIONS} and len(recording.frame):
        if entry.joint not in columns:
            cure = f"Say which column it is: --columns {entry.joint}=.. (columns: of the map)"
            raise InputError(entry.path, f"error motions of {entry.joint}, and no column of its position", cure)
        columns["joint"] = pd.Series([entry.joint] * len(recording.frame))
    _check_units(entry, columns)
    read_as |= recording.read_as
    own_words: dict[str, str] = {n: asked[r.word] for n, r in read_as.items() if r.word in asked and n in MOTIONS}
    stated = {n: u for n in columns if (u := entry.units.get(n) or own_words.get(n) or _said(n, units))}
    told = "length" in entry.units or {*MEASURED} <= {*entry.units}
    notes = tuple(note for note in recording.notes if not (told and note.startswith(UNSTATED)))
    kept = {n: _usual(n, machine) for n in stated}
    try:
        frame, lines = one_below_the_other(pd.DataFrame(columns), recording.lines)
    except ValueError as error:
        raise InputError(f"{entry.path}, columns", str(error), "Write length:A=.., length:B=..") from error
    return replace(recording, frame=frame, lines=lines, units=kept, notes=notes, read_as=read_as)


def _is_coordinate(name: str, machine: Machine) -> bool:
    """Whether a column is one of those that a unit for all coordinates of a file is meant for."""
    joint = any(name.removeprefix(READ_BACK) in j.columns for j in machine.joints if j.type == "prismatic")
    return joint or plain_column(name) in (*MEASURED, *SIGMA_COLUMNS, *TOOL_COLUMNS, "sigma", "length")


def _said(name: str, units: Mapping[str, str]) -> str:
    """The unit that a file states of a column, where nothing judges it by the machine's size."""
    return units.get(name, "") if name == "time" or name.startswith("T_") else ""


def plain_column(name: str) -> str:
    """The column of a survey that a column of a raw file is one of: `X` of ``read_X``, ``length`` of ``length:A``."""
    return reading_of(name.removeprefix(READ_BACK))[0]


def _usual(name: str, machine: Machine) -> str:
    quantity = quantity_of(plain_column(name), machine)
    return "" if quantity is None else unit_of_column(plain_column(name), quantity, SurveyUnits())


def is_column(name: str, machine: Machine) -> bool:
    """Whether a column of a raw file may have this name."""
    joint = name.removeprefix(READ_BACK) in [n for j in machine.joints for n in j.columns]
    return name in LABELS or joint or is_survey_column(reading_of(name)[0], machine)


def _check_units(entry: RawEntry, columns: Mapping[str, Any]) -> None:
    for name in entry.units:
        if name not in columns and name not in UNIT_EXAMPLES:
            raise InputError(f"{entry.path}, units: {name}", "no column of this file", nearest(name, columns))


def _unit_read(entry: RawEntry, machine: Machine, name: str, stated: str) -> str:
    """The unit as which a column is read: said of it, stated in the file, said of its kind, or the usual one."""
    quantity = quantity_of(plain_column(name), machine) or ""
    kind = entry.units.get(quantity, "") if not stated and name not in entry.units else ""
    within = stated or entry.units.get(quantity, "")
    return of_diameters(unit_word(entry.units.get(name, stated or kind or _usual(name, machine))), unit_word(within))


def _converted(entry: RawEntry, machine: Machine, name: str, column: Any, unit: str) -> Any:
    """A column in `unit` in the unit that a survey's table has by default."""
    quantity = quantity_of(plain_column(name), machine)
    if name.startswith("dir_") and column.dtype.kind != "f":
        return sides(column, lambda row: f"{entry.path}, row {row + 1}, column {name}")
    if quantity is None:
        return column
    if column.dtype.kind != "f":  # a column that is empty in all rows is one of numbers as well
        values, bad = as_numbers(column.astype("str"))
        return column if np.isfinite(values).any() or bad.any() else values
    usual = unit_of_column(plain_column(name), quantity, SurveyUnits())
    if not is_unit(unit, quantity):
        where = f"{entry.path}, column {name}"
        such = 'arcsec, if " are seconds of arc' if (quantity, unit) == ("angle", "inch") else UNIT_EXAMPLES[quantity]
        cure = f"Say it with --units {name}=.. (units: of the map), a unit of {quantity}, such as {such}"
        raise InputError(where, f"the unit '{unit}'", cure)
    if unit == usual:
        return column
    values = to_internal(column.to_numpy(dtype=np.float64), unit, quantity)
    return np.degrees(values) if usual == "deg" else values


def open_logs(entries: Sequence[LogEntry], folder: Path, machine: Machine) -> list[Log]:
    """The logs of a ``survey.yaml``, each beside its entry."""
    return [(entry, mapped(entry, folder, machine)) for entry in entries]


def open_entry(entry: FileEntry, folder: Path, machine: Machine, logs: Sequence[Log]) -> RawTable:
    """The table of a survey that an entry of ``survey.yaml`` makes of raw files."""
    commands = None
    pairs = read_pairs(folder / entry.pairs, entry.pairs) if entry.pairs else None
    measured = mapped(entry, folder, machine, pairs)
    if pairs is not None:
        pairs.check_readings(len(measured.frame), entry.path)
    if entry.commands is not None and pairs is not None:
        commands = mapped(entry.commands, folder, machine)
        pairs.check_commands(len(commands.frame), entry.commands.path)
    table, lines = joined(
        measured, commands, pairs, {n: t.point for n, t in entry.targets.items()}, machine, entry.path
    )
    if entry.axes == "tool":
        table = in_reference(table, machine, entry.path)
    if entry.observation:
        table[OBSERVATION] = entry.observation
    table, more = with_logs(table, measured.dated, logs, entry.path)
    read = () if entry.sha256 else (measured, commands, *(recording for _, recording in logs))
    notes = (*(n for r in read if r is not None for n in r.notes), *more)  # an import said how it read its files
    units = {n: u for r in (commands, measured) if r is not None for n, u in r.units.items() if u and n in table}
    own = as_table(table, measured.dated, entry.path, lines, machine)
    read_as = {} if commands is None else {n: r._replace(option="--command-units") for n, r in commands.read_as.items()}
    read_as |= measured.read_as
    read_as = {n: r for n, r in read_as.items() if n in table}
    sigmas = {"sigma", *SIGMA_COLUMNS, *READING_UNCERTAINTIES}
    scatter = bool(sigmas & {*table}) and not sigmas & {*measured.frame}
    return replace(own, notes=notes, units=units, read_as=read_as, scatter=scatter)


def joined(
    measured: Recording,
    commands: Recording | None,
    pairs: PairTable | None,
    targets: Mapping[str, Sequence[float]],
    machine: Machine,
    name: str,
) -> tuple[pd.DataFrame, tuple[int, ...]]:
    """Rows of a survey: what was measured, averaged over the readings of a pose, beside its command.

    Parameters
    ----------
    measured, commands : recordings under the toolkit's names; without `commands` they are in `measured`.
    pairs : which rows belong together; None: every row for itself.
    targets : functional point (mm) of each target.
    name : of the measured file, for messages.
    """
    frame = measured.frame
    lines = measured.lines
    if pairs is not None:
        frame = averaged(frame, pairs.first, pairs.last)
        lines = tuple(lines[k] for k in pairs.first) if lines else ()
        if pairs.run is not None:
            frame["run"] = pairs.run
    if commands is not None and pairs is not None:
        commanded = commands.frame.iloc[pairs.command].reset_index(drop=True)
        joints = [n for j in machine.joints for n in j.columns if n in commanded]
        for joint in joints:
            if joint in frame and f"{READ_BACK}{joint}" not in frame:
                frame = frame.rename(columns={joint: f"{READ_BACK}{joint}"})
        skip = {*MEASURED, *ORIENTATION, *SIGMA_COLUMNS, "time", *LABELS}
        for column in commanded:
            if str(column) not in skip and column not in frame:
                frame[column] = commanded[column]
        if pairs.start is not None:
            started = commands.frame.iloc[pairs.start].reset_index(drop=True)
            for joint in joints:
                for name in (joint, f"dir_{joint}"):
                    if name in started:
                        frame[first_pose(name)] = started[name]
    for own in machine.joints:
        read = f"{READ_BACK}{own.name}"
        if read in frame and own.name in frame:
            unit = "deg" if own.type == "rotary" else "mm"
            frame[f"w_readback_{own.name}_{unit}"] = frame[read] - frame[own.name]
    if targets:
        frame = _with_tools(frame, targets, name)
    if "station" in frame and frame["station"].nunique() > 1:
        frame["run"] = frame["station"]
    return frame, lines


def _with_tools(frame: pd.DataFrame, targets: Mapping[str, Sequence[float]], name: str) -> pd.DataFrame:
    import pandas as pd

    if len(targets) == 1:  # of all rows
        labels = pd.Series([*targets] * len(frame))
    elif "target" not in frame:
        raise InputError(f"{name}, targets", "no column of targets", "Say columns: {target: ..}, or give one target")
    else:
        labels = frame["target"].astype(str).str.strip()
    unknown = sorted({*labels} - {*targets})
    if unknown:
        raise InputError(f"{name}, targets", f"nothing about the target '{unknown[0]}'", nearest(unknown[0], targets))
    points = np.array([targets[label] for label in labels], dtype=np.float64)
    for k, column in enumerate(TOOL_COLUMNS):
        frame[column] = points[:, k]
    return frame


def as_table(frame: pd.DataFrame, dated: bool, name: str, lines: tuple[int, ...], machine: Machine) -> RawTable:
    """The rows as a table that a survey is read from; dates as ISO 8601."""
    keep = [c for c in frame if is_survey_column(str(c), machine)]
    frame = frame[keep].reset_index(drop=True)
    if dated and "time" in frame:
        micro = np.rint(frame["time"].to_numpy(dtype=np.float64) * 1e6)
        whole = np.isfinite(micro)
        text = np.datetime_as_string(np.where(whole, micro, 0).astype("int64").astype("datetime64[us]"))
        frame["time"] = np.where(whole, text, "")
    return RawTable(Path(name), name, tuple(map(str, frame)), frame, lines)
