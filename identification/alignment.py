"""The measuring frame of any size and orientation: closed-form alignment of nominal to measured points.

Weighted Kabsch/Umeyama (rotation by singular value decomposition), reweighted so that gross outliers do not tilt it;
what the points leave open (a line, a single point, a missing component) stays as near to no rotation as it can.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array


@dataclass(frozen=True)
class Pose:
    """``y = rotation x + translation``: from the machine's reference into the measuring frame, mm."""

    rotation: Array  # (3, 3)
    translation: Array  # (3,)

    def apply(self, points: Array) -> Array:
        """Points (n, 3) of the reference, in the measuring frame."""
        return points @ self.rotation.T + self.translation

    def invert(self, points: Array) -> Array:
        """Points (n, 3) of the measuring frame, in the reference."""
        if self is IDENTITY:  # a fixed frame: the same numbers, and a pass over many rows less
            return points
        return (points - self.translation) @ self.rotation

    def then_small(self, shift: Array, turn: Array) -> Pose:
        """The pose with a further motion ``Trans(shift) Rot(turn)`` on the machine's side."""
        return Pose(self.rotation @ turn, self.rotation @ shift + self.translation)


IDENTITY = Pose(np.eye(3), np.zeros(3))


def align(nominal: Array, measured: Array, weights: Array | None = None, rounds: int = 20) -> Pose:
    """Pose that carries nominal points (n, 3) onto measured ones (n, 3, NaN where a component is missing).

    `weights` (n,) are 1/sigma. Reweighted by 1/(1 + (distance/scale)^2): up to a third of gross outliers of any size
    do not matter.
    """
    w = np.ones(len(nominal)) if weights is None else weights / weights.max()
    full = np.isfinite(measured).all(axis=1)
    if full.sum() < 3:  # too few whole points: no rotation can be had, the middle of each component can
        gaps = np.where(np.isfinite(measured), measured - nominal, np.nan)
        seen = np.isfinite(gaps).any(axis=0)
        shift = np.zeros(3)
        shift[seen] = np.nanmedian(gaps[:, seen], axis=0)
        return Pose(np.eye(3), shift)
    a, b, w = nominal[full], measured[full], w[full]
    pose = _kabsch(a, b, w)
    least = 1e-8 * float(np.abs(a).max())  # the closed form is exact to 1e-10
    for _ in range(rounds if len(a) > 6 else 0):  # of fewer points, so few may agree that they determine no frame
        distance = np.linalg.norm(b - pose.apply(a), axis=1)
        scale = max(3.0 * float(np.median(distance)), least, 1e-9)
        new = _kabsch(a, b, w / (1 + (distance / scale) ** 2))
        done = np.abs(new.apply(a) - pose.apply(a)).max() < 1e-6 * scale
        pose = new
        if done:
            break
    return pose


def _kabsch(a: Array, b: Array, w: Array) -> Pose:
    w = w**2 / (w**2).sum()
    middle_a, middle_b = w @ a, w @ b
    cross = (b - middle_b).T @ ((a - middle_a) * w[:, None])
    cross += 1e-10 * (np.trace(cross @ cross.T) ** 0.5 + 1e-12) * np.eye(3)  # what is left open: no rotation
    u, _, v = np.linalg.svd(cross)
    rotation = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
    return Pose(rotation, middle_b - rotation @ middle_a)


def mean_rotation(rotations: Array) -> Array:
    """Chordal mean (3, 3) of rotations (n, 3, 3), as medians would have it: reweighted by distance."""
    weights = np.ones(len(rotations))
    mean = np.eye(3)
    for _ in range(10):
        u, _, v = np.linalg.svd(np.tensordot(weights, rotations, axes=1))
        mean = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
        distance = np.linalg.norm(rotations - mean, axis=(1, 2))
        weights = 1 / (1 + (distance / max(3.0 * float(np.median(distance)), 1e-12)) ** 2)
    return mean
