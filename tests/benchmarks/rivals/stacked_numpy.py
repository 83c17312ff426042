"""What most write: one frame a pose, stacked as (n, 3, 3) and multiplied with ``@``; then screw columns.

Returns the dense M, (3n, 52), rows x y z of one pose after the other: all 52 columns. The same arithmetic as
`competent_numpy`, in the layout that comes to mind first.
"""

from __future__ import annotations

import numpy as np

from tests.benchmarks.five_axis import IDS, JOINTS, TOOL, Array, nominal
from tests.benchmarks.rivals.competent_numpy import estimates, independent_columns

__all__ = ["IDS", "build", "fit"]


def build(q: Array) -> Array:
    n = len(q)
    turn, point = np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3))
    frames = []  # axes and pivot of the errors, of each joint and of the member behind it
    for k, (_, kind, axis, _) in enumerate(JOINTS):
        if kind == "rotary":
            frames.append((turn, point))
            turn = turn @ _rotations(np.array(axis), q[:, k])
        else:
            point = point + q[:, k, None] * (turn @ np.array(axis))
            frames.append((turn, point))
        frames.append((turn, point))
    tip = point + turn @ np.array(TOOL)

    blocks = []
    for place, (turn, point) in enumerate(frames):
        _, kind, axis, _ = JOINTS[place // 2]
        travel = q[:, place // 2, None, None]
        lever = np.cross(turn, (tip - point)[:, :, None], axis=1)  # columns: each axis x lever arm
        shift = turn
        if place % 2 == 0 and kind == "rotary":
            shift, lever = np.sin(travel / 2) * turn, np.sin(travel / 2) * lever
        elif place % 2 == 0:  # a scale, and three angular rates with the straightness their integral gives
            shift = travel * (turn @ np.array(axis))[:, :, None]
            lever = travel * lever + travel**2 / 2 * (turn @ np.cross(np.eye(3), np.array(axis)).T)
        blocks += [shift, lever]
    return np.concatenate(blocks, axis=2).reshape(3 * n, -1)


def fit(q: Array, measured: Array) -> dict[str, object]:
    """Least squares from commands (n, 5) and measured positions (n, 3), mm; covariance and residual statistics."""
    M = build(q)
    base = independent_columns(M[:999])  # the first poses, all three rows of each
    return estimates(M[:, base], (measured - nominal(q)).ravel(), base, (-1, 3))


def _rotations(axis: Array, angle: Array) -> Array:
    cross = np.cross(np.eye(3), axis)
    return np.eye(3) + np.sin(angle)[:, None, None] * cross + (1 - np.cos(angle))[:, None, None] * (cross @ cross)
