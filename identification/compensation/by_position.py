"""Mean of a recorded channel by the position of a joint, which tables can follow where they cannot follow the channel.

The difference of a gantry's two encoders is recorded and no axis of a table, but much of it may repeat with the
position of the gantry. Times and temperatures are left alone: where they follow a position, the survey's order does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from errormodel.arrays import Array
from errormodel.machine import Joint

if TYPE_CHECKING:
    import pandas as pd

REPEATED = "w_"  # prefix of the recorded channels that may repeat with a position
# of a channel's variance: positions must leave less in rows left out, and the order of the rows more; by judgement
LEAST_LEFT_SHARE = 0.5
MOST_DEGREE = 12  # of the polynomial by position
DRIFT_DEGREE = 4  # of that by the order of the rows, of a slow drift; by judgement
ROWS_PER_TERM = 5  # rows, and different positions, that a term of the polynomial needs at least; by judgement
BLOCKS = 10  # consecutive rows that are left out at a time
CLEARLY = 0.98  # of what a lower degree leaves: a higher one must leave less; by judgement


@dataclass(frozen=True)
class Mean:
    """Mean of a channel as a polynomial (Legendre, by the scaled position) of one joint; beyond its ends it is held.

    Attributes
    ----------
    joint, column : the joint, and its column in commands.
    low, high : ends of the measured positions, mm or rad.
    terms : coefficients.
    share : of the channel's variance that it predicts in rows left out.
    beside : ends and rms of what the channel had beside it: least, largest, rms.
    shift : added to it.
    """

    joint: str
    column: int
    low: float
    high: float
    terms: tuple[float, ...]
    share: float
    beside: tuple[float, float, float]
    shift: float = 0.0

    def at(self, q: Array) -> Array:
        """Values at commands (n, joints) in mm and rad."""
        x = np.clip(q[:, self.column], self.low, self.high)
        return self.shift + _curve(_scaled(x, self.low, self.high), self.terms)

    def shifted(self, by: float) -> Mean:
        return replace(self, shift=self.shift + by)

    @property
    def words(self) -> str:
        """What is followed, and what is not."""
        return (
            f"mean by the position of {self.joint} ({100 * self.share:.3g} % of its variance in rows left out, "
            f"{self.beside[2]:.2g} rms beside it)"
        )

    def as_json(self, channel: str) -> dict[str, Any]:
        low, high, rms = self.beside
        return {
            "channel": channel,
            "joint": self.joint,
            "predicted_share": self.share,
            "beside": {"min": low, "max": high, "rms": rms},
        }


def means_of(table: pd.DataFrame, joints: Sequence[Joint], channels: Sequence[str]) -> Mapping[str, Mean]:
    """Means of those channels of a survey's rows (`table`, mm and rad) that the position of a joint predicts."""
    out = {}
    positions = table[[j.name for j in joints]].to_numpy(dtype=np.float64)
    for name in (c for c in channels if c.startswith(REPEATED) and c in table):
        values = table[name].to_numpy(dtype=np.float64)
        known = np.isfinite(values)
        if found := _mean(values[known], positions[known], joints):
            out[name] = found
    return out


def _mean(values: Array, positions: Array, joints: Sequence[Joint]) -> Mean | None:
    """Mean by the joint that predicts most; None where none predicts enough, or the order of the rows as much."""
    spread = float(np.sum((values - values.mean()) ** 2)) if len(values) else 0.0
    if spread == 0.0 or _best(values, np.arange(len(values), dtype=np.float64), DRIFT_DEGREE)[0] < (
        LEAST_LEFT_SHARE * spread
    ):
        return None
    tried = [_best(values, x, MOST_DEGREE) for x in positions.T]
    column = int(np.argmin([left for left, _ in tried]))
    left, degree = tried[column]
    if left >= LEAST_LEFT_SHARE * spread:
        return None
    x = positions[:, column]
    low, high = float(x.min()), float(x.max())
    terms = _fitted(_scaled(x, low, high), values, degree)
    rest = values - _curve(_scaled(x, low, high), terms)
    beside = float(rest.min()), float(rest.max()), float(np.sqrt(np.mean(rest**2)))
    return Mean(joints[column].name, column, low, high, tuple(terms.tolist()), 1 - left / spread, beside)


def _best(values: Array, x: Array, most: int) -> tuple[float, int]:
    """Sum of squares that the best polynomial leaves in rows left out, and its degree; 0: the mean alone."""
    places = len(np.unique(np.round(x, 3)))
    best = float(np.sum((values - values.mean()) ** 2)), 0
    if places < 2:
        return best
    scaled = _scaled(x, float(x.min()), float(x.max()))
    blocks = np.arange(len(values)) * BLOCKS // len(values)
    for degree in range(1, min(most, places // ROWS_PER_TERM) + 1):
        left = 0.0
        for block in range(BLOCKS):
            out = blocks == block
            terms = _fitted(scaled[~out], values[~out], degree)
            left += float(np.sum((values[out] - _curve(scaled[out], terms)) ** 2))
        if left < CLEARLY * best[0]:
            best = left, degree
    return best


def _scaled(x: Array, low: float, high: float) -> Array:
    return np.asarray(2 * (x - low) / (high - low) - 1, np.float64)


def _fitted(x: Array, values: Array, degree: int) -> Array:
    return np.asarray(np.polynomial.legendre.legfit(x, values, degree), np.float64)


def _curve(x: Array, terms: Sequence[float] | Array) -> Array:
    return np.asarray(np.polynomial.legendre.legval(x, np.asarray(terms)), np.float64)
