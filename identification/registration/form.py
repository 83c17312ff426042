"""Schema of ``profiler.yaml``: positions of the artefacts, and mount of the sensor on the machine; mm and degrees."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from errormodel import yamlfile
from errormodel.instruments.base import Positive
from errormodel.yamlfile import Document, FileModel, Number, Vector3, _no_bool

NotNegative = Annotated[Number, Field(ge=0)]


class MountUncertainty(FileModel):
    """Standard uncertainties (k = 1) of a given mount."""

    translation: NotNegative = Field(0.0, description="of each component in mm, such as 0.1")
    rotation: NotNegative = Field(0.0, description="of each angle in rad, such as 0.001")


class MountBlock(FileModel):
    """The sensor's frame in the tool frame: ``p_tool = R p_sensor + t`` with ``R = Rx Ry Rz``."""

    translation: Vector3 = Field(description="[x, y, z] of the sensor's origin in the tool frame in mm")
    rotation: Vector3 = Field(description="[alpha, beta, gamma] about x, y, z in rad, such as [0.0029, -0.0013, 0]")
    std: MountUncertainty | None = Field(
        None, description="standard uncertainties such as {translation: 0.1, rotation: 0.001}"
    )


class CalibrationBlock(FileModel):
    """Plane and circular pocket that the tool machined and the sensor then scanned."""

    plane: str = Field(min_length=1, description="the cloud of the machined plane, relative to this file")
    circle: str = Field(min_length=1, description="the cloud of the pocket or of its edge, relative to this file")
    centre: Vector3 = Field(description="[x, y, z] of the circle's centre in the tool frame, mm, such as [0, 0, 0]")
    radius: Positive = Field(description="its radius in mm, such as 12.496")
    height: Number = Field(0.0, description="z of the circle's plane above centre as the sensor saw it, mm")


class ProfileBlock(FileModel):
    """Conversion of a file of heights (rows = profiles, columns = positions along the laser line) to points."""

    pitch: Positive = Field(description="distance of neighbouring columns along the laser line in mm, such as 0.0125")
    step: Positive = Field(description="distance of neighbouring profiles in mm, such as 0.1")


class Profiler(FileModel):
    """``profiler.yaml``."""

    errormodel: Annotated[Literal[1], BeforeValidator(_no_bool)] = Field(
        1, description="1 (the version of the file format that this program reads)"
    )
    joint: Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$")] = Field(
        description="the name of the joint that carries the sensor, such as Y"
    )
    positions: Annotated[list[Number], Field(min_length=1)] = Field(
        description="the joint's position at each artefact in mm, such as [350, 550, 750]"
    )
    lever: Vector3 = Field(description="[x, y, z] from the joint's frame to the tool frame in mm")
    mount: MountBlock | None = Field(None, description="a block such as {translation: [..], rotation: [..]}")
    calibration: CalibrationBlock | None = Field(None, description="a block with plane, circle, centre, radius, height")
    profile: ProfileBlock | None = Field(None, description="a block such as {pitch: 0.0125, step: 0.1}, mm")
    times: list[Number] | None = Field(None, description="seconds of each WARM folder, such as [420, 900, 1800]")


def read_profiler(path: Path) -> tuple[Profiler, Document]:
    """Read and check a ``profiler.yaml``.

    Raises
    ------
    InputError
        A key or a value is wrong, or the mount is given not at all or twice.
    """
    document = yamlfile.load(path)
    form = yamlfile.validate(document, Profiler)
    if form.mount is not None and form.calibration is not None:
        raise document.error(("calibration",), "a mount and a calibration as well", "Give one of the two")
    if form.mount is None and form.calibration is None:
        cure = "Write mount: {translation: [x, y, z], rotation: [alpha, beta, gamma]}, or calibration: {plane: FILE, "
        raise document.error((), "neither 'mount' nor 'calibration'", cure + "circle: FILE, centre, radius, height}")
    twice = next((i for i, q in enumerate(form.positions) if q in form.positions[:i]), None)
    if twice is not None:
        raise document.error(
            ("positions", twice), f"{form.positions[twice]:g} a second time", "Name each position once"
        )
    return form, document
