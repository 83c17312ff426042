"""Hyperparameters: noise levels, shape parameters of effects, scales of random effects, share and width of outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from identification.results.parameter_table import printed


@dataclass(frozen=True)
class Coordinate:
    """A sampled hyperparameter, in logarithmic or linear scale.

    Attributes
    ----------
    name : ``noise.position``, ``X.pitch-cyclic.period``, ``outliers.share`` ...
    unit : of the value.
    start, scale : centre and standard deviation of the starting points, on the sampled scale.
    low, high : bounds of the value.
    logarithmic : whether the natural logarithm of the value is sampled.
    mean, std : of a normal prior of the value; infinite `std`: flat prior on the sampled scale.
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
        """Factor and unit for display: noise in um and urad, shapes in mm and degrees."""
        if self.name.startswith("noise."):
            return printed(self.unit)
        return (float(np.degrees(1)), "°") if self.unit == "rad" else (1.0, self.unit)

    def value(self, moved: Array) -> Array:
        """The value on the natural scale."""
        return np.exp(moved) if self.logarithmic else moved

    def moved(self, value: float) -> float:
        """The value on the sampled scale."""
        return float(np.log(max(value, 1e-300))) if self.logarithmic else value

    def log_prior(self, moved: Array) -> Array:
        """Log prior density on the sampled scale, up to a constant, (n,); minus infinity outside the bounds."""
        value = self.value(moved)
        inside = (value >= self.low) & (value <= self.high)
        normal = -0.5 * np.square((value - self.mean) / self.std)
        if self.logarithmic and np.isfinite(self.std):  # Jacobian of the logarithm
            normal = normal + moved
        return np.where(inside, normal, -np.inf)
