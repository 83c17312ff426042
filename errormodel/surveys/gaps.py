"""Linear interpolation of single missing readings of temperature sensors, with a note for each."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pandas as pd

from errormodel.arrays import Array, Index
from errormodel.formats.base import spoken

# K rms, largest interpolation error of known readings; by judgement: the noise of usual sensors is smaller
SENSOR_NOISE_KELVIN = 0.3
MOST_GAPS_SHARE = 0.1  # largest share of missing rows of one clock; by judgement
LONGEST_GAP_ROWS = 3  # most consecutive missing rows; by judgement
# longest gap over the usual time of as many readings; by judgement: temperatures after a longer pause are unknown
LONGEST_PAUSE_RATIO = 3.0


def filled(table: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """Table with short gaps of its temperatures interpolated linearly over time, and notes.

    Without time the order of the rows replaces it. Neighbours are of one file, and of one run where times go back. A
    gap is filled if known readings, left out in turn, lie within `SENSOR_NOISE_KELVIN` (rms) of such lines.

    Parameters
    ----------
    table : the table of a survey, temperatures in degC.
    """
    names = [str(n) for n in table if str(n).startswith("T_") and table[n].isna().any()]
    if not names:
        return table, []
    out, notes, courses = table.copy(), list[str](), list(_courses(table))
    for name in names:
        values = table[name].to_numpy(dtype=np.float64).copy()
        for rows, time in courses:
            own = values[rows]
            values[rows] = _interpolated(own, time)
            now = rows[np.isnan(own) & ~np.isnan(values[rows])]
            if len(now):
                file, numbers = table["file"].iloc[now[0]], sorted(table["row"].iloc[now].tolist())
                cells = "1 cell" if len(now) == 1 else f"{len(now)} cells"
                notes.append(
                    f"{file}: {name} has no value in {spoken(numbers)}: {cells} interpolated between the readings "
                    "before and after"
                )
        out[name] = values
    return out, notes


def _courses(table: pd.DataFrame) -> Iterator[tuple[Index, Array]]:
    """Rows of one clock in order of time, and their times (row numbers without a column ``time``)."""
    for own in table.groupby("file", sort=False).indices.values():
        rows = np.sort(own)
        timed = "time" in table and table["time"].iloc[rows].notna().all()
        time = table["time"].to_numpy(dtype=np.float64)[rows] if timed else np.arange(len(rows), dtype=np.float64)
        apart = not timed or bool((np.diff(time) < 0).any())
        run = table["run"].astype(str).to_numpy()[rows] if apart else np.zeros(len(rows))
        for label in np.unique(run):
            which = np.flatnonzero(run == label)
            which = which[np.argsort(time[which], kind="stable")]
            yield rows[which], time[which]


def _interpolated(values: Array, time: Array) -> Array:
    """Readings (n,) in order of time, with those gaps filled in which interpolation reproduces known readings."""
    gap = np.isnan(values)
    if not gap.any() or gap.sum() > MOST_GAPS_SHARE * len(values):
        return values
    out, known = values.copy(), np.flatnonzero(~gap)
    for before, after in pairwise(known):
        size = int(after - before - 1)
        if not 0 < size <= LONGEST_GAP_ROWS:
            continue
        starts = np.arange(len(values) - size - 1)
        starts = starts[~np.isnan(values[starts]) & ~np.isnan(values[starts + size + 1])]
        starts = starts[starts != before]
        ends = starts + size + 1
        if not len(starts):
            continue
        inside = [starts + k for k in range(1, size + 1)]
        off = np.concatenate([_line(values, time, starts, ends, at) - values[at] for at in inside])
        off = off[~np.isnan(off)]
        rise, span = np.abs(values[ends] - values[starts]), time[ends] - time[starts]
        error = float(np.sqrt(np.mean(off**2))) if len(off) else np.inf
        if error > SENSOR_NOISE_KELVIN or time[after] - time[before] > LONGEST_PAUSE_RATIO * np.median(span):
            continue
        if abs(values[after] - values[before]) <= rise.max() + SENSOR_NOISE_KELVIN:
            inner = np.arange(before + 1, after)
            out[inner] = _line(values, time, np.full(size, before), np.full(size, after), inner)
    return out


def _line(values: Array, time: Array, start: Index, end: Index, at: Index) -> Array:
    """Values at rows `at` on lines from rows `start` to rows `end`; their mean where no time passes."""
    span = time[end] - time[start]
    part = np.where(span > 0, (time[at] - time[start]) / np.where(span > 0, span, 1.0), 0.5)
    out: Array = values[start] + part * (values[end] - values[start])
    return out
