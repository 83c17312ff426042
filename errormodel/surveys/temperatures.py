"""Temperatures in another unit than the other sensors of a recording have."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.arrays import Array

APART = 20.0  # K: at no time does a sensor come so near to any other; at 20 degC degrees Fahrenheit are 48 more
ALIKE = 5.0  # K, of the medians in degF: a machine and its room


def fahrenheit_notes(table: pd.DataFrame) -> Iterator[str]:
    """Notes on sensors that lie far above all others, and among them if they are in degF."""
    values: dict[str, Array] = {}
    for name in (str(c) for c in table.columns if str(c).startswith("T_")):
        column = table[name].to_numpy(dtype=np.float64)
        if np.isfinite(column).any():
            values[name] = column[np.isfinite(column)]
    warm = {n: v for n, v in values.items() if any(_between(v, other) for m, other in values.items() if m != n)}
    for name, own in warm.items():
        rest = {n: v for n, v in values.items() if n not in warm}
        if not rest or not all(_between(own, v) for v in rest.values()):
            continue
        other, beside = next(iter(rest.items()))
        low, high = ((x - 32) / 1.8 for x in (own.min(), own.max()))
        yield (
            f"{name} is {own.min():.4g} to {own.max():.4g} degC where {other} is {beside.min():.4g} to "
            f"{beside.max():.4g}: as degF it would be {low:.3g} to {high:.3g} degC. If it is in degF, write units: "
            f"{{{name}: degF}} in a survey.yaml, or import with --units {name}=degF"
        )


def _between(own: Array, other: Array) -> bool:
    """Whether a sensor lies apart from another as read, and beside it if it is in degF."""
    near = abs((np.median(own) - 32) / 1.8 - np.median(other)) < ALIKE
    return bool(own.min() > other.max() + APART and near)
