"""Plane touched by a probe in the machine: the touching point lies in the plane, wherever the plane is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from errormodel.arrays import Array
from errormodel.observations.base import Observation, Quantity, Tip, quantity
from errormodel.observations.directions import Direction, crossing, unit
from errormodel.yamlfile import Number

if TYPE_CHECKING:
    import casadi as ca

Tilt = Annotated[Number | Literal["unknown", "per-run"], Field(union_mode="smart")]


class TouchedPlane(Observation):
    """Signed distance of the probe's centre from a plane: 0 at each touch, or the deflection of a probe that reads."""

    type: Literal["touched-plane"] = "touched-plane"
    anywhere: ClassVar[bool] = False
    example: ClassVar[dict[str, Any]] = {"normal": [0.0, 0.0, 1.0]}
    source: ClassVar[str] = "calibration with plane constraints: M. Ikits & J. M. Hollerbach, IEEE ICRA (1997) 3191"
    sees: ClassVar[str] = (
        "how far the touched points are from flat; neither where the plane is nor how it is turned, unless that is "
        "known, and so no scale across it"
    )
    sign: ClassVar[str] = "a length is positive where the probe's centre lies from the plane towards `normal`"
    normal: Direction = Field(
        description="[x, y, z] of the plane's normal, towards the probe, roughly, in the machine's reference; 1"
    )
    tilt: Tilt = Field(
        "unknown",
        description="what the normal is turned against `normal` about two axes across it, in rad: 0 where it is known, "
        "unknown, or per-run",
    )

    def quantities(self) -> tuple[Quantity, ...]:
        n = unit(self.normal)
        p, q = across(n)
        fixed = [
            Quantity(f"{m}_{a}", "1", w[k]) for m, w in (("n", n), ("p", p), ("q", q)) for k, a in enumerate("xyz")
        ]
        tilts = [quantity(name, "rad", self.tilt) for name in ("tilt_1", "tilt_2")]
        return (*fixed, *tilts, Quantity("zero", "mm", None, any(t.per_run for t in tilts)))

    @staticmethod
    def value(tips: Sequence[Tip], of: Mapping[str, Any]) -> ca.SX:
        import casadi as ca

        n, p, q = (ca.vertcat(*(of[f"{m}_{a}"] for a in "xyz")) for m in "npq")
        normal = n + of["tilt_1"] * p + of["tilt_2"] * q
        return ca.SX(ca.dot(normal / ca.norm_2(normal), tips[0].point) - of["zero"])

    def start(self, points: Sequence[Array], readings: Array, known: Mapping[str, float]) -> dict[str, float]:
        """Least-squares plane of the nominal points."""
        import numpy as np

        n, p, q = (np.array([known[f"{m}_{a}"] for a in "xyz"]) for m in "npq")
        if "tilt_1" in known:
            normal = n + known["tilt_1"] * p + known["tilt_2"] * q
            return {"zero": float(np.median(points[0] @ normal / np.linalg.norm(normal) - readings))}
        middle = points[0].mean(axis=0)
        at = points[0] - middle
        # heights above the rough plane are linear in the places along it, as far as these spread
        slopes = np.linalg.lstsq(np.column_stack([at @ p, at @ q]), at @ n - readings, rcond=1e-6)[0]
        normal = n - slopes[0] * p - slopes[1] * q
        zero = float(middle @ normal / np.linalg.norm(normal) - readings.mean())
        return {"tilt_1": -float(slopes[0]), "tilt_2": -float(slopes[1]), "zero": zero}


def across(n: tuple[float, float, float]) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Two unit vectors across a third, each near an axis of the reference."""
    import numpy as np

    first = crossing(np.eye(3)[int(np.argmin(np.abs(n)))].tolist(), n)
    x, y, z = np.cross(n, first).tolist()
    return first, (x, y, z)
