"""Straightness along a line: displacement of the target across a straight reference (straightedge, laser, wire)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from errormodel.arrays import Array
from errormodel.observations.base import Observation, Quantity, Tip, quantity
from errormodel.observations.directions import Direction, crossing, is_across, unit
from errormodel.yamlfile import Number

if TYPE_CHECKING:
    import casadi as ca

Slope = Annotated[Number | Literal["unknown", "per-run"], Field(union_mode="smart")]


class LineStraightness(Observation):
    """Displacement of the functional point across a straight reference line, whose place and slope are set up."""

    type: Literal["line-straightness"] = "line-straightness"
    anywhere: ClassVar[bool] = False
    along_line: ClassVar[bool] = True
    example: ClassVar[dict[str, Any]] = {"along": [1.0, 0.0, 0.0], "across": [0.0, 0.0, 1.0]}
    source: ClassVar[str] = "ISO 230-1:2012, 8.2: straightness of the motion of a functional point"
    sees: ClassVar[str] = (
        "the deviation from a straight line along the way; its slope is that of the reference line, unless it is known"
    )
    sign: ClassVar[str] = "a length is positive where the target, and not the line, lies towards `across`"
    along: Direction = Field(description="[x, y, z] of the line in the machine's reference, such as [1, 0, 0]; 1")
    across: Direction = Field(
        description="[x, y, z] of the displacements that count positive, across the line, such as [0, 0, 1]; 1"
    )
    slope: Slope = Field(
        "per-run",
        description="the slope of the reference line against `along` towards `across` in rad: a number (0 for a line "
        "that stands for another axis), unknown or per-run",
    )

    @model_validator(mode="after")
    def _across(self) -> LineStraightness:
        if not is_across(self.across, self.along):
            raise ValueError("Write across: a direction across the line, such as [0, 0, 1] of a line along [1, 0, 0]")
        return self

    def quantities(self) -> tuple[Quantity, ...]:
        u = unit(self.along)
        v = crossing(self.across, u)
        fixed = [Quantity(f"{n}_{a}", "1", w[k]) for n, w in (("u", u), ("v", v)) for k, a in enumerate("xyz")]
        return (*fixed, quantity("slope", "rad", self.slope), Quantity("zero", "mm", None, True))

    @staticmethod
    def value(tips: Sequence[Tip], of: Mapping[str, Any]) -> ca.SX:
        import casadi as ca

        u, v = (ca.vertcat(*(of[f"{n}_{a}"] for a in "xyz")) for n in "uv")
        point = tips[0].point
        return ca.SX(ca.dot(v, point) - of["slope"] * ca.dot(u, point) - of["zero"])

    def start(self, points: Sequence[Array], readings: Array, known: Mapping[str, float]) -> dict[str, float]:
        import numpy as np

        u, v = (np.array([known[f"{n}_{a}"] for a in "xyz"]) for n in "uv")
        slope = known.get("slope", 0.0)
        zero = float(np.median(points[0] @ v - slope * (points[0] @ u) - readings))
        return {"slope": slope, "zero": zero}
