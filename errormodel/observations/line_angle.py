"""Angle along a line: rotation of the last frame about an axis (autocollimator, angle interferometer)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import Field

from errormodel.arrays import Array
from errormodel.observations.base import Observation, Quantity, Reading, Tip
from errormodel.observations.directions import Direction, unit

if TYPE_CHECKING:
    import casadi as ca


class LineAngle(Observation):
    """Rotation of the last frame from its nominal orientation about one axis, relative to the start of the run."""

    type: Literal["line-angle"] = "line-angle"
    reading: ClassVar[Reading] = "angle"
    along_line: ClassVar[bool] = True
    example: ClassVar[dict[str, Any]] = {"axis": [0.0, 1.0, 0.0]}
    source: ClassVar[str] = "ISO 230-1:2012, 8.4: angular error motions of linear axes"
    sees: ClassVar[str] = "rotations that change along the way, all joints together; no displacement, no constant angle"
    sign: ClassVar[str] = "an angle is positive where the last frame is turned about `axis` by the right-hand rule"
    axis: Direction = Field(
        description="[x, y, z] of the axis of rotation (right-handed) in the machine's reference, such as [0, 1, 0]; 1"
    )

    def quantities(self) -> tuple[Quantity, ...]:
        fixed = [Quantity(f"u_{a}", "1", v) for a, v in zip("xyz", unit(self.axis), strict=True)]
        return (*fixed, Quantity("zero", "rad", None, True))

    @staticmethod
    def value(tips: Sequence[Tip], of: Mapping[str, Any]) -> ca.SX:
        import casadi as ca

        return ca.SX(ca.dot(ca.vertcat(*(of[f"u_{a}"] for a in "xyz")), tips[0].turned) - of["zero"])

    def start(self, points: Sequence[Array], readings: Array, known: Mapping[str, float]) -> dict[str, float]:
        import numpy as np

        return {"zero": -float(np.median(readings))}
