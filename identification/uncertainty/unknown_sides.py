"""Sides of approach that neither a column nor a move of the joint states: predictions lie midway between both sides."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from errormodel.approach import unknown_sides
from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from identification.uncertainty.other_assumption import Predict, half_change

if TYPE_CHECKING:
    import pandas as pd

SIDE = "dir_"


def _unknown(chain: Chain, table: pd.DataFrame) -> Iterator[tuple[int, Index]]:
    """Channels of sides that act in a model: their number, and the rows in which nothing states the side."""
    for number, name in enumerate(chain.channels):
        if name.startswith(SIDE) and len(rows := np.flatnonzero(unknown_sides(table, name.removeprefix(SIDE)))):
            yield number, rows


def midway(
    chain: Chain,
    table: pd.DataFrame,
    channels: list[Array],
    labels: Array,
    predicted: Array,
    predict: Predict,
) -> Array:
    """Predictions (n, 9) of which those from an unknown side are the mean of both, half their difference uncertain.

    Parameters
    ----------
    channels : each (n,), as assumed; `labels` (n,): of the rows' frames.
    predicted : (n, 9)
        Position, error and standard uncertainty in mm with the sides that were assumed.
    predict : such predictions of other rows, from their channels and labels.
    """
    out = predicted.copy()
    for number, rows in _unknown(chain, table):
        half = half_change(channels, labels, predicted, predict, rows, {number: -channels[number][rows]})
        out[rows, :6] += half
        out[rows, 6:] = np.hypot(out[rows, 6:], half[:, 3:])
    return out
