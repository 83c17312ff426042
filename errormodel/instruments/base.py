"""What an instrument offers: the covariance of a measured point, and noise drawn from it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from errormodel.yamlfile import FileModel, Number

Array = NDArray[np.float64]
NotNegative = Annotated[Number, Field(ge=0)]
Positive = Annotated[Number, Field(gt=0)]


def _some(pair: list[float]) -> list[float]:
    if not any(pair):
        raise ValueError("Write a standard uncertainty above 0 (or leave the instrument out: it is then estimated)")
    return pair


Pair = Annotated[list[NotNegative], Field(min_length=2, max_length=2), AfterValidator(_some)]
"""``[a, b]`` of a standard uncertainty ``hypot(a, b length)``, not both 0."""


class Instrument(FileModel, ABC):
    """Base of the instruments; a subclass in a file of this package is found by its ``type``.

    A subclass declares ``type: Literal["its-name"]`` and, as pydantic fields, what ``instrument:`` in a survey.yaml
    says of it.
    """

    type: str

    @abstractmethod
    def covariance(self, points: Array) -> Array | None:
        """Covariance of measured points.

        Parameters
        ----------
        points : array (n, 3)
            Measured coordinates in the measuring frame, mm; NaN where a component was not measured.

        Returns
        -------
        array (n, 3, 3) or None
            mm^2, k = 1, in the axes of the measuring frame; None where the noise is to be estimated from the data.
        """

    def draw_noise(self, points: Array, rng: np.random.Generator) -> Array:
        """Noise of the points, (n, 3) in mm; zero where nothing is known of the noise."""
        covariance = self.covariance(points)
        if covariance is None:
            return np.zeros_like(points)
        noise: Array = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.standard_normal(points.shape))
        return noise


class LengthDependent(Instrument):
    """An instrument of equal uncertainty in all directions that grows with the distance from the frame's origin."""

    sigma: Pair = Field(
        description="[a, b] of the standard uncertainty hypot(a, b L) in mm and mm/mm (k = 1), such as [0.5e-3, 1.0e-6]"
    )

    def covariance(self, points: Array) -> Array:
        a, b = self.sigma
        variance = a**2 + b**2 * np.nansum(points**2, axis=1)
        covariance: Array = variance[:, None, None] * np.eye(3)
        return covariance
