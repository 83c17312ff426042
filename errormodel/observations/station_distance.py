"""Distance from a station to a target at the tool: interferometer that tracks, absolute distance meter, wire."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from errormodel.arrays import Array
from errormodel.observations.base import (
    LineError,
    NumberOrUnknown,
    Observation,
    Quantity,
    StepError,
    Tip,
    coordinates,
    quantity,
)
from errormodel.observations.station import interruptions, located
from errormodel.yamlfile import Vector3

if TYPE_CHECKING:
    import casadi as ca

Station = Annotated[Vector3 | Literal["unknown", "per-run"], Field(union_mode="smart")]


class StationDistance(Observation):
    """Distance from a station, less a dead path: multilateration, also with one instrument in several places."""

    type: Literal["station-distance"] = "station-distance"
    point: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    example: ClassVar[dict[str, Any]] = {"station": "unknown", "near": [900.0, -700.0, -200.0], "dead_path": "per-run"}
    source: ClassVar[str] = (
        "H. Schwenke et al., CIRP Annals 54 (2005) 475: error mapping by multilateration with a tracking interferometer"
    )
    sees: ClassVar[str] = (
        "one station shows what moves the target along the lines of sight; three or more, well apart, all of its "
        "position. Rotations show by targets of several lengths only"
    )
    sign: ClassVar[str] = "a longer length is one farther from the station, where the target truly was at the command"
    station: Station = Field(
        "unknown",
        description="[x, y, z] in the measuring frame in mm, unknown (one place for all rows), or per-run (it was "
        "moved between the runs)",
    )
    dead_path: NumberOrUnknown = Field(
        0.0,
        description="the length in mm that the readings lack of the whole distance: a number, 0 for absolute "
        "distances; unknown; or per-run, where each run counts from a start of its own",
    )
    near: Vector3 | None = Field(
        None,
        description="[x, y, z] in mm where the station roughly stands in the machine's reference, where the lengths "
        "alone leave its side open",
    )

    def quantities(self) -> tuple[Quantity, ...]:
        return (*coordinates(self.station), quantity("dead_path", "mm", self.dead_path))

    @staticmethod
    def value(tips: Sequence[Tip], of: Mapping[str, Any]) -> ca.SX:
        import casadi as ca

        return ca.SX(ca.norm_2(tips[0].point - ca.vertcat(of["x"], of["y"], of["z"])) - of["dead_path"])

    def start(self, points: Sequence[Array], readings: Array, known: Mapping[str, float]) -> dict[str, float]:
        line: LineError | None = None
        try:
            found = located(points[0], readings, known, self.near)
        except LineError as error:
            found, line = error.start, error
        place = np.array([{**known, **found}[n] for n in (*"xyz", "dead_path")])
        steps = interruptions(points[0], readings, place)
        if steps:
            some = "; ".join(f"from reading {k + 1} of {len(readings)} on {abs(s):.3g} mm {_than(s)}" for k, s in steps)
            raise StepError(
                f"lengths that change by a step, {some} than before: a beam that was lost, or a counter that was set. "
                "Give the rows behind each step a run of their own (column run) and write dead_path: per-run"
            )
        if line is not None:
            raise line
        return found

    @classmethod
    def listed(cls) -> dict[str, Any]:
        """Where an instrument counts from is not in a list of lengths."""
        return {"dead_path": "unknown"}

    def assumed(self, points: Sequence[Array], known: Mapping[str, float]) -> dict[str, float]:
        """The station roughly where the file says."""
        if "x" in known:
            return {}
        if self.near is None:
            raise ValueError("a station of which nothing is known. State x, y and z, or near: [x, y, z] in survey.yaml")
        return dict(zip("xyz", self.near, strict=True))


def _than(step: float) -> str:
    return "longer" if step > 0 else "shorter"
