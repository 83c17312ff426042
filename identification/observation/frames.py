"""The measuring frame of any size and orientation: closed-form alignment of nominal to measured points.

Weighted Kabsch/Umeyama (rotation by singular value decomposition), reweighted so that gross outliers do not tilt it.
Rotations that the nominal points do not determine (all of a single point, one of a line) are not taken from the noise:
they stay as the survey says, or at none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from errormodel.arrays import Array

SMALL = 2e-4  # of the machine's size: a larger error at the nominal point is no machine's (0.6 mm in 3 m)
HELD = 10.0  # standard deviation of the nominal points over the misfit: a rotation is then sure to a tenth of a radian,
# whatever makes the misfit; errors of the machine do not average out over rows as noise does
SURE = 0.99  # of the misfit, which few points know badly: its upper limit counts
CHANCE = 1e-3  # that points which are not turned look turned
EXACT = 1e-9  # of the coordinates: no spread, but round-off


@dataclass(frozen=True)
class Pose:
    """``y = rotation x + translation``: from the machine's reference into the measuring frame, mm.

    Attributes
    ----------
    undetermined : (k, 3) unit vectors in the reference. The points did not determine the rotation about them, which is
        an assumption: none of a volume or a plane, one of a line, three of a point.
    """

    rotation: Array  # (3, 3)
    translation: Array  # (3,)
    undetermined: Array = field(default_factory=lambda: np.zeros((0, 3)))

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
        return Pose(self.rotation @ turn, self.rotation @ shift + self.translation, self.undetermined)


IDENTITY = Pose(np.eye(3), np.zeros(3))


def align(
    nominal: Array,
    measured: Array,
    weights: Array | None = None,
    rounds: int = 20,
    assumed: Array | None = None,
    largest: float = np.inf,
) -> Pose:
    """Pose that carries nominal points (n, 3) onto measured ones (n, 3, NaN where a component is missing).

    The rotation is determined only as far as the nominal points spread (see `_rank`); about the other axes it stays
    as near as it can to the assumed one. Reweighted by 1/(1 + (distance/scale)^2): up to a third of gross outliers of
    any size do not matter.

    Parameters
    ----------
    weights : (n,) 1/sigma.
    rounds : the most reweightings.
    assumed : (3, 3) rotation where the points do not tell; None: none.
    largest : misfit (mm) that errors of a machine can make. A larger one is a mistake in the recording, which says
        nothing of how well the points determine the rotation.
    """
    if assumed is not None:
        pose = align(nominal @ assumed.T, measured, weights, rounds, largest=largest)
        return Pose(pose.rotation @ assumed, pose.translation, pose.undetermined @ assumed)
    w = np.ones(len(nominal)) if weights is None else weights / weights.max()
    full = np.isfinite(measured).all(axis=1)
    if not full.any():  # no rotation can be had, the middle of each component can
        gaps = np.where(np.isfinite(measured), measured - nominal, np.nan)
        seen = np.isfinite(gaps).any(axis=0)
        shift = np.zeros(3)
        shift[seen] = np.nanmedian(gaps[:, seen], axis=0)
        return Pose(np.eye(3), shift, np.eye(3))
    a, b, w = nominal[full], measured[full], w[full]
    pose = _kabsch(a, b, w)
    counted = w
    least = 1e-8 * float(np.abs(a).max())  # the closed form is exact to 1e-10
    for _ in range(rounds if len(a) > 6 else 0):  # of fewer points, so few may agree that they determine no frame
        distance = np.linalg.norm(b - pose.apply(a), axis=1)
        scale = max(3.0 * float(np.median(distance)), least, 1e-9)
        counted = w / (1 + (distance / scale) ** 2)
        new = _kabsch(a, b, counted)
        done = np.abs(new.apply(a) - pose.apply(a)).max() < 1e-6 * scale
        pose = new
        if done:
            break
    return _as_far_as_determined(a, b, counted, pose, largest)


def _as_far_as_determined(a: Array, b: Array, w: Array, best: Pose, largest: float) -> Pose:
    """The best pose, or one of a lower rank where the spread of the nominal points does not determine it.

    A principal direction of the nominal points counts if their standard deviation along it is `HELD` times the misfit,
    or if the measured points are turned so far that the misfit without it is twice as large, by more than chance.
    """
    from scipy.special import chdtri, fdtri

    square = w**2 / (w**2).sum()
    about = a - square @ a
    variance, axes = np.linalg.eigh(about.T @ (about * square[:, None]))
    spread, axes = np.sqrt(np.maximum(variance[::-1], 0.0)), axes[:, ::-1].T  # the widest direction first
    seen = spread > EXACT * max(float(np.abs(a).max()), 1e-300)
    rank = min(int(seen.sum()), 2)  # a plane determines all three rotations, a line two
    poses = {rank: best if rank == 2 else _of_rank(a, b, w, axes, rank)}
    while rank:
        lower = poses[rank - 1] = _of_rank(a, b, w, axes, rank - 1)
        misfit, without = (float(square @ np.square(b - p.apply(a)).sum(axis=1)) for p in (poses[rank], lower))
        more = 3 - rank  # rotations that this direction adds: two of a line, one of a plane
        free = 3 * len(a) - 3 - (2 if rank == 1 else 3)
        coordinate = np.sqrt(misfit * len(a) / free) if free > 0 else np.inf
        upper = coordinate * np.sqrt(free / chdtri(free, SURE)) if free > 0 else np.inf
        if spread[rank - 1] >= HELD * min(upper, largest):
            break
        beyond = (without - misfit) / more > fdtri(more, free, 1 - CHANCE) * misfit / free if free > 0 else False
        if beyond and without > 4 * misfit:
            break
        rank -= 1
    pose = poses[rank]
    return Pose(pose.rotation, pose.translation, (np.eye(3), axes[:1], np.zeros((0, 3)))[rank])


def _of_rank(a: Array, b: Array, w: Array, axes: Array, rank: int) -> Pose:
    """The best pose whose rotation is that of the nominal points' first principal directions, by least angle.

    Of rank 0 no rotation at all, of rank 1 the smallest that carries the line through the nominal points onto that
    through the measured ones.
    """
    from scipy.spatial.transform import Rotation

    if rank == 2:
        return _kabsch(a, b, w)
    square = w**2 / (w**2).sum()
    middle_a, middle_b = square @ a, square @ b
    rotation = np.eye(3)
    if rank == 1:
        line = axes[0]
        seen = (b - middle_b).T @ (square * ((a - middle_a) @ line))
        length = float(np.linalg.norm(seen))
        if length > 0:
            turn = np.cross(line, seen / length)
            size, along = float(np.linalg.norm(turn)), float(line @ seen / length)
            across = turn / size if size > 1e-12 else axes[1]  # a line turned round: about any axis across it
            rotation = Rotation.from_rotvec(np.arctan2(size, along) * across).as_matrix()
    return Pose(rotation, middle_b - rotation @ middle_a)


def _kabsch(a: Array, b: Array, w: Array) -> Pose:
    from scipy.spatial.transform import Rotation

    w = w**2 / (w**2).sum()
    middle_a, middle_b = w @ a, w @ b
    cross = (b - middle_b).T @ ((a - middle_a) * w[:, None])
    # directions that stay where they are, of very little weight: what the points leave open is no rotation
    still = np.full(3, 1e-10 * (float(np.linalg.norm(cross)) + 1e-12))
    measured, nominal = (np.vstack([part, np.eye(3)]) for part in (b - middle_b, a - middle_a))
    rotation = Rotation.align_vectors(measured, nominal, np.append(w, still))[0].as_matrix()
    return Pose(rotation, middle_b - rotation @ middle_a)


def rotation_notes(frames: Mapping[str, Pose]) -> tuple[str, ...]:
    """A sentence for users on measuring frames whose rotation is assumed, because the points do not determine it."""
    notes = []
    for count in (3, 1):
        labels = [label for label, pose in frames.items() if len(pose.undetermined) == count]
        if not labels:
            continue
        what = "together for the size of the residuals to determine its rotation"
        if count == 1:
            axis = ", ".join(f"{x:.3f}" for x in np.round(frames[labels[0]].undetermined[0], 3) + 0.0)
            what = f"to a line, direction [{axis}], for the size of the residuals to determine its rotation about it"
        several = f" of {labels[0]}" if labels[0] else ""
        several += f" and {len(labels) - 1} more" if len(labels) > 1 else ""
        notes.append(
            f"measuring frame{several}: its nominal points lie too close {what}. That rotation is assumed: "
            "frame_rotation of survey.yaml, or none. State it there, or measure points farther apart"
        )
    return tuple(notes)


def mean_rotation(rotations: Array) -> Array:
    """Chordal mean (3, 3) of rotations (n, 3, 3), as medians would have it: reweighted by distance."""
    from scipy.spatial.transform import Rotation

    weights = np.ones(len(rotations))
    mean, each = np.eye(3), Rotation.from_matrix(rotations)
    for _ in range(10):
        mean = each.mean(weights).as_matrix()
        distance = np.linalg.norm(rotations - mean, axis=(1, 2))
        weights = 1 / (1 + (distance / max(3.0 * float(np.median(distance)), 1e-12)) ** 2)
    return mean
