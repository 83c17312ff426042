"""What an instrument offers: its sources of uncertainty, the covariance of a measured point, noise drawn from it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Annotated, NamedTuple

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


class Source(NamedTuple):
    """One random error of an instrument, independent of its others.

    Attributes
    ----------
    name : what it is, as the uncertainty budget prints it.
    std : its standard uncertainty (k = 1) as the user stated it, in `unit`.
    unit : mm, rad, or 1 (mm/mm).
    covariance : (n, 3, 3) what it alone gives to measured points, mm^2, in the axes of the measuring frame.
    """

    name: str
    std: float
    unit: str
    covariance: Array


class Instrument(FileModel, ABC):
    """Base of the instruments; a subclass in a file of this package is found by its ``type``.

    A subclass declares ``type: Literal["its-name"]`` and, as pydantic fields, what ``instrument:`` in a survey.yaml
    says of it. Its sources are all that is known of its noise: the covariance of a point is their sum.
    """

    type: str

    @abstractmethod
    def sources(self, points: Array) -> list[Source]:
        """The instrument's independent random errors, each with its covariance of measured points.

        Parameters
        ----------
        points : array (n, 3)
            Measured coordinates in the measuring frame, mm; NaN where a component was not measured.

        Returns
        -------
        list of Source
            Empty where the noise is to be estimated from the data.
        """

    def covariance(self, points: Array) -> Array | None:
        """Covariance of measured points: the sum over :meth:`sources`.

        Parameters
        ----------
        points : array (n, 3)
            Measured coordinates in the measuring frame, mm; NaN where a component was not measured.

        Returns
        -------
        array (n, 3, 3) or None
            mm^2, k = 1, in the axes of the measuring frame; None where the noise is to be estimated from the data.
        """
        total: Array | None = None
        for source in self.sources(points):
            total = source.covariance if total is None else total + source.covariance
        return total

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

    def sources(self, points: Array) -> list[Source]:
        a, b = self.sigma
        square = np.nansum(points**2, axis=1)
        return [
            Source("sigma", a, "mm", in_all_directions(np.full(len(points), a**2))),
            Source("sigma, in proportion to length", b, "1", in_all_directions(b**2 * square)),
        ]


def in_all_directions(variance: Array) -> Array:
    """Covariance (n, 3, 3) of points whose coordinates have equal variances (n,) and no correlation."""
    covariance: Array = variance[:, None, None] * np.eye(3)
    return covariance
