"""Setup of a planned measurement: travels, tools, obstacles, line of sight, instrument; file form of ``--setup``.

Lengths are in mm in the axes of the machine's reference; angles are in degrees in the file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from errormodel import yamlfile
from errormodel.exceptions import InputError, nearest
from errormodel.instruments.base import LARGEST_SIGMA, LEAST_SIGMA, Instrument
from errormodel.instruments.plain import Plain
from errormodel.machine import Joint, Machine
from errormodel.surveys.file import AnyInstrument, AnyObservation
from errormodel.yamlfile import Document, FileModel, Number, Vector3, VersionedModel

Range = Annotated[list[Number], Field(min_length=2, max_length=2)]
Sensor = Annotated[str, Field(pattern=r"^T_\w+$")]


class Box(FileModel):
    """A box in the axes of the machine's reference, which no target, tool or line of sight may enter."""

    x: Range = Field([-1e9, 1e9], description="[low, high] in mm, such as [-200, 200]")
    y: Range = Field([-1e9, 1e9], description="[low, high] in mm, such as [-200, 200]")
    z: Range = Field([-1e9, 1e9], description="[low, high] in mm, such as [-200, 200]")

    def sides(self) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
        """Lower and upper limits (3, 2), mm."""
        return np.array([self.x, self.y, self.z])


class Sight(FileModel):
    """Position of the instrument, and directions from which the target is visible."""

    station: Vector3 = Field(description="[x, y, z] of the instrument in the axes of the machine's reference, mm")
    facing: Vector3 | None = Field(None, description="[x, y, z] that the target looks along in the last frame")
    incidence: Annotated[Number, Field(gt=0, le=180)] = Field(
        180.0, description="largest angle between the target's axis and the line of sight in degrees, such as 30"
    )


class Setup(VersionedModel):
    """Setup of a plan: reachable and visible poses, tools, instrument, measuring frame and time per pose."""

    travels: dict[str, Range] = Field({}, description="a block such as {X: [-500, 500]}, mm and degrees")
    tools: list[Vector3] = Field([], description="functional points such as [[0, 0, -150], [0, 0, -300]], mm")
    avoid: list[Box] = Field([], description="boxes such as [{x: [-50, 50], y: [-50, 50], z: [0, 400]}], mm")
    sight: Sight | None = Field(None, description="a block such as {station: [2000, 0, 500]}")
    instrument: AnyInstrument = Field(Plain(), description="a block such as {type: cmm, sigma: [1e-3, 2e-6]}")
    observations: dict[str, AnyObservation] = Field(
        {}, description="single readings of every pose, as in survey.yaml, such as {A: {type: .., near: [0, -900, 0]}}"
    )
    coordinates: bool = Field(False, description="beside observations: whether three coordinates are measured as well")
    frame: Literal["shared", "fixed"] = Field("shared", description="shared (unknown) or fixed (the machine's own)")
    pace: Annotated[Number, Field(gt=0)] = Field(60.0, description="seconds a pose takes, such as 60")
    sensors: list[Sensor] = Field(["T_machine"], description="temperatures that will be logged, such as [T_bed]")

    def allowed(self, joint: Joint) -> tuple[float, float]:
        """Lower and upper limit of the usable travel of a joint, mm or rad."""
        low, high = self.travels.get(joint.name, [-np.inf, np.inf])
        if joint.name in self.travels and joint.type == "rotary":
            low, high = np.radians([low, high]).tolist()
        return max(low, joint.travel[0]), min(high, joint.travel[1])

    def points(self, machine: Machine) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
        """Functional points of the tools in the last frame, (n, 3) mm."""
        return np.array(self.tools or [list(machine.tool)], dtype=np.float64)


def read_setup(path: Path, machine: Machine) -> Setup:
    """Read and check a setup file.

    Raises
    ------
    InputError
        A key or value is wrong, a joint is not the machine's, or a range is empty.
    """
    document = yamlfile.load(path)
    setup = yamlfile.validate(document, Setup)
    joints = {j.name: j for j in machine.joints}
    for name, (low, high) in setup.travels.items():
        if name not in joints:
            raise document.error(("travels", name), f"the machine has no joint '{name}'", nearest(name, joints))
        _rising(document, ("travels", name), low, high)
        first, last = setup.allowed(joints[name])
        if first >= last:
            own = _outward(joints[name])
            found = f"{low:g} to {high:g}, outside the machine's travel"
            raise document.error(("travels", name), found, f"Write a part of [{own[0]:g}, {own[1]:g}]")
    for k, box in enumerate(setup.avoid):
        for axis in ("x", "y", "z"):
            if axis in box.model_fields_set:
                _rising(document, ("avoid", k, axis), *getattr(box, axis))
    if setup.sight is not None and setup.sight.facing is not None and not any(setup.sight.facing):
        raise document.error(("sight", "facing"), "[0, 0, 0]", "Write a direction, such as [0, 0, 1]")
    return setup


def _rising(document: Document, keys: tuple[str | int, ...], low: float, high: float) -> None:
    """Raise InputError if a range is empty."""
    if low >= high:
        raise document.error(keys, f"{low:g} to {high:g}", "Write [low, high] with low below high")


def _outward(joint: Joint) -> tuple[float, float]:
    """Travel of a joint, mm or degrees."""
    low, high = joint.travel
    return (float(np.degrees(low)), float(np.degrees(high))) if joint.type == "rotary" else (low, high)


def noise_of(setup: Setup, noise: float | None) -> Instrument | float:
    """The setup's instrument, or one standard uncertainty of all coordinates, mm.

    Parameters
    ----------
    noise : value of ``--noise``, mm; None: not given.

    Raises
    ------
    InputError
        Both are given, or the number is not a standard uncertainty.
    """
    if not setup.instrument.stated:
        if noise is None:
            return 1e-3  # 1 um: predicted uncertainties are per micrometre of noise
        if not LEAST_SIGMA <= noise <= LARGEST_SIGMA:
            raise InputError(
                "--noise", f"{noise:g}", "Write a standard uncertainty of a coordinate in mm, such as 0.005"
            )
        return noise
    if noise is not None:
        raise InputError("--noise", "an instrument in --setup as well", "Give one of the two")
    return setup.instrument
