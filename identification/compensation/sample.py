"""Poses of the volume with their errors, and small motions of the workpiece's frame, which are free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array


@dataclass(frozen=True)
class Sample:
    """Sample of poses of the volume, in the controller's units (mm, deg).

    Attributes
    ----------
    q, direction : (n, axes) commands, and directions of approach (+-1).
    errors : (n, 3) actual minus nominal, mm.
    motion : (n, 3, movers) mm of the nominal tip per unit of each mover (the actual tip's would let millimetres of a
        shift of the frame turn the axes' own errors into corrections).
    frame : (n, 3, 6) mm of the tip per mm or rad of the frame's motions; (n, 3, 0) where the frame is fixed.
    sides : 2 where the second half repeats the first with the opposite directions of approach.
    """

    q: Array
    direction: Array
    errors: Array
    motion: Array
    frame: Array
    sides: int = 1

    def moves_as(self, other: Sample) -> bool:
        """Whether the other sample has the same poses and motions; its errors may differ."""
        mine = self.q, self.direction, self.motion, self.frame
        return self.sides == other.sides and all(
            np.array_equal(a, b)
            for a, b in zip(mine, (other.q, other.direction, other.motion, other.frame), strict=True)
        )


def frame_motion(points: Array, free: bool, turns: bool = True) -> Array:
    """Jacobian (n, 3, 6) of points (n, 3) by small motions of the frame: shifts, then rotations about the centroid.

    (n, 3, 0) where the frame is not `free`; (n, 3, 3), shifts only, without `turns`.
    """
    n = len(points)
    if not free:
        return np.zeros((n, 3, 0))
    if not turns:
        return np.tile(np.eye(3), (n, 1, 1))
    out = np.zeros((n, 3, 6))
    out[:, :, :3] = np.eye(3)
    turn = -np.cross(points - points.mean(axis=0), np.eye(3)[:, None, :])  # (3, n, 3): e_k x r
    out[:, :, 3:] = turn.transpose(1, 2, 0)
    return out


def framed(errors: Array, frame: Array) -> Array:
    """Errors (n, 3) after the least-squares motion of the frame."""
    flat = frame.reshape(errors.size, -1)
    if not flat.shape[1]:
        return errors
    return errors - (flat @ np.linalg.lstsq(flat, errors.ravel(), rcond=1e-9)[0]).reshape(errors.shape)
