"""The displacement of the sensor between two scans of one artefact: coarse by distributions, then fine on the surface.

Coarse: VGICP of small_gicp, which matches the distributions of points in voxels. Fine: least squares of the heights of
all warm points over the cold surface (Chen and Medioni 1992, point to plane, with the plane replaced by the surface).
The fine steps of point-cloud libraries match single points, whose spacing and noise they then carry: small_gicp 1.0.1's
PLANE_ICP weighs the components of a gap by those of the normal instead of projecting it, and stays micrometres to
hundreds of micrometres off; the surface is within a tenth of what the noise allows (tests/benchmarks/registration.py).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from identification.registration.surface import CHUNK, Surface, inliers

COARSE = ((4.0, 1.0), (2.0, 0.5))  # voxels and thinning in mm, one after the other
REACH = 5.0  # mm between points that may belong together
FEW = 30_000  # points for the first steps
STEPS = 30
ALIKE = 3.0  # times the noise of the cold points: a spread with which no other start need be tried
LEAST_OVERLAP = 0.3  # of the warm points
SEEN = 4.0  # times what noise would show, from which a direction is called seen
PROBES = 50  # points at which the uncertainty of the slopes is looked at
SHIFTS_AND_TURNS = ("shift along x", "shift along y", "shift along z", "turn about x", "turn about y", "turn about z")
BLOCK = 32  # cells a side in which residuals are averaged, to see whether they are alike beside each other


@dataclass(frozen=True)
class Displacement:
    """``p_cold = T p_warm``, both in the sensor's frame.

    Attributes
    ----------
    matrix : (4, 4)
    covariance : (6, 6)
        Of a small shift (mm) and turn (rad) after it, about the origin of the cold sensor's frame.
    rmse : float
        Root mean square distance of the warm points from the cold surface, along its normal, mm.
    sigma : float
        The same along the sensor's z.
    overlap : float
        Share of the warm points that lie over the cold surface.
    unseen : tuple of str
        Shifts and turns that this surface does not show.
    """

    matrix: Array
    covariance: Array
    rmse: float
    sigma: float
    overlap: float
    unseen: tuple[str, ...]


def displacement(cold: Array, surface: Surface, warm: Array) -> Displacement | None:
    """The displacement from cold to warm points (n, 3), both cleaned; None if they do not come to lie on each other."""
    some = warm[:: max(1, len(warm) // FEW)]
    found = []
    for start in (_coarse(cold, warm), np.eye(4)):
        end = _settled(surface, some, start)
        found += [] if end is None else [end]
        if end is not None and end[1] < ALIKE * surface.sigma:
            break
    if not found:
        return None
    matrix, _ = min(found, key=lambda end: end[1])
    end = _settled(surface, warm, matrix, steps=2)  # which is already near by the width of the noise
    return None if end is None else _judged(surface, warm, end[0])


def _coarse(cold: Array, warm: Array) -> Array:
    import small_gicp

    matrix = np.eye(4)
    for voxel, thinned in COARSE:
        source, _ = small_gicp.preprocess_points(warm, downsampling_resolution=thinned, num_neighbors=12)
        target, _ = small_gicp.preprocess_points(cold, downsampling_resolution=thinned, num_neighbors=12)
        if min(source.size(), target.size()) < 20:
            continue
        voxels = small_gicp.GaussianVoxelMap(voxel)
        voxels.insert(target)
        result = small_gicp.align(voxels, source, matrix, max_iterations=100, max_correspondence_distance=REACH)
        matrix = np.asarray(result.T_target_source)
    return matrix


def _settled(surface: Surface, points: Array, start: Array, steps: int = STEPS) -> tuple[Array, float] | None:
    """Gauss-Newton to the end: the displacement, and the robust spread of the heights; None where nothing overlaps."""
    from scipy.spatial.transform import Rotation

    matrix, spread = start, np.inf
    for _ in range(steps):
        fit = _normal_equations(surface, points, matrix)
        if fit is None:
            return None
        information, gradient, middle, residual = fit
        step = -np.linalg.lstsq(information, gradient, rcond=1e-14)[0]
        change = np.eye(4)
        change[:3, :3] = Rotation.from_rotvec(step[3:]).as_matrix()
        change[:3, 3] = middle + step[:3] - change[:3, :3] @ middle
        matrix, spread = change @ matrix, float(np.sqrt(np.mean(residual**2)))
        if np.abs(step[:3]).max() < 1e-7 and np.abs(step[3:]).max() < 1e-8:
            break
    return matrix, spread


def _normal_equations(surface: Surface, points: Array, matrix: Array) -> tuple[Array, Array, Array, Array] | None:
    rows = _rows(surface, points, matrix)
    if rows is None:
        return None
    design, residual, moved = rows
    middle = moved.mean(axis=0)
    design[:, 3:] -= np.cross(middle, design[:, :3])  # turns about the middle, for the numbers' sake
    return design.T @ design, design.T @ residual, middle, residual


def _rows(surface: Surface, points: Array, matrix: Array) -> tuple[Array, Array, Array] | None:
    """Of the points over the surface: derivatives (n, 6) of the height over it, that height, and where they lie."""
    moved = points @ matrix[:3, :3].T + matrix[:3, 3]
    moved = moved[surface.covers(moved[:, :2])]
    if len(moved) < LEAST_OVERLAP * len(points):
        return None
    residual = moved[:, 2] - surface.height(moved[:, :2])
    near = inliers(residual)
    moved, residual = moved[near], residual[near]
    xy = moved[:, :2]
    normal = np.stack([-surface.height(xy, (1, 0)), -surface.height(xy, (0, 1)), np.ones(len(xy))], axis=1)
    return np.hstack([normal, np.cross(moved, normal)]), residual, moved


def _judged(surface: Surface, points: Array, matrix: Array) -> Displacement | None:
    """What the displacement is worth: the noise of both scans, and how alike residuals beside each other are."""
    rows = _rows(surface, points, matrix)
    if rows is None:
        return None
    design, residual, moved = rows
    sigma = float(np.sqrt(residual @ residual / max(len(residual) - 6, 1)))
    scale = np.linalg.norm(design, axis=0)
    inverse = np.linalg.pinv((design / scale).T @ (design / scale), hermitian=True) / np.outer(scale, scale)
    # the cold surface's own error acts on all warm points around it alike
    parts = range(0, len(moved), CHUNK)
    through = np.sum([_part(surface, moved[i : i + CHUNK], design[i : i + CHUNK]) for i in parts], axis=0)
    cold = surface.sigma**2 * through.T @ surface.solve(through)
    covariance = inverse @ (sigma**2 * design.T @ design + cold) @ inverse
    covariance *= max(1.0, _alike(surface, moved, residual, sigma))
    length = np.linalg.norm(design[:, :3], axis=1)
    rmse = float(np.sqrt(np.mean((residual / length) ** 2)))
    return Displacement(matrix, covariance, rmse, sigma, len(moved) / len(points), _unseen(surface, design, moved))


def _part(surface: Surface, moved: Array, design: Array) -> Array:
    return np.asarray(surface.basis(moved[:, :2]).T @ design)


def _alike(surface: Surface, moved: Array, residual: Array, sigma: float) -> float:
    """Variance of the means of residuals over blocks, over what independent ones would have."""
    low, high = moved[:, :2].min(axis=0), moved[:, :2].max(axis=0)
    place = np.minimum(((moved[:, :2] - low) / (high - low + 1e-9) * BLOCK).astype(np.intp), BLOCK - 1)
    flat = place[:, 0] * BLOCK + place[:, 1]
    count = np.bincount(flat)
    total = np.bincount(flat, weights=residual)
    full = count > 1
    expected = 1 + surface.coefficients.size / np.count_nonzero(full)  # with the error of the cold surface
    return float(np.mean(total[full] ** 2 / count[full]) / sigma**2 / expected)


def _unseen(surface: Surface, design: Array, moved: Array) -> tuple[str, ...]:
    """Shifts and turns that are seen in slopes which the noise of the cold scan could have made alone."""
    middle = moved.mean(axis=0)
    size = float(np.ptp(moved[:, :2], axis=0).max()) / 2
    arms = np.r_[np.ones(3), np.full(3, size)]  # turns by what they move at the rim
    about = design.copy()
    about[:, 3:] -= np.cross(middle, design[:, :3])
    information = (about / arms).T @ (about / arms) / len(about)
    some = moved[:: max(1, len(moved) // PROBES)]
    by_noise = np.zeros((6, 6))
    for k in (0, 1):
        slope = np.zeros(3)
        slope[k] = -1.0
        rows = np.hstack([np.tile(slope, (len(some), 1)), np.cross(some - middle, slope)]) / arms
        by_noise += (rows * surface.slope_variance(some[:, :2], k)[:, None]).T @ rows / len(some)
    sizes, vectors = np.linalg.eigh(information)
    unseen = np.zeros(6, dtype=np.bool_)
    for size_, vector in zip(sizes, vectors.T, strict=True):
        if size_ < SEEN * max(float(vector @ by_noise @ vector), 1e-12):
            unseen |= np.abs(vector) > 0.5
    return tuple(name for name, gone in zip(SHIFTS_AND_TURNS, unseen, strict=True) if gone)
