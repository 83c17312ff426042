"""Joint axes of a chain as screws about z and x in turn, from which all Denavit-Hartenberg conventions are cut.

A chain is ``Z0 X0 Z1 X1 ... Zn Xn Z(n+1)`` with ``Z = Rz(theta) Tz(d)`` along a joint's axis, to which the joint's
position is added, and ``X = Tx(a) Rx(alpha)`` along the common normal to the next axis. Axes that are parallel but for
errors have no useful common normal: its foot runs away along them. There ``X = Tx(a) Rx(alpha) Ry(beta)`` with d = 0,
of Hayati and Mirmirani, "Improving the absolute positioning accuracy of robot manipulators", J. Robotic Systems 2
(1985) 397-413.

The standard convention takes ``Zi Xi`` together (Denavit and Hartenberg 1955, Paul 1981), the modified one
``X(i-1) Zi`` (Craig 1986).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from errormodel.machine import Joint
from errormodel.machine_formats.transforms import Links, inverse, transform, turn

# sine of the angle between two axes below which they are taken as parallel but for errors. Their common normal would
# lie up to 1/NEAR times their distance away; errors of arms are some mrad. By judgement.
NEAR = 0.05
SMALL_MM = 1.0  # from an axis: below, an error and no dimension; by judgement
SAME_MM = 1e-9  # of two points: rounding of a metre
SAME_SINE = 1e-13  # of two directions: rounding


@dataclass(frozen=True)
class AlongZ:
    """``Rz(theta) Tz(d)``, rad and mm."""

    theta: float = 0.0
    d: float = 0.0

    @property
    def matrix(self) -> Array:
        return transform((0.0, 0.0, self.d), turn(2, self.theta))


@dataclass(frozen=True)
class AlongX:
    """``Tx(a) Rx(alpha) Ry(beta)``, mm and rad."""

    a: float = 0.0
    alpha: float = 0.0
    beta: float = 0.0

    @property
    def matrix(self) -> Array:
        return transform((self.a, 0.0, 0.0), turn(0, self.alpha) @ turn(1, self.beta))


@dataclass(frozen=True)
class Screw:
    """``Z X`` of a joint, or of the base or the tool, which have none."""

    joint: Joint | None
    z: AlongZ
    x: AlongX


def screws(links: Links) -> list[Screw]:
    """``Z0 X0 ... Z(n+1)`` of a chain with n joints: the base, the joints, the tool.

    Of the two directions of each common normal that with the smaller angle theta is taken, so that a table reads as its
    machine's zero pose. A slide has a direction and no place: its axis is laid through the next one. Where the first
    axis lies beside the reference by an error, or the last frame beside the last axis, the direction of that error is
    turned back behind it, so that the joint's own theta stays what it is.
    """
    lines, end = _axes(links), _end(links)
    frame, out = np.eye(4), list[Screw]()

    def step(joint: Joint | None, z: AlongZ, x: AlongX) -> None:
        nonlocal frame
        out.append(Screw(joint, z, x))
        frame = frame @ z.matrix @ x.matrix

    for k, (point, direction) in enumerate(lines):
        joint, last = (links.joints[k - 1] if k else None), k == len(links.joints)
        here = inverse(frame)
        turned = here[:3, :3] @ end[:3, :3] if last else None
        z, x = _to_next(here[:3, :3] @ point + here[:3, 3], here[:3, :3] @ direction, turned)
        aside = SAME_MM < abs(x.a) < SMALL_MM and abs(math.sin(x.alpha)) < NEAR
        if last and aside and turned is not None:
            step(joint, AlongZ(math.atan2(turned[1, 0], turned[0, 0]), z.d), AlongX())
            here = inverse(frame)
            z, x = _to_next(here[:3, :3] @ point + here[:3, 3], here[:3, :3] @ direction, here[:3, :3] @ end[:3, :3])
            joint = None  # the error of the last frame is none of the joint's
        step(joint, z, x)
        if len(out) == 1 and aside:
            step(None, AlongZ(-z.theta), AlongX())
    rest = inverse(frame) @ end
    theta = _dusted(math.atan2(rest[1, 0], rest[0, 0]), SAME_SINE)
    step(None, AlongZ(theta, _dusted(rest[2, 3], SAME_MM)), AlongX())
    return out


def _end(links: Links) -> Array:
    """The last frame with all joints at zero."""
    frame = np.eye(4)
    for fixed in links.fixed:
        frame = frame @ fixed
    return frame


def _axes(links: Links) -> list[tuple[Array, Array]]:
    """A point and the direction of each joint's axis, and of the z axis of the last frame, all joints at zero."""
    frame, found = np.eye(4), []
    for joint, fixed in zip(links.joints, links.fixed[:-1], strict=True):
        frame = frame @ fixed
        found.append((frame[:3, 3], frame[:3, :3] @ np.array(joint.axis)))
    end = _end(links)
    found.append((end[:3, 3], end[:3, 2]))
    for k in reversed(range(len(links.joints))):
        if links.joints[k].type == "prismatic":
            found[k] = (found[k + 1][0], found[k][1])
    return found


def _to_next(point: Array, direction: Array, last: Array | None) -> tuple[AlongZ, AlongX]:
    """From the z axis to a line, both in the same frame.

    `last` : orientation of the last frame, where the line is its z axis and `point` its origin. Along a parallel axis
    that frame is then reached by theta and d of the last joint, as published tables have it.
    """
    x, y, z = direction.tolist()
    sine = math.hypot(x, y)
    if sine > NEAR:
        normal = np.array([-y, x, 0.0]) / sine
        reach = float(point @ np.array([x, y, 0.0])) / sine**2
        a, d = float(point @ normal), float(point[2]) - reach * z
        theta = math.atan2(normal[1], normal[0])
    else:
        d = 0.0 if last is None else float(point[2])
        foot = point - direction * ((point[2] - d) / z)
        a = math.hypot(foot[0], foot[1])
        alike = 0.0 if last is None else math.atan2(last[1, 0], last[0, 0])
        theta = math.atan2(foot[1], foot[0]) if a > SAME_MM else alike
    theta, a = _dusted(theta, SAME_SINE), _dusted(a, SAME_MM)
    if (theta > math.pi / 2 or theta <= -math.pi / 2) and (a or last is None):
        theta, a = theta - math.copysign(math.pi, theta), -a + 0.0
    seen = turn(2, theta).T @ direction
    beta = math.asin(max(-1.0, min(1.0, float(seen[0])))) if sine <= NEAR else 0.0
    alpha = math.atan2(-float(seen[1]), float(seen[2]))
    return (
        AlongZ(_dusted(theta, SAME_SINE), _dusted(d, SAME_MM)),
        AlongX(a, _dusted(alpha, SAME_SINE), _dusted(beta, SAME_SINE)),
    )


def _dusted(value: float, least: float) -> float:
    """The value, without what rounding has left: zero and right angles as such."""
    near = round(value / (math.pi / 2)) * (math.pi / 2) if least == SAME_SINE else 0.0
    return near + 0.0 if abs(value - near) <= least else float(value)
