"""What a competent user writes: frames of all poses at once as stacked arrays, and screw columns. No block, no trick.

Returns the dense M, (3n, 52), rows x y z of one pose after the other: all 52 columns.
"""

from __future__ import annotations

import numpy as np

from tests.benchmarks.five_axis import IDS, JOINTS, MOTIONS, RANK, TOOL, Array, nominal

__all__ = ["IDS", "build", "fit", "solve"]


def build(q: Array) -> Array:
    n = len(q)
    turn, point = np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3))
    frames = []  # axes and pivot of the errors, of each joint and of the member behind it
    for k, (_, kind, axis, _) in enumerate(JOINTS):
        if kind == "rotary":
            frames.append((turn, point))
            turn = turn @ _rotations(axis, q[:, k])
        else:
            point = point + q[:, k, None] * (turn @ np.array(axis))
            frames.append((turn, point))
        frames.append((turn, point))
    tip = point + turn @ np.array(TOOL)

    M = np.empty((n, 3, len(IDS)))
    column = 0
    for place, (turn, point) in enumerate(frames):
        _, kind, axis, _ = JOINTS[place // 2]
        lever = np.cross(turn, (tip - point)[:, :, None], axis=1)  # columns: each axis x lever arm
        width = 6
        if place % 2:  # a member: constants
            M[:, :, column : column + 3] = turn
            M[:, :, column + 3 : column + 6] = lever
        elif kind == "rotary":
            half = np.sin(q[:, place // 2] / 2)[:, None, None]
            M[:, :, column : column + 3] = half * turn
            M[:, :, column + 3 : column + 6] = half * lever
        else:  # a scale, and three angular rates with the straightness their integral gives
            travel = q[:, place // 2, None, None]
            bend = np.cross(np.eye(3), np.array(axis)).T
            M[:, :, column] = travel[:, 0] * (turn @ np.array(axis))
            M[:, :, column + 1 : column + 4] = travel * lever + travel**2 / 2 * (turn @ bend)
            width = 4
        column += width
    return M.reshape(3 * n, -1)


def fit(q: Array, measured: Array) -> dict[str, object]:
    """Least squares from commands (n, 5) and measured positions (n, 3), mm."""
    return solve(q, measured - nominal(q))


def solve(q: Array, errors: Array) -> dict[str, object]:
    """Least squares on independent columns, with residual statistics and covariance, as a user would."""
    M = build(q)
    base = independent_columns(M)
    A, e = M[:, base], errors.ravel()
    values = np.linalg.lstsq(A, e, rcond=None)[0]
    residuals = e - A @ values
    variance = float(residuals @ residuals) / (len(e) - len(base))
    size = np.linalg.norm(residuals.reshape(-1, 3), axis=1)
    return {
        "ids": tuple(IDS[k] for k in base),
        "values": values,
        "covariance": variance * np.linalg.inv(A.T @ A),
        "sigma": variance**0.5,
        "rms": float(np.sqrt((size**2).mean())),
        "mean": float(size.mean()),
        "max": float(size.max()),
    }


def independent_columns(M: Array) -> list[int]:
    """Columns that a pivoted QR of a few hundred scaled rows keeps."""
    from scipy.linalg import qr

    some = M[: 3 * 400]
    scale = np.sqrt((some**2).sum(axis=0))
    scale[scale < 1e-12 * scale.max()] = np.inf  # columns without effect are rounding errors, not zeros
    order = qr(some / scale, mode="r", pivoting=True)[1]
    return sorted(int(k) for k in order[:RANK])


def _rotations(axis: tuple[float, float, float], angle: Array) -> Array:
    cross = np.cross(np.eye(3), np.array(axis))
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * cross + (1 - c) * (cross @ cross)
