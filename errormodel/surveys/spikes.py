"""Single readings of a temperature that no body with a mass can have had: far off, and back within minutes."""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array, Mask

SPIKE_KELVIN = 10.0  # up or down, and at once back
SOON = 300.0  # s: nothing that weighs something warms by that and cools again


def spikes(values: Array, time: Array | None) -> Mask:
    """Mask (n,) of readings far above or below those before and after them, these being alike.

    Parameters
    ----------
    values : (n,) readings, degC, in the order of time.
    time : (n,) s, or None where none was recorded: then rows that follow each other count as soon.
    """
    out: Mask = np.zeros(len(values), dtype=bool)
    if len(values) < 3:
        return out
    before, here, after = values[:-2], values[1:-1], values[2:]
    off = np.where((here - before) * (here - after) > 0, np.minimum(np.abs(here - before), np.abs(here - after)), 0.0)
    out[1:-1] = (off > SPIKE_KELVIN) & (np.abs(after - before) < off / 2)
    if time is not None:
        span = time[2:] - time[:-2]
        out[1:-1] &= (span >= 0) & (span < SOON)
    return out
