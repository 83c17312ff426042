"""What a prediction changes by if a channel that nothing states is taken otherwise than was assumed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np

from errormodel.arrays import Array, Index, as_rows

Predict: TypeAlias = Callable[[list[Array], Array], Array]
"""Predictions (m, 9) of rows from their channels and frame labels: position, error and its uncertainty, mm."""


def half_change(
    channels: list[Array], labels: Array, predicted: Array, predict: Predict, rows: Index, others: Mapping[int, Array]
) -> Array:
    """Half of what positions and errors (k, 6) of some rows change by, mm, with other values of channels.

    Parameters
    ----------
    channels : each (n,), as assumed; `labels` (n,): of the rows' frames; `predicted` (n, 9): with these.
    rows : (k,); `others`: by its number the values of a channel there, (k,).
    """
    own = [others[number] if number in others else c[rows] for number, c in enumerate(channels)]
    return np.asarray((predict(as_rows(*own), labels[rows])[:, :6] - predicted[rows, :6]) / 2)
