"""Recordings on clocks of their own (``logs:`` of a ``survey.yaml``), read at the times of a survey's rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from errormodel.exceptions import InputError
from errormodel.raw_formats.base import Recording
from errormodel.surveys.checks import Part
from errormodel.surveys.file import LogEntry
from errormodel.surveys.missing_values import below_absolute_zero

if TYPE_CHECKING:
    import pandas as pd

Log: TypeAlias = tuple[LogEntry, Recording]


def with_logs(table: pd.DataFrame, dated: bool, logs: Sequence[Log], name: str) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Rows of a file with the channels of all logs, and notes.

    Parameters
    ----------
    table : with ``time`` in s, since 1970 where its times were dates (`dated`).
    name : of the file, for messages.
    """
    notes, own = list[str](), {*map(str, table)}
    for log, recording in logs:
        both = [c for c in channels_of(recording) if c in own]
        if both:
            notes.append(f"{', '.join(both)}: as {log.path} has it, in place of the file's own column")
        table = with_log(table, dated, recording, log, name)
    return table, tuple(notes)


def part_with_logs(part: Part, logs: Sequence[Log], name: str) -> Part:
    """The rows of a survey's own table with the channels of all logs, checked as those of the table are."""
    frame, notes = with_logs(part.frame, part.dated, logs, name)
    for sensor, rows, note in below_absolute_zero(frame):
        frame.loc[rows, sensor] = np.nan
        notes = (*notes, note)
    read = (n for entry, recording in logs if not entry.sha256 for n in recording.notes)
    return Part(frame, part.dated, (*part.notes, *read, *notes))


def channels_of(recording: Recording) -> list[str]:
    """Columns of a log that rows take from it."""
    return [c for c in map(str, recording.frame) if c.startswith(("T_", "w_")) or c in ("feed", "load")]


def with_log(table: pd.DataFrame, dated: bool, recording: Recording, log: LogEntry, name: str) -> pd.DataFrame:
    """Rows with the channels of a log, linear between its readings; empty outside them.

    Raises
    ------
    InputError
        One of the two has no time, or they do not overlap.
    """
    for frame, of in ((table, name), (recording.frame, log.path)):
        if "time" not in frame or frame["time"].isna().all():
            raise InputError(of, "no time, by which a log is joined", "Say columns: {time: ..}, or leave the log out")
    if dated != recording.dated and not log.offset:
        found = f"{log.path if recording.dated else name} has dates, {name if recording.dated else log.path} seconds"
        raise InputError(log.path, found, _add(table["time"], recording.frame["time"]))
    when = table["time"].to_numpy(dtype=np.float64)
    clock = recording.frame["time"].to_numpy(dtype=np.float64) + log.offset
    channels = channels_of(recording)
    if not channels:
        raise InputError(log.path, "no channels", "Say columns: {T_bed: ..}, for each sensor")
    inside = (when >= np.nanmin(clock)) & (when <= np.nanmax(clock))
    if not inside.any():
        found = f"it runs from {_moment(np.nanmin(clock), dated)} to {_moment(np.nanmax(clock), dated)}, "
        found += f"the measurements from {_moment(np.nanmin(when), dated)} to {_moment(np.nanmax(when), dated)}"
        raise InputError(log.path, found, _add(table["time"], recording.frame["time"]))
    out = table.copy()
    for channel in channels:
        values = recording.frame[channel].to_numpy(dtype=np.float64)
        good = np.isfinite(values) & np.isfinite(clock)
        order = np.argsort(clock[good], kind="stable")
        if good.any():
            out[channel] = np.where(inside, np.interp(when, clock[good][order], values[good][order]), np.nan)
    return out


def _add(when: pd.Series[Any], clock: pd.Series[Any]) -> str:
    """What to write so that the times of a log are those of the measurements."""
    together = float(np.nanmin(when) - np.nanmin(clock))
    return (
        "Say what to add to its times: offset: (s) in survey.yaml, or --log-offset; "
        f"{together:.10g} lays its first row on the first measurement"
    )


def _moment(seconds: float, dated: bool) -> str:
    return str(np.datetime64(round(seconds), "s")) if dated else f"{seconds:.10g} s"
