"""``calibration.yaml`` of Universal Robots arms, as the extraction tool of their ROS driver writes it."""

from __future__ import annotations

import hashlib
import json
import math
import re
from typing import ClassVar

import numpy as np
from pydantic import Field

from errormodel.arrays import Array
from errormodel.exceptions import InputError
from errormodel.machine import Joint, Machine, Shape
from errormodel.machine_formats.base import Description, Extras, MachineFormat, Part, Written
from errormodel.machine_formats.joint_axes import AlongZ, screws
from errormodel.machine_formats.transforms import (
    MM_PER_M,
    in_metres,
    inverse,
    links_of,
    rpy_angles,
    rpy_matrix,
    shape_of,
    transform,
    vector,
)
from errormodel.raw_formats.base import RawFile
from errormodel.yamlfile import FileModel, Number, parse, validate

MEMBERS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
JOINTS = (
    "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint",
)  # fmt: skip
TRAVEL = 2 * math.pi  # rad either way, of every joint of these arms
PLAIN = re.compile(r"[A-Za-z]+_\w+")  # an identifier that no reader of YAML takes for a number or a word of its own
LARGEST_M = 10.0  # of a link, m: beyond these arms, whose largest links have some 0.7 m
ALONG = 0.5  # cosine of the angle between the last axis and the last frame's z, above which z is meant to be the axis


class _Link(FileModel):
    x: Number = Field(description="a length in m")
    y: Number = Field(description="a length in m")
    z: Number = Field(description="a length in m")
    roll: Number = Field(description="an angle in rad")
    pitch: Number = Field(description="an angle in rad")
    yaw: Number = Field(description="an angle in rad")


class _Kinematics(FileModel):
    shoulder: _Link
    upper_arm: _Link
    forearm: _Link
    wrist_1: _Link
    wrist_2: _Link
    wrist_3: _Link
    hash: str | None = Field(None, description="the robot's own word, such as calib_12345")


class _File(FileModel):
    kinematics: _Kinematics = Field(description="the six transformations shoulder to wrist_3")


class UrCalibration(MachineFormat):
    """Six transformations, each followed by a joint about its z axis: m and rad, in the arm's Base.

    Roll, pitch and yaw are those of a URDF, since ur_description puts them there (``Rz(yaw) Ry(pitch) Rx(roll)``). The
    last frame is the flange (tool0): what lies behind the last axis, across and tilted, is no part of the file but of
    the tool centre point.
    """

    name: ClassVar = "ur-calibration"
    title: ClassVar = "a calibration.yaml of a Universal Robots arm"
    source: ClassVar = (
        "ur_calibration of Universal_Robots_ROS2_Driver (src/calibration.cpp), read by ur_description (ur_macro.xacro)"
    )
    identified: ClassVar = True

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        text = raw.text or ""
        return re.search(r"^kinematics\s*:", text, re.MULTILINE) is not None and "upper_arm" in text

    @classmethod
    def read(cls, raw: RawFile, part: Part) -> Description:
        file = validate(parse(raw.text or "", raw.name), _File)
        elements: list[Shape | Joint] = []
        for member, joint in zip(MEMBERS, JOINTS, strict=True):
            link: _Link = getattr(file.kinematics, member)
            far = max((link.x, link.y, link.z), key=abs)
            if abs(far) > LARGEST_M:
                where = f"{raw.name}, key kinematics.{member}"
                raise InputError(where, f"{far:g} m", "Write m: the links of these arms have less than 1 m")
            turned = rpy_matrix((link.roll, link.pitch, link.yaw))
            fixed = transform([MM_PER_M * v for v in (link.x, link.y, link.z)], turned)
            elements += [shape_of(member, fixed), Joint(joint, "rotary", (0.0, 0.0, 1.0), (-TRAVEL, TRAVEL))]
        elements.append(Shape("flange"))
        return Description(raw.path.stem, tuple(elements))

    @classmethod
    def write(cls, machine: Machine, suffix: str, extras: Extras) -> Written:
        joints = machine.joints
        if [j.type for j in joints] != ["rotary"] * len(JOINTS):
            found = f"{len(joints)} joints, {', '.join(f'{j.name} {j.type}' for j in joints)}"
            raise InputError("--format", found, "Such a file holds six rotary joints; take another format")
        fixed, end = _six(machine)
        lines = [f"# {extras.heading}"] if extras.heading else []
        lines.append("kinematics:")
        for member, own in zip(MEMBERS, fixed, strict=True):
            x, y, z = (in_metres(v) for v in vector(own[:3, 3]))
            numbers = dict(zip(("x", "y", "z", "roll", "pitch", "yaw"), (x, y, z, *rpy_angles(own)), strict=True))
            lines += [f"  {member}:", *(f"    {key}: {_number(value)}" for key, value in numbers.items())]
        body = "\n".join(lines[1:] if extras.heading else lines)
        identity = extras.identity or f"errormodel_{hashlib.sha256(body.encode()).hexdigest()[:16]}"
        lines.append(f"  hash: {json.dumps(identity)}" if not PLAIN.fullmatch(identity) else f"  hash: {identity}")
        return Written("\n".join(lines) + "\n", tuple(_notes(machine, end, extras)), end)


def _number(value: float) -> str:
    """A number that YAML 1.1 takes for one too, as the readers of ROS are: 1e-05 without a point is a text there."""
    text = repr(value)
    return text if "." in text else text.replace("e", ".0e")


def _six(machine: Machine) -> tuple[list[Array], Array]:
    """The six transformations, and what remains from the flange to the machine's last frame."""
    links = links_of(machine)
    frame, fixed, before = np.eye(4), list[Array](), np.eye(4)
    last = links.fixed[0]
    for member in links.fixed[1:]:
        last = last @ member
    for screw in screws(links):
        own = screw.z
        if screw.joint is None:
            before = before @ screw.z.matrix @ screw.x.matrix
            continue
        if screw.joint is links.joints[-1]:  # the flange stands where the last frame does, seen along the axis
            rest = inverse(frame @ before) @ last
            theta = math.atan2(rest[1, 0], rest[0, 0]) if rest[2, 2] > ALONG else own.theta
            own = AlongZ(theta, float(rest[2, 3]))
        fixed.append(before @ own.matrix)
        frame, before = frame @ fixed[-1], screw.x.matrix
    return fixed, inverse(frame) @ last


def _notes(machine: Machine, end: Array, extras: Extras) -> list[str]:
    from scipy.spatial.transform import Rotation

    point = end @ np.array([*machine.tool, 1.0])
    turned = Rotation.from_matrix(end[:3, :3]).as_rotvec()
    tcp = ", ".join(f"{round(float(v), 7) + 0.0:.7f}" for v in (*(point[:3] / MM_PER_M), *turned))
    across = 1e3 * math.hypot(end[0, 3], end[1, 3])
    tilt = 1e6 * math.acos(max(-1.0, min(1.0, end[2, 2])))
    notes = [
        f"the file ends at the flange; the functional point of the machine is the tool centre point p[{tcp}] (m, rad)"
    ]
    if end[2, 2] > ALONG:
        notes.append(
            f"not in the file, but in this tool centre point: the last frame lies {across:.1f} um beside the last axis "
            f"and is tilted against it by {tilt:.1f} urad"
        )
    if not extras.identity:
        notes.append(
            "the driver compares hash with the robot's own and says so where they differ; --hash writes the robot's, "
            "as its extracted calibration has it"
        )
    return notes
