"""Temperatures as courses in time: the clocks that they are on, and the noise of their sensors, which is smoothed."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import MAD_STD, Array, Index
from errormodel.row_order import label_numbers

if TYPE_CHECKING:
    import pandas as pd

# s, standard deviation of the weights: the fastest members follow the air in some ten minutes
SMOOTHING_SECONDS = 240.0
# K rms, least misfit of one common clock that shows clocks of their own for the runs; sensors' noise leaves 0.05
CLOCK_MISFIT_KELVIN = 0.1
# standard deviations of a sensor's noise, beyond which a row departs from a course by more than noise: of 50 sensors in
# recordings of six simulators by others 47 departed by 4.5 at most, and three that did by 6 were predicted as well, or
# better, as they were given
NOISE_REACHES = 5.0


def settled(table: pd.DataFrame, names: Iterable[str]) -> pd.DataFrame:
    """Table with the named temperatures smoothed over time by local linear regression, one clock at a time (`clocks`).

    A member's temperature changes slowly, whereas a sensor adds noise to each row, which an effect of 10 um/K would
    carry into every prediction. The window of `SMOOTHING_SECONDS` removes most of it and keeps changes that take longer
    than a quarter of an hour, at any rate of rows. A table without time, or rows at one time (states given for a
    prediction), are left as they are. So is a column of which the table states the noise (`noise_name`) where a row
    departs from the course by more: its rows are states of their own, or it changes faster than the window follows.
    """
    names = [n for n in names if n in table and table[n].notna().all()]
    if not names or "time" not in table or not table["time"].notna().all():
        return table
    out, time = table.copy(), table["time"].to_numpy(dtype=np.float64)
    for name in names:
        recorded = table[name].to_numpy(dtype=np.float64)
        values, clock = recorded.copy(), clocks(table, name)
        for rows in by_label(clock):
            if np.ptp(time[rows]) > 0:
                values[rows] = _local_line(time[rows], recorded[rows])
        if noise_name(name) in table and (np.abs(values - recorded) > NOISE_REACHES * table[noise_name(name)]).any():
            continue
        out[name] = values
    return out


def noise_of(table: pd.DataFrame, names: Iterable[str]) -> dict[str, float]:
    """Standard deviation of each recorded temperature's noise, K: of what smoothing takes from most of its rows."""
    names = [n for n in names if n in table and table[n].notna().all()]
    smooth = settled(table, names)
    return {n: MAD_STD * float(np.median(np.abs(table[n] - smooth[n]))) for n in names}


def noise_name(name: str) -> str:
    """Of the column of a table that holds the standard deviation of another one's noise, K."""
    return f"noise({name})"


def clocks(table: pd.DataFrame, name: str) -> Index:
    """Label of the clock of each row: one of all files, one per file, or one per run.

    Files and runs may share a clock, or each may start at zero. Where the time goes back, the column decides: the clock
    is common if the column is a smooth function of the common time, else each file, or each run of it, has its own. A
    table may hold the labels of a column already (`clock_name`).
    """
    if clock_name(name) in table:
        return table[clock_name(name)].to_numpy()
    time, values = table["time"].to_numpy(dtype=np.float64), table[name].to_numpy(dtype=np.float64)
    out = np.zeros(len(table), dtype=np.intp)
    for part in (["file"], ["file", "run"]):
        if part[-1] in table:
            labels = label_numbers(table, part)
            for rows in by_label(out):
                if _own_clocks(time[rows], values[rows], labels[rows]):
                    out[rows] = out.max() + 1 + labels[rows]
    return out


def clock_name(name: str) -> str:
    """Of the column of a table that holds the clocks of another one."""
    return f"clock({name})"


def _own_clocks(time: Array, values: Array, labels: Index) -> bool:
    """Whether the time goes back, and values are a smooth function of it within each label only."""
    if not (np.diff(time) < 0).any() or not np.ptp(labels):
        return False
    left = _rms(_local_line(time, values) - values)
    each = [_local_line(time[rows], values[rows]) - values[rows] for rows in by_label(labels)]
    return left > max(CLOCK_MISFIT_KELVIN, 2 * _rms(np.concatenate(each)))


def by_label(labels: Index) -> list[Index]:
    """Indices of the rows of each label."""
    return [np.flatnonzero(labels == label) for label in np.unique(labels)]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _local_line(time: Array, values: Array) -> Array:
    """Local linear regression with Gaussian weights of standard deviation `SMOOTHING_SECONDS`, on an even grid."""
    start, end = float(time.min()), float(time.max())
    step = max(SMOOTHING_SECONDS / 8, (end - start) / 1_000_000)
    place = np.rint((time - start) / step).astype(np.intp)
    size, x = int(place.max()) + 1, place - place.max() / 2
    level = values.mean()
    reach = int(5 * SMOOTHING_SECONDS / step)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * step / SMOOTHING_SECONDS) ** 2)

    def moment(weights: Array) -> Array:
        sums = np.bincount(place, weights, minlength=size)
        return np.convolve(sums, kernel)[reach:][place]

    count, first, second = moment(np.ones_like(x)), moment(x), moment(x**2)
    value, product = moment(values - level), moment(x * (values - level))
    middle = first / count
    spread = second / count - middle**2
    slope = (product / count - middle * value / count) / (spread + 1.0)  # the added 1 keeps the value of a single row
    out: Array = level + value / count + slope * (x - middle)
    return out
