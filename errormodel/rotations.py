"""Rotations as CasADi expressions."""

from __future__ import annotations

from functools import cache

import casadi as ca


def rotation_xyz(angles: ca.SX) -> ca.SX:
    """``Rx(a) Ry(b) Rz(c)``: rotations about x, then y, then z of the rotated frame, rad."""
    return _rotation()(angles)


@cache
def _rotation() -> ca.Function:
    """`rotation_xyz` as a function: a chain turns by it some dozen times, and to put its parts together takes long."""
    angles = ca.SX.sym("angles", 3)
    turns = [rotation_about(ca.SX(ca.DM.eye(3)[:, k]), angles[k]) for k in range(3)]
    return ca.Function("rotation_xyz", [angles], [ca.mtimes(turns)])


def rotation_about(axis: ca.SX, angle: ca.SX) -> ca.SX:
    """Right-handed rotation about a unit axis, rad (Rodrigues)."""
    if angle.is_zero():
        return ca.SX.eye(3)
    cross = ca.skew(axis)
    return ca.SX.eye(3) + ca.sin(angle) * cross + (1 - ca.cos(angle)) * (axis @ axis.T - ca.SX.eye(3))
