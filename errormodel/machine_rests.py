"""Rests of a machine, as the times of a recording show them: pauses much longer than those between its rows.

What warms up by the machine's own work cools in them. Times in s.
"""

from __future__ import annotations

import re

import numpy as np

from errormodel.arrays import Array

RESUMED_CHANNEL = re.compile(r"resumed\(([^,]+),([^,]+)\)")
REST_STEPS = 10.0  # times the median step between rows; by judgement: an operator's coffee is no rest
LEAST_REST = 600.0  # s; by judgement: the fastest members take as long to cool


def longest_step(time: Array) -> float:
    """Longest step between rows that is no rest, s."""
    steps = np.diff(np.unique(time))
    return max(LEAST_REST, REST_STEPS * float(np.median(steps))) if len(steps) else LEAST_REST


def rests(time: Array) -> list[tuple[float, float]]:
    """Begin and end of each rest in a recording, from the times of its rows (n,), s."""
    times, longest = np.unique(time), longest_step(time)
    return [(float(times[k]), float(times[k + 1])) for k in np.flatnonzero(np.diff(times) > longest)]


def resumed_name(until: float, step: float) -> str:
    """Name of the channel of the time at which work was resumed after the end `until` of a recording."""
    return f"resumed({until:.10g},{step:.6g})"


def resumed(time: Array, until: float, step: float) -> Array:
    """Time (n,), s, from which the machine worked on after the end `until` of a recording: that end, if it had no rest.

    Rows that begin by more than `step` after the end, and by much more than their own steps, come after a rest. Rows
    at one time are states, of which nothing says how they were reached.
    """
    out = np.full(len(time), until)
    later = time > until
    if later.any() and np.ptp(time[later]) > 0:
        first = float(time[later].min())
        if first - until > max(step, longest_step(time[later])):
            out[later] = first
    return out
