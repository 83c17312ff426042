"""Telescoping ballbar along a circle: deviation of the distance from a fixed ball, with the bar's calibrated length."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from errormodel.arrays import Array
from errormodel.observations.base import NumberOrUnknown, Observation, Quantity, Tip, coordinates, quantity
from errormodel.yamlfile import Vector3

if TYPE_CHECKING:
    import casadi as ca

Centre = Annotated[Vector3 | Literal["unknown", "per-run"], Field(union_mode="smart")]


class BallbarCircle(Observation):
    """Reading of a telescoping ballbar, actual length minus calibrated length, while the tool runs around its ball."""

    type: Literal["ballbar-circle"] = "ballbar-circle"
    anywhere: ClassVar[bool] = False
    point: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    trace: ClassVar[str] = "circle"
    example: ClassVar[dict[str, Any]] = {"calibrated": 150.0013}
    source: ClassVar[str] = "ISO 230-4:2005, circular tests; W. Knapp, Annals of the CIRP 32 (1983) 465"
    sees: ClassVar[str] = (
        "in the plane of a circle squareness, difference of the scales, reversal errors and low-order straightness; a "
        "common scale only with a known calibrated length; nothing across the plane"
    )
    sign: ClassVar[str] = "a length is positive where the bar is longer than its calibrated length"
    calibrated: NumberOrUnknown = Field(
        description="the calibrated length of the bar in mm, such as 150.0013; unknown; or per-run"
    )
    centre: Centre = Field(
        "unknown",
        description="[x, y, z] of the fixed ball in the measuring frame in mm, unknown (near the centre of the "
        "commanded circle), or per-run",
    )

    @classmethod
    def traced(cls, reach: float) -> dict[str, Any]:
        """The length that the file's deviations are from stands for the calibrated one."""
        return {"calibrated": reach}

    @classmethod
    def listed(cls) -> dict[str, Any]:
        """The calibrated length is not in a list of readings."""
        return {"calibrated": "unknown"}

    def quantities(self) -> tuple[Quantity, ...]:
        return (*coordinates(self.centre), quantity("calibrated", "mm", self.calibrated))

    @staticmethod
    def value(tips: Sequence[Tip], of: Mapping[str, Any]) -> ca.SX:
        import casadi as ca

        return ca.SX(ca.norm_2(tips[0].point - ca.vertcat(of["x"], of["y"], of["z"])) - of["calibrated"])

    def start(self, points: Sequence[Array], readings: Array, known: Mapping[str, float]) -> dict[str, float]:
        """The centre of the commanded circle, in its plane, and the length that it then has."""
        import numpy as np

        at = points[0]
        out: dict[str, float] = {}
        if "x" in known:
            centre = np.array([known[n] for n in "xyz"])
        else:
            if len(at) < 3:
                raise ValueError(f"{len(at)} readings on a circle. Measure at least three, better hundreds")
            middle = at.mean(axis=0)
            # |p|^2 = 2 p c + (r^2 - |c|^2), with the centre c in the plane of the points: minimum norm leaves it there
            columns = np.column_stack([2 * (at - middle), np.ones(len(at))])
            square = np.square(at - middle).sum(axis=1)
            centre = middle + np.linalg.lstsq(columns, square, rcond=1e-6)[0][:3]
            out |= dict(zip("xyz", centre.tolist(), strict=True))
        if "calibrated" not in known:
            out["calibrated"] = float(np.median(np.linalg.norm(at - centre, axis=1) - readings))
        return out

    def assumed(self, points: Sequence[Array], known: Mapping[str, float]) -> dict[str, float]:
        """The ball in the centre of the commanded circle, the bar as long as its radius."""
        import numpy as np

        return self.start(points, np.zeros(len(points[0])), known)
