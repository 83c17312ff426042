"""Level: inclination of a direction of the last frame against the horizontal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import Field, model_validator

from errormodel.observations.base import Observation, Quantity, Reading, Tip
from errormodel.observations.directions import Direction, is_across, unit

if TYPE_CHECKING:
    import casadi as ca


class PrecisionLevel(Observation):
    """Electronic level on the last frame: rise of its axis towards the vertical, relative to the start of the run."""

    type: Literal["precision-level"] = "precision-level"
    reading: ClassVar[Reading] = "angle"
    example: ClassVar[dict[str, Any]] = {"axis": [1.0, 0.0, 0.0]}
    source: ClassVar[str] = "ISO 230-1:2012, 8.4.2: angular error motions with precision levels"
    sees: ClassVar[str] = (
        "inclination about horizontal axes only, all joints together; a rotation about the vertical never shows"
    )
    sign: ClassVar[str] = "an angle is positive where `axis` rises"
    axis: Direction = Field(
        description="[x, y, z] of the level's axis in the last frame; its rise reads positive, such as [1, 0, 0]; 1"
    )
    up: Direction = Field([0.0, 0.0, 1.0], description="[x, y, z] of the vertical in the machine's reference; 1")

    @model_validator(mode="after")
    def _across(self) -> PrecisionLevel:
        if not is_across(self.axis, self.up):
            raise ValueError("Write axis: a direction that lies across the vertical, such as [1, 0, 0]")
        return self

    def quantities(self) -> tuple[Quantity, ...]:
        a, up = unit(self.axis), unit(self.up)
        fixed = [Quantity(f"{n}_{c}", "1", w[k]) for n, w in (("u", a), ("v", up)) for k, c in enumerate("xyz")]
        return (*fixed, Quantity("zero", "rad", None, True))

    @staticmethod
    def value(tips: Sequence[Tip], of: Mapping[str, Any]) -> ca.SX:
        import casadi as ca

        u, v = (ca.vertcat(*(of[f"{n}_{a}"] for a in "xyz")) for n in "uv")
        rise = ca.dot(v, tips[0].rotation @ u)
        # against the horizontal direction that lies below the axis, so that no arc sine of nearly one is taken
        return ca.SX(ca.atan2(rise, ca.norm_2(ca.cross(v, tips[0].rotation @ u))) - of["zero"])
