"""Base class of measuring instruments: sources of uncertainty, and the covariance of measured points as their sum.

Law of propagation of uncertainty (GUM) for independent sources; standard uncertainties (k = 1), mm and rad.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field

from errormodel.exceptions import InputError
from errormodel.yamlfile import FileModel, Number

Array = NDArray[np.float64]
NotNegative = Annotated[Number, Field(ge=0)]
Positive = Annotated[Number, Field(gt=0)]

# mm or rad: below the diameter of an atom, beyond that of a machine; weights of rows far from these cannot be computed
LEAST_SIGMA, LARGEST_SIGMA = 1e-9, 1e4


def _some(pair: list[float]) -> list[float]:
    if not any(pair):
        raise ValueError("Write a standard uncertainty above 0 (or leave the instrument out: it is then estimated)")
    return pair


def _of_all_lengths(value: object) -> object:
    return [value, 0.0] if isinstance(value, int | float) and not isinstance(value, bool) else value


Pair = Annotated[
    list[NotNegative], Field(min_length=2, max_length=2), AfterValidator(_some), BeforeValidator(_of_all_lengths)
]
"""``[a, b]`` of a standard uncertainty ``hypot(a, b length)``, not both 0; one number is `a`."""


class Source(NamedTuple):
    """One random error of an instrument, independent of its others.

    Attributes
    ----------
    name : name in the uncertainty budget.
    std : standard uncertainty (k = 1) as the user stated it, in `unit`.
    unit : mm, rad, or 1 (mm/mm).
    covariance : (n, 3, 3) its contribution to the covariance of measured points, mm^2, in the measuring frame.
    """

    name: str
    std: float
    unit: str
    covariance: Array


class Instrument(FileModel, ABC):
    """Base class of measuring instruments; a subclass in a file of this package is found by its ``type``.

    A subclass declares ``type: Literal["its-name"]`` and, as pydantic fields, the keys of ``instrument:`` in a
    survey.yaml. The covariance of a point is the sum over its sources.
    """

    type: str
    usual: ClassVar[tuple[float, float] | None] = None
    """``(a, b)`` of the standard uncertainty ``hypot(a, b r)`` (mm, mm/mm; k = 1) of a coordinate at a distance r from
    the instrument that makers specify for the less accurate of this type; None: nothing is usual for it."""

    @property
    def stated(self) -> bool:
        """Whether its uncertainties are stated; where they are not, the noise is estimated from the data."""
        return bool(self.sources(np.zeros((1, 3))))

    @abstractmethod
    def sources(self, points: Array) -> list[Source]:
        """Independent random errors of the instrument, each with its covariance of measured points.

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

        Raises
        ------
        InputError
            An uncertainty is none that an instrument has.
        """
        total: Array | None = None
        for source in self.sources(points):
            total = source.covariance if total is None else total + source.covariance
        if total is not None and len(total):
            std = np.sqrt(np.linalg.eigvalsh(total))
            odd = std[~((std >= LEAST_SIGMA) & (std <= LARGEST_SIGMA))]
            if len(odd):
                found = f"a standard uncertainty of {odd[0]:.3g} mm of a measured point, which no instrument has"
                raise InputError(f"instrument {self.type}", found, "Check its numbers and their units (mm, rad; k = 1)")
        return total

    def usual_sigma(self, points: Array) -> float | None:
        """What instruments of this type make of these points at worst, where `usual` says it.

        Parameters
        ----------
        points : array (n, 3)
            Measured coordinates in the measuring frame, mm; NaN where a component was not measured.

        Returns
        -------
        float or None
            Root mean square over the points of the standard uncertainty of a coordinate, mm (k = 1).
        """
        if self.usual is None or not len(points):
            return None
        a, b = self.usual
        square = np.nansum((points - np.asarray(getattr(self, "station", np.zeros(3)))) ** 2, axis=1)
        return float(np.sqrt(a**2 + b**2 * square.mean()))

    def draw_noise(self, points: Array, rng: np.random.Generator) -> Array:
        """Draw noise of the points, (n, 3) in mm; zero where the noise is to be estimated from the data."""
        covariance = self.covariance(points)
        if covariance is None:
            return np.zeros_like(points)
        noise: Array = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.standard_normal(points.shape))
        return noise


class LengthDependent(Instrument):
    """Isotropic instrument whose standard uncertainty grows with the distance from the measuring frame's origin."""

    sigma: Pair | None = Field(
        None,
        description="[a, b] of the standard uncertainty hypot(a, b L) in mm and mm/mm (k = 1), such as "
        "[0.5e-3, 1.0e-6]; left out, it is estimated from the data",
    )

    def sources(self, points: Array) -> list[Source]:
        if self.sigma is None:
            return []
        a, b = self.sigma
        square = np.nansum(points**2, axis=1)
        return [
            Source("sigma", a, "mm", in_all_directions(np.full(len(points), a**2))),
            Source("sigma, in proportion to length", b, "1", in_all_directions(b**2 * square)),
        ]


def in_all_directions(variance: Array) -> Array:
    """Isotropic covariance (n, 3, 3) of points from the variance (n,) of each coordinate."""
    covariance: Array = variance[:, None, None] * np.eye(3)
    return covariance
