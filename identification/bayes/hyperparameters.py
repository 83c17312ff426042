"""Unknowns in which the model is not linear: noise levels, shapes of effects, scales of ties, shares of outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from identification.results.parameter_table import printed


@dataclass(frozen=True)
class Coordinate:
    """One of them, as a sampler moves it: its logarithm, or itself.

    Attributes
    ----------
    name : ``noise.position``, ``X.pitch-cyclic.period``, ``outliers.share`` ...
    start, scale : where walkers begin, and how far apart; as moved.
    low, high : values that the prior allows; `mean`, `std`: of a normal prior of the value, else flat as moved.
    """

    name: str
    unit: str
    start: float
    scale: float
    low: float
    high: float
    logarithmic: bool = True
    mean: float = 0.0
    std: float = np.inf

    @property
    def printed(self) -> tuple[float, str]:
        """Factor and unit in which people read it: noise in um and urad, shapes in mm and degrees."""
        if self.name.startswith("noise."):
            return printed(self.unit)
        return (float(np.degrees(1)), "°") if self.unit == "rad" else (1.0, self.unit)

    def value(self, moved: Array) -> Array:
        return np.exp(moved) if self.logarithmic else moved

    def moved(self, value: float) -> float:
        return float(np.log(max(value, 1e-300))) if self.logarithmic else value

    def log_prior(self, moved: Array) -> Array:
        """Up to a constant, (n,): minus infinity outside the bounds."""
        value = self.value(moved)
        inside = (value >= self.low) & (value <= self.high)
        normal = -0.5 * np.square((value - self.mean) / self.std)
        if self.logarithmic and np.isfinite(self.std):  # the density of a logarithm
            normal = normal + moved
        return np.where(inside, normal, -np.inf)
