"""Nominal forward kinematics in plain arithmetic, on arrays and on CasADi symbols, for levers of weights.

Origins in mm and axes in the frame of the reference; joint positions in mm and rad.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from errormodel.conventions import TRANSLATIONS
from errormodel.effects.base import Channels
from errormodel.effects.ops import Value, cos, sin
from errormodel.machine import Joint, Machine, Shape, Vector

Gravity = Literal["x", "-x", "y", "-y", "z", "-z"]  # its direction in the reference's axes
Triple = tuple[Value, Value, Value]
Turn = tuple[Triple, Triple, Triple]  # columns
IDENTITY: Turn = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))  # identity rotation


@dataclass(frozen=True)
class Place:
    """A frame of the chain in the reference's axes: origin (mm) and axes as columns."""

    origin: Triple
    turn: Turn


def places(machine: Machine, channel: Channels) -> list[Place]:
    """Nominal frame before each element, in chain order, and last the frame at the functional point."""
    point: Triple = (0.0, 0.0, 0.0)
    turn, out = IDENTITY, []
    for element in machine.elements:
        out.append(Place(point, turn))
        if not isinstance(element, Joint):
            point = add(point, apply(turn, element.offset))
            for k, angle in enumerate(element.rotation):
                turn = rotated(turn, IDENTITY[k], angle) if angle else turn
        elif element.type == "prismatic":
            q = channel(element.name)
            x, y, z = apply(turn, element.axis)
            point = add(point, (q * x, q * y, q * z))
        else:
            turn = rotated(turn, element.axis, channel(element.name))
    tool: Triple = (channel("tool_x"), channel("tool_y"), channel("tool_z"))
    out.append(Place(add(point, apply(turn, tool)), turn))
    return out


def weights_behind(machine: Machine, joint: Joint, frames: list[Place]) -> list[tuple[str, Place]]:
    """Names and places of the weights that a joint carries: the tool, then each member with a length, at its end.

    Parameters
    ----------
    frames : as of `places`.
    """
    first = machine.elements.index(joint) + 1
    members = [
        (member.name, frames[k])
        for k, member in enumerate(machine.elements[first:-1], start=first + 1)
        if isinstance(member, Shape) and any(member.offset)
    ]
    return [("tool", frames[-1]), *members]


def lever(axis: Triple, joint: Place, weight: Place, gravity: Gravity) -> Value:
    """Lever (mm) of a unit weight about an axis: ``axis . (arm x down)``, the arm from the joint to the weight."""
    k = TRANSLATIONS.index(f"d{gravity[-1]}")
    i, j = (k + 1) % 3, (k + 2) % 3
    arm = [w - o for w, o in zip(weight.origin, joint.origin, strict=True)]
    sign = -1.0 if gravity[0] == "-" else 1.0
    return sign * (axis[i] * arm[j] - axis[j] * arm[i])


def add(a: Triple, b: Triple) -> Triple:
    """Sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def apply(turn: Turn, vector: Triple) -> Triple:
    """A vector of a rotated frame, in the axes that the frame is given in."""
    x, y, z = (sum(turn[k][i] * v for k, v in enumerate(vector) if not _zero(v)) for i in range(3))
    return x, y, z


def rotated(turn: Turn, axis: Vector, angle: Value) -> Turn:
    """``turn`` followed by a right-handed rotation about a unit axis of its frame (Rodrigues)."""
    s, c = sin(angle), cos(angle)
    a, b, g = axis
    skew = ((0.0, g, -b), (-g, 0.0, a), (b, -a, 0.0))  # columns

    def column(k: int) -> Triple:
        x, y, z = (c * (i == k) + s * skew[k][i] + (1 - c) * axis[i] * axis[k] for i in range(3))
        return apply(turn, (x, y, z))

    return column(0), column(1), column(2)


def _zero(value: Value) -> bool:
    return isinstance(value, float) and value == 0.0
