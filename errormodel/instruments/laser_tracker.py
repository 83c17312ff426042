"""Noise model of a laser tracker: one range along the line of sight and two angles across it."""

from __future__ import annotations

from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from errormodel.instruments.base import Array, Instrument, NotNegative, Pair, Positive, Source, in_all_directions
from errormodel.yamlfile import Vector3


class LaserTracker(Instrument):
    """Laser tracker at a station; its keys are in mm and rad, independent of ``units``."""

    type: Literal["laser-tracker"] = "laser-tracker"
    usual: ClassVar = (7.5e-3, 3e-6)  # half of 15 um + 6 um/m, as makers specify
    station: Vector3 = Field([0.0, 0.0, 0.0], description="[x, y, z] of the tracker in the measuring frame, mm")
    range: Pair | None = Field(
        None,
        description="[a, b] of the standard uncertainty hypot(a, b r) in mm and mm/mm (k = 1), such as "
        "[0.5e-3, 3.0e-6]; left out with the angle's, it is estimated from the data",
    )
    angle: Positive | None = Field(
        None, description="the standard uncertainty of both angles in rad (k = 1), such as 1.2e-6"
    )
    target: NotNegative = Field(
        0.0, description="the standard uncertainty of the target in its seat, equal in all directions, mm (k = 1)"
    )

    @model_validator(mode="after")
    def _both_or_none(self) -> Self:
        if (self.range is None) != (self.angle is None) or (self.range is None and self.target):
            raise ValueError(
                "Write range and angle, such as range: [0.5e-3, 3.0e-6], angle: 1.2e-6 (k = 1), or neither and no "
                "target: the noise is then estimated from the data"
            )
        return self

    def sources(self, points: Array) -> list[Source]:
        if self.range is None or self.angle is None:
            return []
        sight = np.nan_to_num(points - self.station)  # missing components count as zero in the line of sight
        r2 = np.einsum("ni,ni->n", sight, sight)[:, None, None]
        a, b = self.range
        with np.errstate(invalid="ignore"):  # at the station itself there is no line of sight
            along = np.where(r2 > 0, sight[:, :, None] * sight[:, None, :] / r2, np.eye(3))
        across = np.eye(3) - along
        return [
            Source("range", a, "mm", a**2 * along),
            Source("range, in proportion to length", b, "1", b**2 * r2 * along),
            Source("angle", self.angle, "rad", self.angle**2 * r2 * across),
            Source("target", self.target, "mm", in_all_directions(np.full(len(points), self.target**2))),
        ]
