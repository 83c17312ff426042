"""Means of the readings of a dwell, and their scatter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.surveys.columns import MEASURED, ORIENTATION, READING_UNCERTAINTIES, READINGS, SIGMA_COLUMNS

if TYPE_CHECKING:
    import pandas as pd

FEW_READINGS = 10  # readings at a place: the scatter of fewer is too uncertain to stand alone


def averaged(frame: pd.DataFrame, first: Index, last: Index) -> pd.DataFrame:
    """Means of rows `first` to `last` (from 0); the scatter of positions becomes their standard uncertainty.

    It is the standard deviation of a reading, not of their mean: what is slower than a dwell (air, the instrument's own
    drift) does not average out in it. Of fewer than `FEW_READINGS` it is that of all poses together.
    """
    import pandas as pd

    if (first == last).all():
        return frame.iloc[first].reset_index(drop=True)
    out: dict[str, Any] = {}
    for name in frame:
        column = frame[name]
        if column.dtype.kind == "f" and name not in ORIENTATION:
            values = column.to_numpy(dtype=np.float64)
            out[str(name)] = np.array([_mean(values[a : b + 1]) for a, b in zip(first, last, strict=True)])
        else:
            out[str(name)] = column.iloc[first].reset_index(drop=True)
    if ORIENTATION[0] in frame:
        turned = [
            _mean_rotation(frame[list(ORIENTATION)].to_numpy()[a : b + 1]) for a, b in zip(first, last, strict=True)
        ]
        out |= dict(zip(ORIENTATION, np.array(turned).T, strict=True))
    for name, sigma in zip((*MEASURED, *READINGS), (*SIGMA_COLUMNS, *READING_UNCERTAINTIES), strict=True):
        if name not in frame:
            continue
        values = frame[name].to_numpy(dtype=np.float64)
        parts = [values[a : b + 1] for a, b in zip(first, last, strict=True)]
        stated = np.asarray(out[sigma], dtype=np.float64) if sigma in out else np.zeros(len(parts))
        found = np.hypot(np.nan_to_num(stated), scatter(parts))
        if (found > 0).any():  # readings that repeat to the last digit have the scatter of the best others
            out[sigma] = np.where(found > 0, found, found[found > 0].min())
    return pd.DataFrame(out)


def _mean(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else float("nan")


def _mean_rotation(vectors: Array) -> Array:
    from scipy.spatial.transform import Rotation

    whole = vectors[np.isfinite(vectors).all(axis=1)]
    return Rotation.from_rotvec(whole).mean().as_rotvec() if len(whole) else np.full(3, np.nan)


def scatter(parts: Sequence[Array]) -> Array:
    """Standard deviation of a reading in each part (a list of readings), (n,)."""
    parts = [p[np.isfinite(p)] for p in parts]
    free = np.array([max(len(p) - 1, 0) for p in parts])
    squares = np.array([float(np.sum((p - p.mean()) ** 2)) if len(p) else 0.0 for p in parts])
    pooled = float(np.sqrt(squares.sum() / max(free.sum(), 1)))
    return np.where(free >= FEW_READINGS - 1, np.sqrt(squares / np.maximum(free, 1)), pooled)
