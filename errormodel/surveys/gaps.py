"""Missing values between recorded ones: temperatures interpolated over time, loads that were held; with notes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, partial
from itertools import pairwise

import numpy as np
import pandas as pd

from errormodel.arrays import Array, Index
from errormodel.exceptions import InputError
from errormodel.formats.base import spoken
from errormodel.surveys.spikes import SOON, spikes
from errormodel.surveys.temperatures import HEATED

# K rms, largest interpolation error of known readings; by judgement: the noise of usual sensors is smaller
SENSOR_NOISE_KELVIN = 0.3
# largest share of missing rows of one clock: some eight stretches as long as a gap then show how far lines are off
MOST_GAPS_SHARE = 0.1
SHORT_GAP_ROWS = 3  # consecutive missing rows up to which `SENSOR_NOISE_KELVIN` alone decides; by judgement
# largest interpolation error in a longer gap, as a share of the sensor's standard deviation over the survey, beyond
# what one reading is off its neighbours: of an effect of ten times the noise, a filled row is then off by the noise
UNKNOWN_SHARE = 0.1
MOST_TRIED = 16  # missing rows of a gap at which lines are tried: of a long one its errors are smooth along it
# longest gap over the usual time of as many readings; by judgement: temperatures after a longer pause are unknown
LONGEST_PAUSE_RATIO = 3.0
LEAST_SAID_KELVIN = 0.001  # smaller errors are not told apart in notes
EACH_ROW_ITS_LOAD = "Write the load of every row, 0 where there was none; or leave the column out"


@dataclass(frozen=True)
class Lines:
    """Lines over known readings: their error where it is largest (K rms), the largest rise (K), the usual span."""

    error: float
    rise: float
    span: float


@dataclass(frozen=True)
class Gap:
    """A gap that was filled: from the reading before to the one after (s or rows), and the error of such lines, K."""

    span: float
    error: float


def filled(table: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """Table with gaps of its temperatures interpolated linearly over time, loads held (`_with_loads`), and notes.

    Without time the order of the rows replaces it. Neighbours are of one file, and of one run where times go back. A
    gap is filled if known readings, left out in turn over as many rows, lie within `SENSOR_NOISE_KELVIN` (rms, where
    they do worst) of such lines; a long one if they do so within `UNKNOWN_SHARE` of what the sensor varies by, too.

    Parameters
    ----------
    table : the table of a survey, temperatures in degC, loads in kg.

    Raises
    ------
    InputError
        A file has the load of some rows, and nothing tells that of another.
    """
    table, notes = _with_loads(table)
    courses = list(_courses(table))
    table, said = _without_spikes(table, courses)
    names = [str(n) for n in table if str(n).startswith("T_") and table[n].isna().any()]
    notes += said
    if not names:
        return table, notes
    out = table.copy()
    for name in names:
        values = table[name].to_numpy(dtype=np.float64).copy()
        known = values[np.isfinite(values)]
        varies = float(known.std()) if len(known) else 0.0
        for rows, time, timed in courses:
            own = values[rows]
            values[rows], gaps = _interpolated(own, time, varies)
            if gaps:
                now = rows[np.isnan(own) & ~np.isnan(values[rows])]
                notes.append(_note(name, table, now, gaps, timed))
        out[name] = values
    return out, notes


def _without_spikes(table: pd.DataFrame, courses: list[tuple[Index, Array, bool]]) -> tuple[pd.DataFrame, list[str]]:
    """Table without single readings of temperatures that jump off and back within minutes (`spikes`), and notes.

    Where they are more than `MOST_GAPS_SHARE` of the rows the sensor is loose, and all of it stays as it was read.
    """
    out, notes = table, list[str]()
    for name in (str(n) for n in table if str(n).startswith("T_") and not HEATED.search(str(n))):
        values = table[name].to_numpy(dtype=np.float64)
        for rows, time, timed in courses:
            jumps = rows[spikes(values[rows], time)] if timed else rows[:0]
            if not len(jumps) or len(jumps) > MOST_GAPS_SHARE * len(rows):
                continue
            out = table.copy() if out is table else out
            out.loc[out.index[jumps], name] = np.nan
            read = values[jumps]
            said = f"{read.min():.4g}" + ("" if read.min() == read.max() else f" to {read.max():.4g}")
            numbers = sorted(table["row"].iloc[jumps].tolist())
            notes.append(
                f"{table['file'].iloc[rows[0]]}: {name} jumps to {said} degC and back within {SOON:.0f} s in "
                f"{spoken(numbers)}, which nothing that weighs something does: read as not measured"
            )
    return out, notes


def _with_loads(table: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """Table in which an empty load between two equal ones is that load, and notes.

    A load is set and stays until another one is. Of gaps in more than `MOST_GAPS_SHARE` of the rows, or as long as the
    shortest stretch of rows with one load, it may as well have been another one. A file without any load is left as
    it is.

    Raises
    ------
    InputError
        An empty load lies between different ones, before the first or after the last, or may be another one.
    """
    if "load" not in table or not table["load"].isna().any():
        return table, []
    values, notes = table["load"].to_numpy(dtype=np.float64).copy(), list[str]()
    recorded = table["load"].notna().groupby(table["file"]).transform("any").to_numpy(dtype=bool)
    for rows, _, _ in _courses(table):
        gap = np.isnan(values[rows])
        if not gap.any() or not recorded[rows].any():
            continue
        own = np.where(gap, -np.inf, values[rows])  # gaps are equal to each other, and to no load
        stretches = np.split(np.arange(len(own)), np.flatnonzero(own[1:] != own[:-1]) + 1)
        for empty in (s for s in stretches if gap[s[0]]):
            first, last = int(empty[0]), int(empty[-1])
            before, after = own[first - 1] if first else -np.inf, own[last + 1] if last + 1 < len(own) else -np.inf
            if before != after or before == -np.inf:
                raise _unknown_load(table, rows, first, _differ(before, after))
            own[empty] = before
        held = np.diff(np.flatnonzero(np.concatenate([[True], own[1:] != own[:-1], [True]]))).min()
        for empty in (s for s in stretches if gap[s[0]]):
            if gap.sum() > MOST_GAPS_SHARE * len(own) or len(empty) >= held:
                why = f"{int(gap.sum())} of {len(own)} rows have none, and a load stands for as few as {held}"
                raise _unknown_load(table, rows, int(empty[0]), f"and though it is {own[empty[0]]:g} kg around, {why}")
        values[rows] = own
        loads = " and ".join(f"{load:g}" for load in np.unique(own[gap]))
        numbers = sorted(table["row"].iloc[rows[gap]].tolist())
        notes.append(
            f"{table['file'].iloc[rows[0]]}: load has no value in {spoken(numbers)}: taken as the {loads} kg before "
            "and after. Write it there if it was another one"
        )
    return table.assign(load=values), notes


def _differ(before: float, after: float) -> str:
    """That the loads beside a gap do not tell what it was; -inf: there is none."""
    if before == after:
        return "nor in another row of its run"
    if -np.inf in (before, after):
        return f"and none {'before' if before == -np.inf else 'after'} it"
    return f"between {before:g} and {after:g} kg"


def _unknown_load(table: pd.DataFrame, rows: Index, first: int, why: str) -> InputError:
    """Of a row, the number `first` of a course, nothing tells the load."""
    at = rows[first]
    where = f"{table['file'].iloc[at]}, row {table['row'].iloc[at]}, column load"
    return InputError(where, f"no value, {why}", EACH_ROW_ITS_LOAD)


def _note(name: str, table: pd.DataFrame, rows: Index, gaps: list[Gap], timed: bool) -> str:
    """Which readings are interpolated, over what, and how well they are known."""
    file, numbers = table["file"].iloc[rows[0]], sorted(table["row"].iloc[rows].tolist())
    cells = "1 cell" if len(rows) == 1 else f"{len(rows)} cells"
    longest, error = max(gap.span for gap in gaps), max(gap.error for gap in gaps)
    span = f"{longest:.0f} s" if timed else f"{longest:.0f} rows"
    return (
        f"{file}: {name} has no value in {spoken(numbers)}: {cells} interpolated between the readings "
        f"before and after, {'at most ' if len(gaps) > 1 else ''}{span} apart; other readings lie within "
        f"{max(error, LEAST_SAID_KELVIN):.2g} K (rms) of such lines"
    )


def _courses(table: pd.DataFrame) -> Iterator[tuple[Index, Array, bool]]:
    """Rows of one clock in order of time, their times (row numbers without a column ``time``), and whether in s."""
    for own in table.groupby("file", sort=False).indices.values():
        rows = np.sort(own)
        timed = "time" in table and bool(table["time"].iloc[rows].notna().all())
        time = table["time"].to_numpy(dtype=np.float64)[rows] if timed else np.arange(len(rows), dtype=np.float64)
        apart = not timed or bool((np.diff(time) < 0).any())
        run = table["run"].astype(str).to_numpy()[rows] if apart else np.zeros(len(rows))
        for label in np.unique(run):
            which = np.flatnonzero(run == label)
            which = which[np.argsort(time[which], kind="stable")]
            yield rows[which], time[which], timed


def _interpolated(values: Array, time: Array, varies: float) -> tuple[Array, list[Gap]]:
    """Readings (n,) in order of time, those gaps filled in which interpolation reproduces known readings; the gaps."""
    gap = np.isnan(values)
    if not gap.any() or gap.sum() > MOST_GAPS_SHARE * len(values):
        return values, []
    out, known, gaps = values.copy(), np.flatnonzero(~gap), list[Gap]()
    lines = cache(partial(_lines, values, time))  # of gaps of one size they are the same
    for before, after in pairwise(known.tolist()):
        size = after - before - 1
        if not size or (tried := lines(size)) is None:
            continue
        most = SENSOR_NOISE_KELVIN
        if size > SHORT_GAP_ROWS:
            single = lines(1)
            most = min(most, float(np.hypot(UNKNOWN_SHARE * varies, single.error if single else 0.0)))
        span = float(time[after] - time[before])
        if tried.error > most or span > LONGEST_PAUSE_RATIO * tried.span:
            continue
        if abs(values[after] - values[before]) <= tried.rise + SENSOR_NOISE_KELVIN:
            inner = np.arange(before + 1, after)
            out[inner] = _line(values, time, np.full(size, before), np.full(size, after), inner)
            gaps.append(Gap(span, tried.error))
    return out, gaps


def _lines(values: Array, time: Array, size: int) -> Lines | None:
    """Lines over all stretches of known readings with so many rows between their ends; None where there are none."""
    starts = np.arange(max(len(values) - size - 1, 0))
    missing = np.append(0, np.cumsum(np.isnan(values)))
    starts = starts[missing[starts + size + 2] == missing[starts]]
    if not len(starts):
        return None
    ends = starts + size + 1
    squares = []
    for k in np.unique(np.linspace(1, size, min(size, MOST_TRIED)).round().astype(np.intp)):
        off = _line(values, time, starts, ends, starts + k) - values[starts + k]
        squares.append(float(np.mean(off**2)))
    rise = float(np.abs(values[ends] - values[starts]).max())
    return Lines(float(np.sqrt(max(squares))), rise, float(np.median(time[ends] - time[starts])))


def _line(values: Array, time: Array, start: Index, end: Index, at: Index) -> Array:
    """Values at rows `at` on lines from rows `start` to rows `end`; their mean where no time passes."""
    span = time[end] - time[start]
    part = np.where(span > 0, (time[at] - time[start]) / np.where(span > 0, span, 1.0), 0.5)
    out: Array = values[start] + part * (values[end] - values[start])
    return out
