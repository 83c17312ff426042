"""Columns of a table in text as numbers, seconds and text, with their units and lines."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from errormodel.exceptions import InputError
from errormodel.formats.base import LISTED_ROWS, as_numbers, spoken, words_note
from errormodel.formats.digit_groups import ungrouped
from errormodel.raw_formats.base import Asked, RawFile, Recording
from errormodel.raw_formats.cells import is_failed, kind_of
from errormodel.raw_formats.dates import Times, looks_like_time, times_of
from errormodel.raw_formats.layout import DELIMITERS, Layout

if TYPE_CHECKING:
    import pandas as pd

_WORD = re.compile(r"[^\W\d_]{3}|[#*?/]")  # no number has three letters in a row, but for nan and inf
CELL_CURE = "Correct the cell; where nothing was measured leave it empty, or write lost"
DATES_CURE = "Say which with --dates day-first or --dates month-first (in survey.yaml, dates: day-first)"


def table_of_text(raw: RawFile) -> Layout:
    """The table in a file.

    Raises
    ------
    InputError
        There is none.
    """
    try:
        table = raw.layout
    except InputError as error:
        raise InputError(f"{raw.name}, {error.where}", error.found, error.cure) from error
    if table is None:
        raise InputError(raw.name, "no rows of numbers of equal width", "Give the file as the instrument wrote it")
    return table


def columns_of(raw: RawFile, asked: Asked, by_rows: bool = False) -> Recording:
    """All columns of the table in a file, under the file's own names.

    Columns of dates, and of a date and a time beside it, become the column ``time`` in seconds since 1970.

    Parameters
    ----------
    raw, asked : see `RawFormat.read`.
    by_rows : whether the format makes one row of each row of the table, so that `RawFile.counts` is about these.

    Raises
    ------
    InputError
        Cells cannot be read, or the order of day and month is open.
    """
    import pandas as pd

    table = table_of_text(raw)
    if by_rows and raw.counts is not None:
        table = table.judged(raw.counts)
    texts = {name: pd.Series(table.column(k), dtype="str") for k, name in enumerate(table.names)}
    numeric = [name for k, name in enumerate(table.names) if table.numeric(k)]
    # a comma within a cell, between quotes where commas separate the cells
    comma = table.delimiter != "," or any(texts[n].str.contains(",", regex=False).any() for n in numeric)
    wordy = [n for k, n in enumerate(table.names) if n in numeric and _WORD.search("".join(table.column(k)))]
    failed: dict[str, set[int]] = {}  # rows by the word that stands there
    for name in wordy:
        said = texts[name].map(is_failed).astype(bool)
        for row in np.flatnonzero(said).tolist():
            failed.setdefault(texts[name][row], set()).add(row + 1)
        texts[name] = texts[name].mask(said, "")
    columns: dict[str, object] = {}
    notes: list[str | None] = list(table.notes)
    if failed:
        notes.append(
            f"no value where it says {', '.join(sorted(failed))}: {spoken(sorted(set().union(*failed.values())))}"
        )
    if table.delimiter != ",":
        notes.append(f"columns separated by {DELIMITERS[table.delimiter]}")
    fortran = {
        n: texts[n].str.replace(r"(?<=\d)[dD](?=[-+]?\d)", "e", regex=True) if _has_d(table.column(k)) else texts[n]
        for k, n in enumerate(table.names)
        if n in numeric
    }
    cells = ungrouped(fortran)
    if cells.ambiguous is not None:
        column, row = cells.ambiguous
        cell = str(cells.columns[column][row])
        plain = cell.replace(".", "").replace(",", "")
        found = f"'{cell}' in a file with another decimal sign: {plain} in groups of digits, or a number with decimals"
        cure = "Write the file with one decimal sign and no groups of digits"
        raise InputError(f"{raw.name}, line {table.lines[row]}, column {column}", found, cure)
    if cells.separators:
        notes.append("digits in groups of three")
    if comma and any(text.str.contains(",", regex=False).any() for text in cells.columns.values()):
        notes.append("decimal commas")
    for name in table.names:
        if name in cells.columns:
            values, bad = as_numbers(cells.columns[name], comma)
            if bad.any():
                row = int(bad.argmax())
                where = f"{raw.name}, row {row + 1} (line {table.lines[row]}), column {name}"
                raise InputError(where, f"'{texts[name][row]}' is not a number as the others are", CELL_CURE)
            columns[name] = values
            notes.append(words_note(name, texts[name]))
        else:
            columns[name] = texts[name]
    units = {name: unit for name, unit in zip(table.names, table.units, strict=True) if unit}
    frame = pd.DataFrame(columns)
    time = _time(raw, table, texts, asked)
    if time is not None:
        used, times = time
        frame = frame.drop(columns=[n for n in used if n != "time"])
        frame["time"] = times.seconds
        units = {n: u for n, u in units.items() if n not in used}
        if times.order:
            notes.append(f"dates read {times.order.replace('-', ' ')}")
    dated = time is not None and time[1].dated
    if table.length_unit:
        notes.append(f"coordinates without a unit are in {table.length_unit}, as a line above the table says")
    spoken_of = (*raw.notes, *(n for n in notes if n))
    return Recording(frame, units, table.lines, spoken_of, dated, length_unit=table.length_unit)


def _has_d(cells: Sequence[str]) -> bool:
    """Whether a letter stands in a column that is the sign of an exponent in Fortran."""
    text = "".join(cells)
    return "d" in text or "D" in text


def _time(
    raw: RawFile, table: Layout, texts: dict[str, pd.Series[str]], asked: Asked
) -> tuple[list[str], Times] | None:
    """The columns that hold the time as text, and the time."""
    own = [n for n in table.names if any(looks_like_time(c) for c in texts[n].head(20) if c)]
    own = [n for n in own if not table.numeric(table.names.index(n))]
    if not own:
        return None
    used = own[:1]
    cells = texts[own[0]]
    follows = table.names[table.names.index(own[0]) + 1 :][:1]
    if follows and follows[0] in own and not cells.str.contains(":").any():  # a date, and a time of day beside it
        used = [own[0], follows[0]]
        cells = cells + " " + texts[follows[0]]
    times = times_of(cells, asked.dates)
    if times is None:
        return None
    if times.open:
        found = f"'{times.open}', whose day and month may be either"
        raise InputError(f"{raw.name}, column {own[0]}", found, DATES_CURE)
    bad = np.isnan(times.seconds) & (cells.str.strip() != "").to_numpy(dtype=bool)
    if bad.any():
        row = int(bad.argmax())
        where = f"{raw.name}, line {table.lines[row]}, column {own[0]}"
        raise InputError(where, f"'{cells[row]}', a date that no calendar has", DATES_CURE)
    return used, times


def numbers(recording: Recording, name: str, where: str) -> NDArray[np.float64]:
    """A column of numbers; `where` is the file's name.

    Raises
    ------
    InputError
        It holds text, or an infinite number.
    """
    column = recording.frame[name]
    if column.dtype.kind != "f":
        raise no_numbers(recording, [name], where)
    values = column.to_numpy(dtype=np.float64)
    if np.isinf(values).any():
        raise InputError(f"{where}, column {name}", "an infinite number", "Give the file as it was written")
    return values


def no_numbers(recording: Recording, names: Sequence[str], where: str, leave_out: bool = False) -> InputError:
    """The refusal of columns of numbers in which some cells hold text, with the rows of all of them.

    Parameters
    ----------
    names : the columns, under their names in the recording.
    where : the file's name.
    leave_out : whether rows of it can be left out.
    """
    cells = {name: [str(cell).strip() for cell in recording.frame[name]] for name in names}
    words = [(row, name) for name in names for row, cell in enumerate(cells[name]) if kind_of(cell) == "text"]
    if not words:
        return InputError(f"{where}, column {names[0]}", "no number in any row", "Give the file that has the values")
    row, name = min(words, key=lambda word: word[0])
    rows = sorted({k + 1 for k, _ in words})
    line = f" (line {recording.lines[row]})" if recording.lines else ""
    found = f"'{cells[name][row]}', which is no number"
    found += f"; text among numbers in {spoken(rows)}" if len(rows) > 1 else ""
    cure = CELL_CURE
    if leave_out:
        shown = f"{','.join(map(str, rows[:LISTED_ROWS]))}{',..' if len(rows) > LISTED_ROWS else ''}"
        cure += f". A row that counts for nothing need not be changed: --leave-out {shown}"
    return InputError(f"{where}, row {row + 1}{line}, column {name}", found, cure)


def renamed(recording: Recording, names: dict[str, str], notes: Sequence[str] = ()) -> Recording:
    """A recording with some columns under the toolkit's names; `names` maps the file's names to these."""
    names = {old: new for old, new in names.items() if old in recording.frame}
    frame = recording.frame.rename(columns=names)
    units = {names.get(name, name): unit for name, unit in recording.units.items()}
    return replace(recording, frame=frame, units=units, notes=(*recording.notes, *notes))
