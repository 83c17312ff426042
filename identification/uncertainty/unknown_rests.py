"""Whether the machine rested between a recording and later commands: taken so, and half of its effect uncertain."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.machine_rests import RESUMED_CHANNEL
from identification.uncertainty.other_assumption import Predict, half_change

if TYPE_CHECKING:
    import pandas as pd


def _rested(chain: Chain, channels: list[Array]) -> Iterator[tuple[int, float, Index]]:
    """Channels of resumed work: number, the recording's end (s), and the rows after a rest that followed it."""
    for number, name in enumerate(chain.channels):
        call = RESUMED_CHANNEL.fullmatch(name)
        if call and len(rows := np.flatnonzero(channels[number] > float(call[1]))):
            yield number, float(call[1]), rows


def with_other_use(
    chain: Chain,
    channels: list[Array],
    labels: Array,
    predicted: Array,
    predict: Predict,
) -> Array:
    """Predictions (n, 9), half of whose difference from those of a machine that worked on is in their uncertainty.

    Parameters
    ----------
    channels : each (n,), of a machine that rested; `labels` (n,): of the rows' frames.
    predicted : (n, 9)
        Position, error and standard uncertainty in mm with them.
    predict : such predictions of other rows, from their channels and labels.
    """
    out = predicted.copy()
    for number, until, rows in _rested(chain, channels):
        worked_on = {number: np.full(len(rows), until)}
        half = half_change(channels, labels, predicted, predict, rows, worked_on)
        out[rows, 6:] = np.hypot(out[rows, 6:], half[:, :3])
    return out


def rested(chain: Chain, table: pd.DataFrame) -> Iterator[str]:
    """A note on commands that come so long after the recording that the machine is taken to have rested before them."""
    if not any(map(RESUMED_CHANNEL.fullmatch, chain.channels)):
        return
    channels = chain.columns(table)
    for number, until, rows in _rested(chain, channels):
        pause = (float(channels[number][rows[0]]) - until) / 3600
        yield (
            f"the rows begin {pause:.2g} h after the recording's end: the machine is taken to have rested until then, "
            "and what warms up by its work to begin anew. If it worked on, take until out of the effect; half of what "
            "that changes is in the uncertainty"
        )
