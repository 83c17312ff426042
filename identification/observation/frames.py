"""Rigid alignment of nominal to measured points: the pose of a measuring frame in closed form.

Weighted Kabsch/Umeyama algorithm (rotation by singular value decomposition), iteratively reweighted against gross
outliers. Rotations that the nominal points do not determine (three for a single point, one for a line) are not
estimated: they keep the rotation stated in the survey, or zero. Units: mm; poses map the machine's reference into the
measuring frame.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from errormodel.arrays import Array
from identification.observation.partial_alignment import align_measured_components
from identification.observation.pose import ROTATION_SPREAD_RATIO, Pose

# Largest position error of a working machine over its size (0.6 mm in 3 m), by judgement
MACHINE_ERROR_SHARE = 2e-4
MISFIT_CONFIDENCE = 0.99  # level of the upper confidence limit of the misfit, which is uncertain for few points
FALSE_ROTATION_PROBABILITY = 1e-3  # significance level of the F test for a rotation
COMPLETE_SHARE = 0.5  # of the points: fewer with all components do not stand for the others
POINT_SPREAD_ROUND_OFF = 1e-9  # spread over the largest coordinate below which it is round-off


def align(
    nominal: Array,
    measured: Array,
    weights: Array | None = None,
    rounds: int = 20,
    assumed: Array | None = None,
    largest: float = np.inf,
) -> Pose:
    """Pose that maps nominal points onto measured ones by robust least squares.

    The rotation is estimated only about axes that the spread of the nominal points determines (see
    `_as_far_as_determined`); about the others it stays as close as possible to the assumed one. Rows are reweighted by
    1/(1 + (distance/scale)^2), which resists up to a third of gross outliers of any size.

    Parameters
    ----------
    nominal : (n, 3) mm in the machine's reference.
    measured : (n, 3) mm in the measuring frame, NaN where a component is missing.
    weights : (n,) 1/sigma.
    rounds : largest number of reweightings.
    assumed : (3, 3) rotation to assume where the points do not determine it; None: identity.
    largest : misfit (mm) that errors of a machine can cause. A larger one is a mistake in the recording and is not used
        to decide whether the points determine the rotation.
    """
    if assumed is not None:
        pose = align(nominal @ assumed.T, measured, weights, rounds, largest=largest)
        return Pose(pose.rotation @ assumed, pose.translation, pose.undetermined @ assumed)
    w = np.ones(len(nominal)) if weights is None else weights / weights.max()
    full = np.isfinite(measured).all(axis=1)
    if full.sum() < COMPLETE_SHARE * np.isfinite(measured).any(axis=1).sum() or not full.any():
        return align_measured_components(nominal, measured, w, largest)
    a, b, w = nominal[full], measured[full], w[full]
    pose = _kabsch(a, b, w)
    counted, reached = w, pose.apply(a)
    least = 1e-8 * float(np.abs(a).max())  # the closed form is exact to 1e-10
    for _ in range(rounds if len(a) > 6 else 0):  # with fewer points, the inliers might not determine a frame
        distance = np.linalg.norm(b - reached, axis=1)
        scale = max(3.0 * float(np.median(distance)), least, 1e-9)
        counted = w / (1 + (distance / scale) ** 2)
        pose, before = _kabsch(a, b, counted), reached
        reached = pose.apply(a)
        if np.abs(reached - before).max() < 1e-6 * scale:
            break
    return _as_far_as_determined(a, b, counted, pose, largest)


def _as_far_as_determined(a: Array, b: Array, w: Array, best: Pose, largest: float) -> Pose:
    """The best pose, or one with fewer rotations where the spread of the nominal points does not determine it.

    A principal direction of the nominal points counts if their standard deviation along it is `ROTATION_SPREAD_RATIO`
    times the misfit, or if the misfit without it is at least twice as large and an F test rejects equality.
    """
    from scipy.special import chdtri, fdtri

    square = w**2 / (w**2).sum()
    about = a - square @ a
    variance, axes = np.linalg.eigh(about.T @ (about * square[:, None]))
    spread, axes = np.sqrt(np.maximum(variance[::-1], 0.0)), axes[:, ::-1].T  # the widest direction first
    seen = spread > POINT_SPREAD_ROUND_OFF * max(float(np.abs(a).max()), 1e-300)
    rank = min(int(seen.sum()), 2)  # a plane determines all three rotations, a line two
    poses = {rank: best if rank == 2 else _of_rank(a, b, w, axes, rank)}
    while rank:
        misfit = float(square @ np.square(b - poses[rank].apply(a)).sum(axis=1))
        more = 3 - rank  # rotations added by this direction: two for a line, one for a plane
        free = 3 * len(a) - 3 - (2 if rank == 1 else 3)
        coordinate = np.sqrt(misfit * len(a) / free) if free > 0 else np.inf
        upper = coordinate * np.sqrt(free / chdtri(free, MISFIT_CONFIDENCE)) if free > 0 else np.inf
        if spread[rank - 1] >= ROTATION_SPREAD_RATIO * min(upper, largest):
            break
        lower = poses[rank - 1] = _of_rank(a, b, w, axes, rank - 1)
        without = float(square @ np.square(b - lower.apply(a)).sum(axis=1))
        beyond = (
            (without - misfit) / more > fdtri(more, free, 1 - FALSE_ROTATION_PROBABILITY) * misfit / free
            if free > 0
            else False
        )
        if beyond and without > 4 * misfit:
            break
        rank -= 1
    pose = poses[rank]
    return Pose(pose.rotation, pose.translation, (np.eye(3), axes[:1], np.zeros((0, 3)))[rank])


def _of_rank(a: Array, b: Array, w: Array, axes: Array, rank: int) -> Pose:
    """The best pose with the smallest rotation that aligns the first `rank` principal directions.

    Rank 0: no rotation; rank 1: the smallest rotation from the line through the nominal points to that through the
    measured ones; rank 2: full rotation.
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
            across = turn / size if size > 1e-12 else axes[1]  # antiparallel lines: any perpendicular axis
            rotation = Rotation.from_rotvec(np.arctan2(size, along) * across).as_matrix()
    return Pose(rotation, middle_b - rotation @ middle_a)


