"""Pose of a measuring frame: a rigid motion from the machine's reference, and what of it the points determine."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from errormodel.arrays import Array

# How far a radian about an axis moves the points (root mean square) over the misfit, from which that rotation is
# determined: to a tenth of a radian whatever causes the misfit, because errors of the machine do not average out over
# rows as noise does
ROTATION_SPREAD_RATIO = 10.0


@dataclass(frozen=True)
class Pose:
    """Rigid motion ``y = rotation x + translation`` from the machine's reference into the measuring frame.

    Attributes
    ----------
    rotation : (3, 3).
    translation : (3,) mm.
    undetermined : (k, 3) unit vectors in the reference about which the rotation is assumed, because the points do not
        determine it: k = 0 for a volume or plane, 1 for a line, 3 for a point.
    """

    rotation: Array
    translation: Array
    undetermined: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def apply(self, points: Array) -> Array:
        """Transform points (n, 3), mm, from the reference into the measuring frame."""
        return points @ self.rotation.T + self.translation

    def invert(self, points: Array) -> Array:
        """Transform points (n, 3), mm, from the measuring frame into the reference."""
        if self is IDENTITY:  # a fixed frame: saves a pass over the rows
            return points
        return (points - self.translation) @ self.rotation

    def then_small(self, shift: Array, turn: Array) -> Pose:
        """The pose times ``Trans(shift) Rot(turn)`` on the machine's side; shift (3,) mm, turn (3, 3)."""
        return Pose(self.rotation @ turn, self.rotation @ shift + self.translation, self.undetermined)


IDENTITY = Pose(np.eye(3), np.zeros(3))
