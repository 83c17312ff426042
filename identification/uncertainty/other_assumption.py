"""What a prediction changes by if a channel that nothing states is taken otherwise than was assumed."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from errormodel.arrays import Array, Index, as_rows

Predict: TypeAlias = Callable[[list[Array], Array], Array]
"""Predictions (m, 9) of rows from their channels and frame labels: position, error and its uncertainty, mm."""


def half_change(
    channels: list[Array], labels: Array, predicted: Array, predict: Predict, number: int, rows: Index, other: Array
) -> Array:
    """Half of what positions and errors (k, 6) of some rows change by, mm, with other values of one channel.

    Parameters
    ----------
    channels : each (n,), as assumed; `labels` (n,): of the rows' frames; `predicted` (n, 9): with these.
    number : of the channel; `rows` (k,) and its `other` values there, (k,).
    """
    own = [c[rows] for c in channels]
    own[number] = other
    return np.asarray((predict(as_rows(*own), labels[rows])[:, :6] - predicted[rows, :6]) / 2)