def _kabsch(a: Array, b: Array, w: Array) -> Pose:
    """Umeyama, "Least-squares estimation of transformation parameters", 1991: without a scale."""
    w = w**2 / (w**2).sum()
    middle_a, middle_b = w @ a, w @ b
    cross = (b - middle_b).T @ ((a - middle_a) * w[:, None])
    # directions that stay where they are, of very little weight: what the points leave open is no rotation
    left, _, right = np.linalg.svd(cross + 1e-10 * (float(np.linalg.norm(cross)) + 1e-12) * np.eye(3))
    left[:, 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))  # a rotation, no reflection
    rotation = left @ right
    return Pose(rotation, middle_b - rotation @ middle_a)


def rotation_notes(frames: Mapping[str, Pose]) -> tuple[str, ...]:
    """Notes for users on measuring frames whose rotation is assumed because the points do not determine it."""
    notes = []
    for count in (3, 2, 1):
        labels = [label for label, pose in frames.items() if len(pose.undetermined) == count]
        if not labels:
            continue
        axes = " and ".join(
            f"[{', '.join(f'{x:.3f}' for x in np.round(axis, 3) + 0.0)}]" for axis in frames[labels[0]].undetermined
        )
        what = "its rotation" if count == 3 else f"its rotation about {axes}"
        several = f" of {labels[0]}" if labels[0] else ""
        several += f" and {len(labels) - 1} more" if len(labels) > 1 else ""
        notes.append(
            f"measuring frame{several}: the measured components of its points, as far as they spread and beside the "
            f"size of the residuals, do not determine {what}. That rotation is assumed: frame_rotation of survey.yaml, "
            "or none. State it there, or measure all components of points farther apart"
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
