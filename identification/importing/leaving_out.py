"""Rows of raw files that the user leaves out: the files stay as they are, and the pairs do without them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from errormodel.exceptions import InputError, nearest
from errormodel.machine import Machine
from errormodel.surveys.columns import MEASURED, READINGS
from identification.importing.roles import Kind
from identification.importing.sources import SourceFile, Wishes, open_source

OPTION = "--leave-out"
COUNTED = ("points", "single")  # what files hold whose rows can be left out


def rows_of(texts: Sequence[str]) -> dict[str, list[int]]:
    """Rows, counted from 1, by the name of their file; under "" those of the only one.

    Parameters
    ----------
    texts : ``27,41-45`` or ``tracker.csv:27``.

    Raises
    ------
    InputError
        A part is none of these.
    """
    out: dict[str, list[int]] = {}
    for text in texts:
        name, _, parts = text.rpartition(":")
        for part in parts.split(","):
            match = re.fullmatch(r"\s*(\d+)\s*(?:-\s*(\d+)\s*)?", part)
            first, last = (int(match[1]), int(match[2] or match[1])) if match else (0, 0)
            if not 0 < first <= last:
                raise InputError(OPTION, f"'{text}'", "Write rows such as 27,41-45, or tracker.csv:27")
            out.setdefault(name.strip(), []).extend(range(first, last + 1))
    return out


def open_measured(path: Path, machine: Machine, kind: Kind, wishes: Wishes, several: bool) -> SourceFile:
    """A file with what was measured, read so that text in a row that is left out makes no column of numbers text.

    Raises
    ------
    InputError
        See `open_source`.
    """
    left = {row - 1 for row in wishes.leave_out.get(path.name, wishes.leave_out.get("", ()))}
    if left:
        source = open_source(path, machine, kind, wishes, several, lambda row: row not in left)
        if source.what in COUNTED and source.recording.a_row_each:
            return source
    return open_source(path, machine, kind, wishes, several)


def without_rows(sources: Sequence[SourceFile], left: Mapping[str, Sequence[int]]) -> list[SourceFile]:
    """Files of points and of single readings, in which the rows that are left out hold nothing measured.

    Raises
    ------
    InputError
        There is no such file or row, or it is not said of which file it is.
    """
    names = {s.raw.path.name: s for s in sources if s.what in COUNTED}
    out = []
    for name in left:
        if name not in names and (name or len(names) != 1):
            cure = nearest(name, names) if name and names else f"Write {next(iter(names), 'FILE')}:.. before the rows"
            raise InputError(
                OPTION, f"'{name}', no file of points or single readings" if name else "of which file", cure
            )
    for source in sources:
        own = left.get(source.raw.path.name, left.get("") if source.raw.path.name in names else None)
        out.append(source if own is None else _without(source, own))
    return out


def _without(source: SourceFile, rows: Sequence[int]) -> SourceFile:
    if max(rows) > source.rows:
        raise InputError(OPTION, f"row {max(rows)} of {source.raw.path.name}", f"It has {source.rows} rows")
    frame = source.recording.frame.copy()
    measured = [c for c in (*MEASURED, *READINGS) if c in frame]
    frame.loc[np.array(rows) - 1, measured] = np.nan
    shown = ", ".join(map(str, sorted({*rows})))
    notes = (*source.recording.notes, f"rows {shown} left out, as asked")
    return replace(source, recording=replace(source.recording, frame=frame, notes=notes))
