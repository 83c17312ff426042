"""Temperature sensors that are dead, stuck, torn off, loose or copies, and settings with gaps: these drive nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array
from errormodel.surveys.spikes import SPIKE_KELVIN, spikes
from errormodel.surveys.temperatures import HEATED, in_kelvin

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.survey import Survey

SETTINGS = ("feed", "load")  # of the rows
COLDEST, WARMEST = -60.0, 150.0  # degC, of machines and of the rooms they stand in
HOTTEST = 400.0  # degC, of what melts filament or is heated on purpose
STUCK = 0.5  # of the recording at one value to the last digit
STEPS = 20.0  # of a sensor's own resolution: by so much the others move meanwhile
COARSE = 0.1  # K, resolution of a sensor that never changes
BEFORE, SUDDEN = 10, 3.0  # rows before it got stuck, in which it moved by as many steps of its resolution
ALIVE = 0.5  # of the rows: a sensor with noise changes in most of them
NOISY = 0.05  # of the changes go back on the one before; where it warms, few
OTHER_UNIT = 2.0  # K, at most, from what the row before is in degF


def dead_sensors(survey: Survey) -> dict[str, str]:
    """Temperatures, feeds and loads of the rows to fit that must not drive anything, each with the reason.

    A sensor that follows something quick (a nozzle, a motor) is not dead: it moves on, or stays where it went.
    """
    table = survey.fit.table
    return copies(table) | faults(table) | incomplete(table)


def copies(table: pd.DataFrame) -> dict[str, str]:
    """Temperatures that are those of an earlier column in all rows, each with which: no two sensors have one noise."""
    first: dict[bytes, str] = {}
    reasons = {}
    for name in (str(c) for c in table.columns if str(c).startswith("T_")):
        values = table[name].to_numpy(dtype=np.float64) + 0.0
        if np.isnan(values).all() or np.nanmin(values) == np.nanmax(values):
            continue
        one = first.setdefault(np.where(np.isnan(values), np.nan, values).tobytes(), name)
        if one != name:
            reasons[name] = f"the same as {one} in all {len(table)} rows, a copy"
    return reasons


def incomplete(table: pd.DataFrame) -> dict[str, str]:
    """Feeds and loads that only some rows of a table have, each with what to write."""
    gaps = {name: int(table[name].isna().sum()) for name in SETTINGS if name in table}
    return {
        name: f"no value in {_rows(n, len(table))}. Write it in every row"
        for name, n in gaps.items()
        if 0 < n < len(table)
    }


def faults(table: pd.DataFrame) -> dict[str, str]:
    """The same of the rows of any table, in the order of time."""
    names = [str(c) for c in table.columns if str(c).startswith("T_")]
    values = {name: table[name].to_numpy(dtype=np.float64) for name in names}
    time = table["time"].to_numpy(dtype=np.float64) if "time" in table else None
    reasons = {}
    for name in names:
        others = [v for n, v in values.items() if n != name]
        if reason := _fault(name, values[name], others, time):
            reasons[name] = reason
    return reasons


def _fault(name: str, values: Array, others: list[Array], time: Array | None) -> str:
    """What is wrong with a sensor, or nothing."""
    n = len(values)
    gaps = int(np.isnan(values).sum())
    if gaps:
        return f"no value in {_rows(gaps, n)}"
    absurd = (values < COLDEST) | (values > (HOTTEST if HEATED.search(name) else WARMEST))
    if absurd.any():
        low, high = (f"{x:.4g}" for x in (values[absurd].min(), values[absurd].max()))
        text = f"{low if low == high else f'{low} to {high}'} degC in {_rows(int(absurd.sum()), n)}"
        return f"{text}, as of K (units: {{{name}: K}})" if in_kelvin(name, values) else text
    start, end = _longest(values)
    if end - start > max(STUCK * n, 2):
        steps = np.abs(np.diff(values))
        resolution = float(steps.min(where=steps > 0, initial=np.inf)) if steps.any() else COARSE
        moved = _moved(others, start, end)
        # a thermostat arrives slowly, and what has not been switched on yet waits for it
        sudden = abs(values[start] - values[max(start - BEFORE, 0)]) > SUDDEN * resolution or end - start == n
        if moved > STEPS * resolution and sudden:
            return f"stuck at {values[start]:.4g} degC in {_rows(end - start, n)} while others move by {moved:.1f} K"
    if silent := _silent(values, others):
        return silent
    if jumps := int(spikes(values, time).sum()):
        return f"jumps by more than {SPIKE_KELVIN:.0f} K and back in {_rows(jumps, n)}"
    return "" if HEATED.search(name) else _changed_unit(values)


def _rows(count: int, n: int) -> str:
    return "all rows" if count == n else f"{count} of {n} rows"


def _moved(others: list[Array], start: int, end: int) -> float:
    """How far the sensor among the others that moved most did so in a stretch of rows, K."""
    return max((float(np.ptp(v[start:end])) for v in others if np.isfinite(v).all()), default=0.0)


def _longest(values: Array) -> tuple[int, int]:
    """First and last (exclusive) row of the longest stretch of one value."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(values)) + 1, [len(values)]])
    longest = int(np.argmax(np.diff(edges))) if len(values) else 0
    return int(edges[longest]), int(edges[longest + 1]) if len(values) else 0


def _silent(values: Array, others: list[Array]) -> str:
    """What is wrong with a sensor that had noise from row to row, and from some row on to the end none any more."""
    n, changes = len(values), np.flatnonzero(np.diff(values))
    start = int(changes[-1]) + 1 if len(changes) else 0
    steps = np.diff(values)[changes]
    back = np.mean(steps[1:] * steps[:-1] < 0) if len(steps) > 1 else 0.0  # what arrives and is held goes one way
    if not start or n - start < BEFORE or len(changes) < ALIVE * start or back < NOISY:
        return ""
    resolution = float(np.abs(steps).min())
    moved = _moved(others, start, n)
    if moved < STEPS * resolution:
        return ""
    return f"stuck at {values[start]:.4g} degC from row {start + 1} of {n} on while others move by {moved:.1f} K"


def _changed_unit(values: Array) -> str:
    """What is wrong with a sensor that goes on in degF, or in degC, from some row on."""
    before, after = values[:-1], values[1:]
    for cold, warm, units in ((before, after, "degC to degF"), (after, before, "degF to degC")):
        rows = np.flatnonzero((np.abs(1.8 * cold + 32 - warm) < OTHER_UNIT) & (np.abs(warm - cold) > SPIKE_KELVIN))
        if len(rows):
            row = int(rows[0]) + 1
            return f"goes from {values[row - 1]:.4g} to {values[row]:.4g} at row {row + 1}, as from {units}"
    return ""
