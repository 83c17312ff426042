"""A survey on disk that may be larger than memory: its rows are read, checked and converted a range at a time.

What a survey derives from the course of all its rows (the side of arrival where no column states it, a lagged or
smoothed temperature, play) cannot be had of a range of them: a machine with an effect that needs it is refused.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from errormodel.channels import root
from errormodel.drives import check_series, in_step
from errormodel.effects.axis_blunder import mended
from errormodel.exceptions import InputError, NoRowsError
from errormodel.formats import data_frame, open_tables
from errormodel.formats.base import RowRanges, Table
from errormodel.machine import Machine
from errormodel.survey import Survey, assemble, name_of
from errormodel.surveys.checks import Part, left_out, read_part
from errormodel.surveys.columns import (
    MEASURED,
    ORIENTATION,
    SIGMA_COLUMNS,
    TOOL_COLUMNS,
    Plan,
    check_map,
    check_units,
    machine_columns,
)
from errormodel.surveys.file import FileEntry, SurveyForm, read_form
from errormodel.surveys.plausibility import check_sizes
from errormodel.surveys.states import planned
from errormodel.surveys.travels import travel_notes
from errormodel.yamlfile import Document

WHOLE = "leave out --stream, if the survey fits the memory"
_BY_COURSE = {  # channels that follow from the course of all rows, by the beginning of their names
    "lag(": "a lagged temperature", "initial(": "a lagged temperature", "play(": "a play",
    "speed(": "a speed on the path", "rate(": "a speed by the clock",
    "resumed(": "the end of the machine's rest",
}  # fmt: skip


@dataclass(frozen=True)
class RowsOfFile:
    """One file of a survey, or a folder of its parts, in ranges.

    Attributes
    ----------
    entry : its entry in survey.yaml.
    label : its name in results.
    parts : tables in ranges, with their columns and the number of rows before each.
    """

    entry: FileEntry
    label: str
    parts: tuple[tuple[Table, RowRanges, Plan, int], ...]

    @cached_property
    def count(self) -> int:
        _, ranges, _, before = self.parts[-1]
        return before + len(ranges)


@dataclass(frozen=True)
class _Pieces(Table):
    """Ranges of the rows of one table."""

    pieces: tuple[Table, ...]

    def read(self, numbers: Collection[str], texts: Collection[str]) -> tuple[pd.DataFrame, tuple[str, ...]]:
        read = [piece.read(numbers, texts) for piece in self.pieces]
        return pd.concat([frame for frame, _ in read]), tuple(note for _, notes in read for note in notes)

    def line(self, row: int) -> int | None:
        return self.pieces[0].line(row)


@dataclass(frozen=True)
class SurveyRows:
    """The rows of a survey, opened as far as columns and numbers of rows.

    Attributes
    ----------
    source : as the user gave it.
    files : those that are fitted (or, of commands, all), then those that are held out.
    channels : names of the channels that are read; see `errormodel.chain.Chain.channels`.
    columns : columns of the files by the toolkit's names, those that are not read included.
    """

    source: Path
    machine: Machine
    form: SurveyForm
    document: Document
    files: tuple[RowsOfFile, ...]
    channels: tuple[str, ...]
    measured: bool
    columns: frozenset[str]
    notes: tuple[str, ...] = field(default=())

    @cached_property
    def starts(self) -> list[int]:
        """Number of rows before each file that is fitted, and of all of them."""
        counts = [f.count for f in self.files if f.entry.role == "fit" or not self.measured]
        return [0, *np.cumsum(counts).tolist()]

    def __len__(self) -> int:
        return self.starts[-1]

    def survey(self, *places: tuple[int, int]) -> Survey:
        """Fitted rows, each of `places` from a first (from 0) to before a last one, checked, in internal units.

        Places are in order and do not overlap. Notes are on these rows.

        Raises
        ------
        InputError
            About the first fault in them.
        """
        frames, notes = [], list[str]()
        for file, before, end in zip(self.files, self.starts, self.starts[1:], strict=False):
            own = [(max(a, before) - before, min(b, end) - before) for a, b in places if a < end and b > before]
            if own:
                frame, more = self._of_file(file, own)
                frames.append(frame)
                notes += more
        return self._as_survey(frames, notes)

    def held_out(self) -> Survey | None:
        """All rows of the files that are held out; None where there are none."""
        tests = [f for f in self.files if f.entry.role == "test"] if self.measured else []
        if not tests:
            return None
        read = [self._of_file(f, [(0, f.count)]) for f in tests]
        return self._as_survey([frame for frame, _ in read], [note for _, notes in read for note in notes])

    def looked_over(self, survey: Survey) -> Survey:
        """A survey of some of the rows, with the notes on sizes and travels that reading all of them would give.

        Raises
        ------
        InputError
            A unit is wrong, or two drives are declared in series.
        """
        notes = dict.fromkeys((*self.notes, *survey.notes))
        for label, own in survey.table.groupby("file", sort=False):
            frame = own.reset_index(drop=True)
            notes |= dict.fromkeys(f"{label}: {note}" for note in check_series(frame, self.machine, str(label)))
            notes |= dict.fromkeys(check_sizes(frame, self.machine, self.form.units, str(label), self.measured))
        notes |= dict.fromkeys(travel_notes(survey.table, self.machine))
        return replace(survey, notes=tuple(notes))

    def _of_file(self, file: RowsOfFile, places: Sequence[tuple[int, int]]) -> tuple[pd.DataFrame, list[str]]:
        frames, notes = [], list[str]()
        for table, ranges, plan, before in file.parts:
            end = before + len(ranges)
            own = [ranges.rows(max(a - before, 0), min(b, end) - before) for a, b in places if a < end and b > before]
            if not own:
                continue
            pieces = own[0] if len(own) == 1 else _Pieces(table.path, table.name, table.columns, tuple(own))
            # an empty block is no mistake, though an empty file would be
            part = read_part(pieces, plan, self.machine, self.form.units, measured=False)
            if part.dated and "time" in map(root, self.channels):
                found = "dates as times, which count from the first row"
                raise InputError(f"{table.name}, column time", found, f"Write seconds, or {WHOLE}")
            part.frame["row"] += before
            frames.append(part.frame)
            notes += [f"{file.label}: {note}" for note in part.notes]
        frame = frames[0] if len(frames) == 1 else pd.concat(frames, ignore_index=True)
        frame["file"], frame["role"] = file.label, file.entry.role
        return frame, notes

    def _as_survey(self, frames: list[pd.DataFrame], notes: list[str]) -> Survey:
        whole = frames[0] if len(frames) == 1 else pd.concat(frames, ignore_index=True)
        for name, what in (("joint", "error motions of one joint"), ("observation", "single readings")):
            if name in whole and (whole[name].fillna("") != "").any():
                at = int((whole[name].fillna("") != "").to_numpy().argmax())
                where = f"{whole['file'].iloc[at]}, row {whole['row'].iloc[at]}, column {name}"
                raise InputError(where, f"{what}, which are not fitted in a stream", f"Take them out, or {WHOLE}")
        table = mended(
            assemble([Part(whole.drop(columns=["joint", "observation"], errors="ignore"), False, ())], self.machine),
            self.machine,
        )
        if not self.measured:
            table, more = in_step(table, self.machine)
            notes = [*notes, *more]
        for name in self.channels:
            if name.startswith("dir_") and table[name].isna().any():
                at = int(table[name].isna().to_numpy().argmax())
                where = f"{table['file'].iloc[at]}, row {table['row'].iloc[at]}, column {name}"
                raise InputError(where, "no side of arrival", f"Write +1 or -1 in every row, or {WHOLE}")
        form = self.form
        rotation = None
        if form.frame_rotation is not None:
            x, y, z = np.radians(form.frame_rotation).tolist()
            rotation = (x, y, z)
        return Survey(
            table, form.frame, tuple(form.refit), form.instrument, self.source, tuple(dict.fromkeys(notes)),
            tuple(form.budget), frame_rotation=rotation, record=form.test, observations=form.observations,
            labelled="run" in whole,
        )  # fmt: skip


def open_rows(
    source: Path | str | pd.DataFrame, machine: Machine, measured: bool = True, *, every: bool = False
) -> SurveyRows:
    """Open a survey whose rows are read a range at a time.

    Parameters
    ----------
    source : Path, str or DataFrame
        As of `errormodel.survey.read_survey`.
    measured : bool
        Whether measured columns are required; False for commands.
    every : bool
        Read all columns, also those that the machine's model does not need, and leave it to the caller what follows
        from the course of the rows.

    Raises
    ------
    InputError
        It holds what cannot be had of a range of its rows, or is no survey.
    """
    from errormodel.chain import Chain

    path = Path(data_frame.FRAME_TABLE_NAME) if isinstance(source, pd.DataFrame) else Path(source)
    form, document, folder = read_form(path)
    if raw := next((entry for entry in form.files if entry.format), None):
        found = f"{raw.path}, a raw file ({raw.format}), which is read as a whole"
        raise InputError(str(path), found, "Import it into Parquet or CSV first, or leave out --stream")
    if form.logs:
        raise document.error(("logs",), "logs, which are joined to all rows", f"{WHOLE[0].upper()}{WHOLE[1:]}")
    if form.frame == "per-run" and not every:
        raise InputError(
            str(path), "frame: per-run, of which the frames are found from all rows",
            f"Give each run a file and write frame: per-file, or {WHOLE}",
        )  # fmt: skip
    opened: list[tuple[FileEntry, list[Table]]] = [
        (entry, [data_frame.table_of(source)] if isinstance(source, pd.DataFrame) else
         open_tables(folder / entry.path, entry.path))
        for entry in form.files
    ]  # fmt: skip
    check_map(document, machine, form.columns, [table for _, tables in opened for table in tables])
    channels = () if every else tuple(Chain(machine).channels)
    files, notes, named = list[RowsOfFile](), dict[str, None](), set[str]()
    for entry, tables in opened:
        label = entry.path if document.data else name_of(Path(entry.path))
        parts: list[tuple[Table, RowRanges, Plan, int]] = []
        before, all_columns = 0, set[str]()
        for table in tables:
            plan = planned(table, machine, form.columns, measured)
            if all_columns and (other := sorted(set(plan.ours) ^ all_columns)):
                found = f"not the same columns as in {tables[0].name}: {', '.join(other)}"
                raise InputError(f"{table.name}, header", found, "Give all parts of a folder the same columns")
            all_columns = set(plan.ours)
            named |= all_columns
            if not every:
                _check_course(table, plan, channels, measured)
            notes |= dict.fromkeys(f"{label}: {note}" for note in plan.notes)
            try:
                ranges = table.in_ranges()
                if not len(ranges):
                    raise NoRowsError(table.name)
            except NoRowsError:
                if len(tables) == 1:
                    raise
                notes[left_out(table)] = None
                continue
            parts.append((table, ranges, plan if every else _needed(plan, machine, channels, measured), before))
            before += len(ranges)
        if not parts:
            raise NoRowsError(entry.path)
        files.append(RowsOfFile(entry, label, tuple(parts)))
    check_units(document, machine, form.units, named)
    if measured and all(f.entry.role == "test" for f in files):
        raise document.error(("files",), "only test files", "Give at least one file the role fit")
    files.sort(key=lambda f: measured and f.entry.role == "test")
    stated = form.all_notes() if measured else []
    return SurveyRows(
        path, machine, form, document, tuple(files), channels, measured, frozenset(named), (*stated, *notes)
    )


def _needed(plan: Plan, machine: Machine, channels: tuple[str, ...], measured: bool) -> Plan:
    """The columns that a model of these channels needs: the others are not read."""
    wanted = {*machine_columns(machine), *(j.difference for j in machine.joints if j.drives), *TOOL_COLUMNS, *channels}
    wanted |= {"joint", "observation", "run"}
    if measured:
        wanted |= {*MEASURED, *ORIENTATION, *SIGMA_COLUMNS, "sigma"}
    return Plan({ours: theirs for ours, theirs in plan.ours.items() if ours in wanted}, plan.missing_joints, ())


def _check_course(table: Table, plan: Plan, channels: tuple[str, ...], measured: bool) -> None:
    """Raise InputError where a channel of the model is known from the course of all rows only."""
    where = f"{table.name}, header"
    if measured and ORIENTATION[0] in plan.ours:
        found = "orientations (mrx mry mrz), which are not fitted in a stream"
        raise InputError(where, found, f"Leave these columns out, or {WHOLE}")
    for name in channels:
        what = next((words for start, words in _BY_COURSE.items() if name.startswith(start)), "")
        if not what and name.startswith("T_") and "time" in plan.ours:
            what = "a smoothed temperature"
        if what:
            found = f"an effect of this machine needs {name}, {what}, which follows from the course of all rows"
            raise InputError(where, found, f"{WHOLE[0].upper()}{WHOLE[1:]}")
        if name.startswith("dir_") and name not in plan.ours:
            found = f"no column {name}, and the side of arrival follows from the course of all rows"
            raise InputError(where, found, f"Add {name}: +1 or -1 in every row; or {WHOLE}")


def ranges_of(count: int, size: int) -> Iterator[tuple[int, int]]:
    """Ranges of at most `size` rows that make up `count` rows."""
    return ((start, min(start + size, count)) for start in range(0, count, size))
