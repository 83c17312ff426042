"""Distance between the tool at two commands: ball bar, step gauge, gauge blocks, diagonal in steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import Field

from errormodel.arrays import Array
from errormodel.observations.base import NumberOrUnknown, Observation, Quantity, Tip, quantity

if TYPE_CHECKING:
    import casadi as ca

SMALLEST_MM2 = 1e-24  # mm^2: what no length that is measured notices


class PoseDistance(Observation):
    """Distance between the functional point at one command and at another, as a calibrated artefact has it."""

    type: Literal["pose-distance"] = "pose-distance"
    poses: ClassVar[int] = 2
    example: ClassVar[dict[str, Any]] = {"offset": "unknown"}
    source: ClassVar[str] = "ISO 10360-2:2009, annex B: artefacts that represent a calibrated test length"
    sees: ClassVar[str] = (
        "the differences of position along the line from one pose to the other; never where the whole machine stands "
        "or how it is turned, and no scale if the offset in proportion to the length is unknown"
    )
    sign: ClassVar[str] = (
        "the two commands are the positions that the machine indicated and the length is the calibrated one"
    )
    offset: NumberOrUnknown = Field(
        0.0,
        description="what the distance is longer than its reading, in mm: a number, unknown, or per-run (such as the "
        "diameter of a stylus tip that is not known)",
    )

    def quantities(self) -> tuple[Quantity, ...]:
        return (quantity("offset", "mm", self.offset),)

    @staticmethod
    def value(tips: Sequence[Tip], of: Mapping[str, Any]) -> ca.SX:
        import casadi as ca

        # the first reading of a row of displacements is from a pose to itself, where a length has no direction: its
        # derivative is then 0, not undefined
        apart = tips[1].point - tips[0].point
        return ca.SX(ca.sqrt(ca.sumsqr(apart) + SMALLEST_MM2) - of["offset"])

    def start(self, points: Sequence[Array], readings: Array, known: Mapping[str, float]) -> dict[str, float]:
        import numpy as np

        return {"offset": float(np.median(np.linalg.norm(points[1] - points[0], axis=1) - readings))}
