"""Rigid transformations of chains as (4, 4) arrays: between joints, and their angles in two conventions; mm and rad."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, rotation_matrix
from errormodel.machine import Joint, Machine, Shape, Vector

MM_PER_M = 1000.0


def in_metres(length: float) -> float:
    """A length (mm) in m, without what rounding has left: a hundredth of a picometre."""
    return round(length / MM_PER_M, 14) + 0.0


@dataclass(frozen=True)
class Links:
    """A serial chain as its joints and the fixed transformations before, between and behind them.

    Attributes
    ----------
    joints : n joints; each turns about, or moves along, its axis.
    fixed : n + 1 transformations (4, 4), mm.
    """

    joints: tuple[Joint, ...]
    fixed: tuple[Array, ...]


def links_of(machine: Machine) -> Links:
    """Joints of a machine, and what its members are between them."""
    joints: list[Joint] = []
    fixed = [np.eye(4)]
    for element in machine.elements:
        if isinstance(element, Joint):
            joints.append(element)
            fixed.append(np.eye(4))
        else:
            fixed[-1] = fixed[-1] @ transform(element.offset, rotation_matrix(element.rotation))
    return Links(tuple(joints), tuple(fixed))


def shape_of(name: str, fixed: Array) -> Shape:
    """A member with that transformation."""
    return Shape(name, vector(fixed[:3, 3]), rotation_angles(fixed[:3, :3]))


def transform(offset: Sequence[float] | Array, rotation: Array | None = None) -> Array:
    """``Trans(offset) Rot``, (4, 4)."""
    out = np.eye(4)
    out[:3, 3] = offset
    if rotation is not None:
        out[:3, :3] = rotation
    return out


def inverse(fixed: Array) -> Array:
    """The inverse of a rigid transformation."""
    turn = fixed[:3, :3].T
    return transform(-turn @ fixed[:3, 3], turn)


def vector(values: Array) -> Vector:
    """Three numbers; a negative zero is a zero, and dust of a rounding is one too."""
    x, y, z = (0.0 if abs(v) < 1e-12 else float(v) for v in values)  # a millionth of a picometre
    return x, y, z


def turn(axis: int, angle: float) -> Array:
    """Rotation about x, y or z (0, 1, 2) as (3, 3), rad; right angles are exact."""
    quarter = round(angle / (math.pi / 2))
    exact = angle == quarter * (math.pi / 2)
    c, s = ((1, 0, -1, 0)[quarter % 4], (0, 1, 0, -1)[quarter % 4]) if exact else (math.cos(angle), math.sin(angle))
    out = np.eye(3)
    i, k = (axis + 1) % 3, (axis + 2) % 3
    out[i, i] = out[k, k] = c
    out[i, k], out[k, i] = -s, s
    return out


def rpy_matrix(angles: Sequence[float]) -> Array:
    """Rotation by roll, pitch, yaw about the fixed x, y, z: ``Rz(yaw) Ry(pitch) Rx(roll)``."""
    roll, pitch, yaw = angles
    return turn(2, yaw) @ turn(1, pitch) @ turn(0, roll)


def rpy_angles(matrix: Array) -> Vector:
    """Roll, pitch and yaw of a rotation.

    The yaw is chosen first and the roll follows from it, so that the three give the same rotation to rounding at a
    pitch of 90 degrees as well, where the yaw is any.
    """
    across = math.hypot(matrix[0, 0], matrix[1, 0])
    pitch = math.atan2(-matrix[2, 0], across)
    yaw = math.atan2(matrix[1, 0], matrix[0, 0]) if across > 5e-15 else 0.0  # below: rounding
    c, s = math.cos(yaw), math.sin(yaw)
    roll = math.atan2(s * matrix[0, 2] - c * matrix[1, 2], c * matrix[1, 1] - s * matrix[0, 1])
    return _clean(roll), _clean(pitch), _clean(yaw)


def rotation_angles(matrix: Array) -> Vector:
    """Angles about x, then y, then z of the turned frame, as a shape's ``rotation`` has them: ``Rx Ry Rz``."""
    a, b, c = rpy_angles(matrix.T)
    return _clean(-a), _clean(-b), _clean(-c)


def _clean(angle: float) -> float:
    """The angle; within rounding of a right angle or of zero that angle itself, and never a negative zero."""
    quarter = round(angle / (math.pi / 2)) * (math.pi / 2)
    return quarter + 0.0 if abs(angle - quarter) < 5e-15 else angle
