"""Whether the machine rested between a recording and later commands.

If it did so in the recording, it is taken to have rested again. Else nothing tells: resting and working on are equally
likely, and the mean of both is predicted. Half of the difference is uncertain.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.effects import make
from errormodel.machine_rests import RESUMED_CHANNEL
from identification.uncertainty.other_assumption import Predict, half_change

if TYPE_CHECKING:
    import pandas as pd


def _rested(chain: Chain, channels: list[Array]) -> Iterator[tuple[int, float, Index, bool]]:
    """Channels of resumed work: number, the recording's end (s), the rows later than by a step, and whether it rests.

    It does if it rested in the recording.
    """
    resting = frozenset[str]().union(*(make(e).rested for e in chain.machine.effects))
    for number, name in enumerate(chain.channels):
        call = RESUMED_CHANNEL.fullmatch(name)
        if call and len(rows := np.flatnonzero(channels[number] > float(call[1]))):
            yield number, float(call[1]), rows, name in resting


def with_other_use(
    chain: Chain,
    channels: list[Array],
    labels: Array,
    predicted: Array,
    predict: Predict,
) -> Array:
    """Predictions (n, 9) of a machine that rested, or the mean of these and those of one that worked on.

    Half of the difference is in their uncertainty.

    Parameters
    ----------
    channels : each (n,), of a machine that rested; `labels` (n,): of the rows' frames.
    predicted : (n, 9)
        Position, error and standard uncertainty in mm with them.
    predict : such predictions of other rows, from their channels and labels.
    """
    out = predicted.copy()
    for number, until, rows, rests in _rested(chain, channels):
        worked_on = {number: np.full(len(rows), until)}
        half = half_change(channels, labels, predicted, predict, rows, worked_on)
        if not rests:
            out[rows, :6] += half
        out[rows, 6:] = np.hypot(out[rows, 6:], half[:, :3])
    return out


def rested(chain: Chain, table: pd.DataFrame) -> Iterator[str]:
    """A note on commands that come so long after the recording that the machine may have rested before them."""
    if not any(map(RESUMED_CHANNEL.fullmatch, chain.channels)):
        return
    channels = chain.columns(table)
    for number, until, rows, rests in _rested(chain, channels):
        pause = (float(channels[number][rows[0]]) - until) / 3600
        taken = (
            "the machine is taken to have rested until then, as it did in the recording, and what warms up by its work "
            "to begin anew. If it worked on, take until out of the effect; half of what that changes is in the "
            "uncertainty"
            if rests
            else "whether the machine rested until then, so that what warms up by its work begins anew, or worked on, "
            "nothing tells. The mean of both is predicted, and half of their difference is in the uncertainty. If it "
            "worked on, take until out of the effect"
        )
        yield f"the rows begin {pause:.2g} h after the recording's end: {taken}"
