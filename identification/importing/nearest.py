"""Commands and measured points without names: a rigid alignment that needs no pairs, then the nearest of each.

Distances between points stay under a rigid motion. Triangles of measured points are looked for among the nominal ones;
each gives a frame, and the frame in which most points have a command nearby counts. A plan that looks the same from
several sides has several such frames: the order of the points decides, and where it does not, nothing is guessed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Index
from identification.observation.frames import align
from identification.observation.pose import Pose

if TYPE_CHECKING:
    from scipy.spatial import KDTree

MOST_POINTS = 2500  # nominal points: their pairs are searched
TRIANGLES = 12  # measured triangles that are looked for, and more while no frame is found:
MOST_TRIANGLES = 48  # where half the points have no command, one of eight triangles has three
MOST_TRIES = 4000  # frames that are tried for a triangle; by judgement
SAMPLE = 120  # measured points that judge a frame at first
ALIKE = 0.97  # of the points that fit in the best frame: another frame with as many is as good
ENOUGH = 0.5  # of the measured points must have a command in the best frame, or of the commands a point
FEWEST_COMMANDS = 8  # that have a point, where most points have no command
FEWEST_JUDGES = 0.25  # of the points that judge a frame at first must have a command
ORDERED = 0.9  # of the steps from row to row must go on in the commands, where the order decides
NEXT = 2  # commands: a step that goes on leaves out one at most
TOLERANCE = 2e-3  # of the points' reach: so far may a point be from its command while a frame is looked for
CLOSEST = 0.35  # of the distance between neighbouring commands: no tolerance reaches over it


@dataclass(frozen=True)
class Pairing:
    """Commands of measured points.

    Attributes
    ----------
    command : (n,) row of the command of each measured point, from 0; -1: none is near.
    pose : the measuring frame.
    ways : number of frames that fit as well.
    """

    command: Index
    pose: Pose
    ways: int = 1


def find_pairing(nominal: Array, measured: Array, seed: int = 0) -> Pairing | None:
    """Pair measured points with commands by a rigid alignment; None where no frame fits most points.

    Parameters
    ----------
    nominal : (m, 3) mm in the reference, in the order of the commands.
    measured : (n, 3) mm in the measuring frame, in the order of measuring.
    """
    from scipy.spatial import KDTree

    places, back = _distinct(nominal)
    if len(places) < 4 or len(measured) < 4 or len(places) > MOST_POINTS:
        return None
    reach = float(np.sqrt(np.sum(np.var(measured, axis=0))))
    tree = KDTree(places)
    gap = float(np.median(np.asarray(tree.query(places, k=2)[0])[:, 1]))
    tolerance = min(TOLERANCE * reach, CLOSEST * gap)
    rng = np.random.default_rng(seed)
    judges = measured[rng.choice(len(measured), min(SAMPLE, len(measured)), replace=False)]
    found: list[tuple[int, Pose]] = []
    for number, triple in enumerate(_triangles(measured, rng)):
        for pose in _frames(places, measured[triple], tolerance):
            near = np.asarray(tree.query(pose.invert(judges))[0]) < 3 * tolerance
            found.append((int(near.sum()), pose))
        most = max((n for n, _ in found), default=0)
        if most > 0.9 * len(judges) or (number >= TRIANGLES and most >= FEWEST_JUDGES * len(judges)):
            break
    if not found:
        return None
    best = max(n for n, _ in found)
    if best < FEWEST_JUDGES * len(judges):
        return None
    kept: list[tuple[int, Pose, Index]] = []
    for count, rough in sorted(found, key=lambda f: -f[0]):
        if count < ALIKE * best - 1 or len(kept) >= 48:
            break
        if any(_same(rough, p, judges, 6 * tolerance) for _, p, _ in kept):
            continue
        pose, places_near = _refined(places, measured, tree, rough, tolerance)
        if not any(_same(pose, p, judges, 2 * tolerance) for _, p, _ in kept):
            kept.append((int((places_near >= 0).sum()), pose, places_near))
    most = max(k for k, _, _ in kept)
    kept = [k for k in kept if k[0] >= ALIKE * most]
    paired = [(_in_order(own, back), pose) for _, pose, own in kept]
    scores = [_forward(command) for command, _ in paired]
    at = int(np.argmax(scores))
    others = sum(s > scores[at] - 0.2 for s in scores) - 1
    ways = 1 if len(paired) == 1 or (scores[at] > ORDERED and others == 0) else len(paired)
    command, pose = paired[at]
    own = command[command >= 0]
    if len(own) < ENOUGH * len(measured) and len(np.unique(own)) < max(ENOUGH * len(nominal), FEWEST_COMMANDS):
        return None
    return Pairing(command, pose, ways)


def _distinct(nominal: Array) -> tuple[Array, list[Index]]:
    """Nominal points that are commanded, each once, and the commands of each in their order."""
    rounded = np.round(nominal, 4)
    _, first, inverse = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    inverse = inverse.ravel()
    return nominal[first], [np.flatnonzero(inverse == k) for k in range(len(first))]


def _triangles(points: Array, rng: np.random.Generator) -> Iterator[Index]:
    """Wide triangles of measured points, from which a frame follows well."""
    reach = float(np.sqrt(np.sum(np.var(points, axis=0))))
    made = 0
    for _ in range(200):
        three = rng.choice(len(points), 3, replace=False)
        a, b, c = points[three]
        area = np.linalg.norm(np.cross(b - a, c - a))
        sides = [np.linalg.norm(b - a), np.linalg.norm(c - b), np.linalg.norm(a - c)]
        if area > 0.5 * reach**2 and min(sides) > 0.5 * reach:
            made += 1
            yield np.asarray(three)
        if made >= MOST_TRIANGLES:
            return


def _frames(places: Array, triangle: Array, tolerance: float) -> Iterator[Pose]:
    """Frames in which a measured triangle lies on three nominal points."""
    from scipy.spatial.distance import cdist

    apart = cdist(places, places)
    ab, bc, ca = (float(np.linalg.norm(triangle[i] - triangle[j])) for i, j in ((0, 1), (1, 2), (2, 0)))
    first, second = np.nonzero(np.abs(apart - ab) < 2 * tolerance)
    tried = 0
    for i, j in zip(first.tolist(), second.tolist(), strict=True):
        third = np.flatnonzero((np.abs(apart[j] - bc) < 2 * tolerance) & (np.abs(apart[i] - ca) < 2 * tolerance))
        for k in third.tolist():
            yield align(places[[i, j, k]], triangle, rounds=0)
            tried += 1
            if tried >= MOST_TRIES:
                return


def _same(one: Pose, other: Pose, points: Array, tolerance: float) -> bool:
    return bool(np.abs(one.invert(points) - other.invert(points)).max() < max(tolerance, 1e-6))


def _refined(places: Array, measured: Array, tree: KDTree, pose: Pose, tolerance: float) -> tuple[Pose, Index]:
    """A frame fitted to all points that are near a command, and the place of each measured point (-1: none)."""
    near = np.full(len(measured), -1)
    for factor in (6.0, 4.0, 3.0, 3.0):
        distance, at = map(np.asarray, tree.query(pose.invert(measured)))
        near = np.where(distance < factor * tolerance, at, -1)
        if (near >= 0).sum() < 4:
            break
        pose = align(places[near[near >= 0]], measured[near >= 0])
    return pose, near


def _in_order(near: Index, back: list[Index]) -> Index:
    """Commands of measured points; of a place that is commanded several times, the one that comes next."""
    command = np.full(len(near), -1)
    used: dict[int, int] = {}
    last = -1
    for row, place in enumerate(near.tolist()):
        if place < 0:
            continue
        own = back[place]
        if len(own) == 1:
            command[row] = own[0]
        else:  # the next one behind the last command, else the first that is free
            k = used.get(place, 0)
            later = own[own > last]
            command[row] = later[0] if len(later) else own[min(k, len(own) - 1)]
            used[place] = k + 1
        last = int(command[row])
    return command


def _forward(command: Index) -> float:
    """Share of the steps from one measured point to the next that stay or go on to one of the next commands."""
    own = command[command >= 0]
    step = np.diff(own)
    return float(np.mean((step >= 0) & (step <= NEXT))) if len(own) > 1 else 1.0
