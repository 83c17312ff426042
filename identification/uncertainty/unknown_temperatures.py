"""Temperatures between commands hours apart: what acts late follows them, and nothing states them.

Between two rows a temperature is taken to change evenly. How far a lag is led astray by that is read off the recording,
of which pieces as long as the gap are taken to change evenly as well (a structure function of the lag). What is wrong
at one row fades with the time constant until the next. Commands that do not go on from the recording begin in
equilibrium, give or take how far from it the recording was.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.channels import channel, fading, lagged
from identification.uncertainty.other_assumption import Predict, half_change
from identification.uncertainty.recording_end import Recorded, is_series, lags, late_sensors, on_one_clock

if TYPE_CHECKING:
    import pandas as pd

GAPS = 24  # lengths of gaps of which pieces are compared, evenly in their logarithm, from the recording's mean step on
PIECES = 40  # of the recording, of each length
POINTS = 60  # of a piece
LONGEST = 0.5  # of the recording: of longer pieces there are hardly two


def with_unknown_temperatures(
    chain: Chain,
    recorded: Recorded,
    table: pd.DataFrame,
    channels: list[Array],
    labels: Array,
    predicted: Array,
    predict: Predict,
) -> Array:
    """Predictions (n, 9) with what temperatures between the rows may have done to lags in their uncertainty.

    Parameters
    ----------
    channels : each (n,); `labels` (n,): of the rows' frames.
    predicted : (n, 9)
        Position, error and standard uncertainty in mm.
    predict : such predictions of other rows, from their channels and labels.
    """
    out, everywhere = predicted.copy(), np.arange(len(table))
    series = on_one_clock(chain, recorded, table)
    for base in late_sensors(chain):
        if base not in recorded or not is_series(table, base):
            continue
        before, values = (np.asarray(v, dtype=np.float64) for v in recorded[base])
        time = channel(table, "time")
        astray = {
            number: channels[number] + led_astray(before, values, time, tau, goes_on=base in series)
            for number, name, of, tau in lags(chain.channels)
            if of == base and name.startswith("lag(")
        }
        half = half_change(channels, labels, predicted, predict, everywhere, astray)
        out[:, 6:] = np.hypot(out[:, 6:], 2 * half[:, :3])
    return out


def led_astray(before: Array, values: Array, time: Array, tau: float, *, goes_on: bool = True) -> Array:
    """Standard deviation (n,), K, of a lag of `tau` s at the times of commands from what it is predicted to be.

    Parameters
    ----------
    before : (m,) times, s, of a recording's temperatures `values` (m,).
    time : (n,) of commands; `goes_on`: on the recording's clock, so that the lag is known in its rows.
    """
    both = np.concatenate([before, time]) if goes_on else time
    order = np.argsort(both, kind="stable")
    gaps = np.diff(both[order], prepend=both.min())
    commanded = order >= len(both) - len(time)
    # over a step the variance keeps exp(-2 h/tau); in the recording it is 0
    kept = np.where(commanded, np.exp(-2 * gaps / tau), 0.0)
    more = np.where(commanded, _after_gap(before, values, tau, gaps) ** 2, 0.0)
    if not goes_on:
        more[0] = np.mean((lagged(before, values, tau) - values) ** 2)
    out = np.empty(len(both))
    out[order] = fading(kept[1:], more)
    return np.sqrt(out[-len(time) :])


def _after_gap(time: Array, values: Array, tau: float, gaps: Array) -> Array:
    """Root mean square (k,), K, of what a lag is wrong by after each gap, s, that began with the right value."""
    duration = float(np.ptp(time))
    lengths = np.geomspace(duration / len(time), LONGEST * duration, GAPS)
    part = np.linspace(0.0, 1.0, POINTS)
    rms = []
    for length in lengths:
        starts = np.linspace(time.min(), time.max() - length, PIECES)
        piece = np.interp(starts[:, None] + length * part, time, values)
        uneven = piece - piece[:, :1] - part * (piece[:, -1:] - piece[:, :1])
        rms.append(np.sqrt(np.mean(lagged(length * part, uneven.T, tau)[-1] ** 2)))
    out: Array = np.interp(gaps, [0.0, *lengths], [0.0, *rms])
    return out
