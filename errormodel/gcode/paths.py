"""Paths of one block in positions of the axes (mm, deg): straight lines, arcs and helices.

Source: NIST IR 6556, sections 3.5.1 to 3.5.3 (motion at rapid and feed rate, arcs by centre and by radius).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from errormodel.gcode.words import Block

# mm: permitted difference of the radii at an arc's ends, a unit of the third decimal at each end
ARC_RADIUS_TOLERANCE_MM = 0.005
ARC_REVERSAL_MM = 0.001  # mm: a smaller motion back at an end of an arc counts as no reversal; by judgement
ARC_CHORD_MM = 0.0005  # mm: permitted distance between an arc and its chords; by judgement
FULL_TURN = 2 * np.pi  # rad


@dataclass(frozen=True)
class Line:
    """From `start` to `end`, (axes,) mm and deg."""

    start: Array
    end: Array

    @property
    def length(self) -> float:
        return float(np.linalg.norm(self.end - self.start))

    def at(self, share: Array) -> Array:
        """Positions (k, axes) at shares of the length (k,)."""
        return np.asarray(self.start + share[:, None] * (self.end - self.start))

    def corners(self) -> Array:
        """Shares between which no axis reverses by more than `ARC_REVERSAL_MM`."""
        return np.array([0.0, 1.0])

    def pieces(self) -> int:
        """Smallest number of straight pieces."""
        return 1

    def nearest(self, q: Array, near: Array) -> Array:
        """Shares of the path nearest to positions (k, axes)."""
        step = self.end - self.start
        size = float(step @ step)
        return np.clip((q - self.start) @ step / size, 0, 1) if size else np.ones(len(q))


@dataclass(frozen=True)
class Arc(Line):
    """An arc about `centre` in the plane of two axes (columns `i`, `j`), other axes in proportion to its angle.

    Where the radii at its ends differ the radius changes evenly.
    """

    i: int
    j: int
    centre: Array  # (2,) mm
    angle: float  # rad, counter-clockwise positive

    @property
    def _first(self) -> Array:
        return self.start[[self.i, self.j]] - self.centre

    @property
    def radius(self) -> float:
        return float(np.hypot(*self._first))

    @property
    def length(self) -> float:
        others = np.delete(self.end - self.start, [self.i, self.j])
        return float(np.hypot(self.radius * self.angle, np.linalg.norm(others)))

    def at(self, share: Array) -> Array:
        out = super().at(share)
        last = self.end[[self.i, self.j]] - self.centre
        size = self.radius + share * (float(np.hypot(*last)) - self.radius)
        angle = np.arctan2(self._first[1], self._first[0]) + share * self.angle
        out[:, self.i], out[:, self.j] = (self.centre[k] + size * f(angle) for k, f in enumerate((np.cos, np.sin)))
        out[share >= 1] = self.end
        out[share <= 0] = self.start
        return np.asarray(out)

    def corners(self) -> Array:
        first = float(np.arctan2(self._first[1], self._first[0]))
        low, high = sorted((first, first + self.angle))
        quarters = np.arange(np.ceil(low / (FULL_TURN / 4)), np.floor(high / (FULL_TURN / 4)) + 1) * (FULL_TURN / 4)
        inner = np.sort((quarters - first) / self.angle)
        beside = np.minimum(inner, 1 - inner) * abs(self.angle)
        turned = self.radius * (1 - np.cos(np.minimum(beside, FULL_TURN / 4))) > ARC_REVERSAL_MM
        return np.concatenate([[0.0], inner[turned], [1.0]])

    def pieces(self) -> int:
        step = 2 * np.arccos(max(1 - ARC_CHORD_MM / max(self.radius, ARC_CHORD_MM), 0.0))
        return max(int(np.ceil(abs(self.angle) / step)), 1)

    def nearest(self, q: Array, near: Array) -> Array:
        """Shares of the path nearest to positions; of the possible turns, those nearest to shares `near` (k,)."""
        first = np.arctan2(self._first[1], self._first[0])
        beside = q[:, [self.i, self.j]] - self.centre
        share = (np.arctan2(beside[:, 1], beside[:, 0]) - first) / self.angle
        turn = FULL_TURN / abs(self.angle)
        share = share + np.rint((near - share) / turn) * turn
        # of a helix: mean of the shares by angle and by the other axes, weighted by length
        rise = self.end - self.start
        rise[[self.i, self.j]] = 0.0
        around = (self.radius * self.angle) ** 2
        return np.asarray(np.clip((around * share + (q - self.start) @ rise) / (around + rise @ rise), 0, 1))


def arc_of(block: Block, start: Array, end: Array, clockwise: bool, columns: tuple[int, int], centre: Array) -> Arc:
    """The arc of a block.

    Parameters
    ----------
    start, end : (axes,) mm and deg.
    columns : of the axes of its plane; `centre` : (2,) mm in it.

    Raises
    ------
    InputError
        The end is not on the circle, or the circle is none.
    """
    i, j = columns
    a, b = start[[i, j]], end[[i, j]]
    first, last = a - centre, b - centre
    radii = float(np.hypot(*first)), float(np.hypot(*last))
    if min(radii) < ARC_RADIUS_TOLERANCE_MM:
        block.refuse(f"an arc of radius {min(radii):.4f} mm", "Write its centre from the start (I, J, K)")
    if abs(radii[0] - radii[1]) > ARC_RADIUS_TOLERANCE_MM:
        found = (
            f"an arc whose end is not on its circle (radius {radii[0]:.4f} mm at the start, {radii[1]:.4f} at the end)"
        )
        block.refuse(found, f"Write end and centre to within {ARC_RADIUS_TOLERANCE_MM} mm")
    angle = float(np.arctan2(first[0] * last[1] - first[1] * last[0], first @ last))
    closed = float(np.hypot(*(b - a))) < 1e-9
    if clockwise:
        angle = angle - FULL_TURN if angle > 0 or closed else angle
    else:
        angle = angle + FULL_TURN if angle < 0 or closed else angle
    if abs(angle) < 1e-9:
        block.refuse("an arc without an angle", "Write the end where the arc ends, or leave it out for a full circle")
    return Arc(start, end, i, j, centre, angle)


def centre_by_radius(block: Block, a: Array, b: Array, radius: float, clockwise: bool) -> Array:
    """Centre (2,) of the arc from `a` to `b` (2,), mm: less than half a turn, of a negative radius more.

    Raises
    ------
    InputError
        The ends are too far apart for the radius, or the same.
    """
    chord, half = b - a, float(np.hypot(*(b - a))) / 2
    if half < 1e-6:
        block.refuse("an arc by radius whose end is its start", "Write a full circle by its centre (I, J, K)")
    if half - abs(radius) > ARC_RADIUS_TOLERANCE_MM / 2:
        found = f"an arc whose ends are {2 * half:.4f} mm apart, more than twice its radius of {abs(radius):.4f} mm"
        block.refuse(found, "Write a larger radius")
    height = float(np.sqrt(max(radius**2 - half**2, 0.0)))
    left = np.array([-chord[1], chord[0]]) / (2 * half)
    side = -1.0 if clockwise == (radius > 0) else 1.0
    return np.asarray((a + b) / 2 + side * height * left)
