"""Displacement of the sensor between two scans of one artefact: coarse by distributions, then fine on the surface.

Coarse: VGICP of small_gicp, which matches the distributions of points in voxels. Fine: least squares of the heights of
all warm points over the cold surface (Chen and Medioni 1992, point to plane, with the plane replaced by the surface).
The fine steps of point-cloud libraries match single points and so inherit their spacing and noise: PLANE_ICP of
small_gicp 1.0.1 weights the components of a gap by those of the normal instead of projecting it, with errors of
micrometres to hundreds of micrometres; the surface fit is within a tenth of the limit set by the noise
(tests/benchmarks/registration.py). Points in mm, rotations in rad, in the sensor's frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from identification.registration.cleaning import point_cloud_library
from identification.registration.surface import CHUNK_POINTS, Surface, inliers

COARSE_STAGES_MM = ((4.0, 1.0), (2.0, 0.5))  # voxel size and thinning of the coarse stages, mm; by judgement
CORRESPONDENCE_MM = 5.0  # mm: largest distance of corresponding points in the coarse stages
COARSE_POINTS = 30_000  # points of the coarse stages; more cost time only
MOST_FINE_STEPS = 30  # Gauss-Newton steps; a few suffice unless the clouds do not overlap
SETTLED_RATIO = 3.0  # times the cold noise: with a smaller spread of heights no other start is tried; by judgement
LEAST_OVERLAP = 0.3  # of the warm points that must lie over the cold surface; by judgement
OBSERVABLE_RATIO = 4.0  # times the expectation from noise, from which a direction counts as observable; by judgement
SLOPE_POINTS = 50  # points at which the uncertainty of the slopes is evaluated; for time
# names of the six components
SHIFTS_AND_TURNS = ("shift along x", "shift along y", "shift along z", "turn about x", "turn about y", "turn about z")
BLOCK_CELLS = 32  # cells per side of a block whose mean residual tests for correlated noise; by judgement


@dataclass(frozen=True)
class Displacement:
    """Rigid motion ``p_cold = T p_warm``, both in the sensor's frame.

    Attributes
    ----------
    matrix : (4, 4)
    covariance : (6, 6)
        Of a small shift (mm) and rotation (rad) after it, about the origin of the cold sensor's frame.
    rmse : float
        Root mean square distance of the warm points from the cold surface, along its normal, mm.
    sigma : float
        The same along the sensor's z.
    overlap : float
        Share of the warm points that lie over the cold surface.
    unseen : tuple of str
        Shifts and rotations that are not identifiable on this surface.
    """

    matrix: Array
    covariance: Array
    rmse: float
    sigma: float
    overlap: float
    unseen: tuple[str, ...]


def displacement(cold: Array, surface: Surface, warm: Array) -> Displacement | None:
    """Displacement from cold to warm points (n, 3), both cleaned; None if they do not coincide."""
    some = warm[:: max(1, len(warm) // COARSE_POINTS)]
    found = []
    for start in (_coarse(cold, warm), np.eye(4)):
        end = _settled(surface, some, start)
        found += [] if end is None else [end]
        if end is not None and end[1] < SETTLED_RATIO * surface.sigma:
            break
    if not found:
        return None
    matrix, _ = min(found, key=lambda end: end[1])
    end = _settled(surface, warm, matrix, steps=2)  # the start is within the noise already
    return None if end is None else _judged(surface, warm, end[0])


def _coarse(cold: Array, warm: Array) -> Array:
    small_gicp = point_cloud_library()
    matrix = np.eye(4)
    for voxel, thinned in COARSE_STAGES_MM:
        source, _ = small_gicp.preprocess_points(warm, downsampling_resolution=thinned, num_neighbors=12)
        target, _ = small_gicp.preprocess_points(cold, downsampling_resolution=thinned, num_neighbors=12)
        if min(source.size(), target.size()) < 20:
            continue
        voxels = small_gicp.GaussianVoxelMap(voxel)
        voxels.insert(target)
        result = small_gicp.align(
            voxels, source, matrix, max_iterations=100, max_correspondence_distance=CORRESPONDENCE_MM
        )
        matrix = np.asarray(result.T_target_source)
    return matrix


def _settled(surface: Surface, points: Array, start: Array, steps: int = MOST_FINE_STEPS) -> tuple[Array, float] | None:
    """Gauss-Newton iteration: the displacement and the robust spread of the heights; None without overlap."""
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
    design[:, 3:] -= np.cross(middle, design[:, :3])  # rotations about the centroid, for conditioning
    return design.T @ design, design.T @ residual, middle, residual


def _rows(surface: Surface, points: Array, matrix: Array) -> tuple[Array, Array, Array] | None:
    """Derivatives (n, 6) of the heights of points over the surface, the heights, and the points' positions."""
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
    """Uncertainty of a displacement, from the noise of both scans and the correlation of neighbouring residuals."""
    rows = _rows(surface, points, matrix)
    if rows is None:
        return None
    design, residual, moved = rows
    sigma = float(np.sqrt(residual @ residual / max(len(residual) - 6, 1)))
    scale = np.linalg.norm(design, axis=0)
    inverse = np.linalg.pinv((design / scale).T @ (design / scale), hermitian=True) / np.outer(scale, scale)
    # the error of the cold surface is common to neighbouring warm points
    parts = range(0, len(moved), CHUNK_POINTS)
    through = np.sum([_part(surface, moved[i : i + CHUNK_POINTS], design[i : i + CHUNK_POINTS]) for i in parts], axis=0)
    cold = surface.sigma**2 * through.T @ surface.solve(through)
    covariance = inverse @ (sigma**2 * design.T @ design + cold) @ inverse
    covariance *= max(1.0, _alike(surface, moved, residual, sigma))
    length = np.linalg.norm(design[:, :3], axis=1)
    rmse = float(np.sqrt(np.mean((residual / length) ** 2)))
    return Displacement(matrix, covariance, rmse, sigma, len(moved) / len(points), _unseen(surface, design, moved))


def _part(surface: Surface, moved: Array, design: Array) -> Array:
    return np.asarray(surface.basis(moved[:, :2]).T @ design)


def _alike(surface: Surface, moved: Array, residual: Array, sigma: float) -> float:
    """Variance of block means of residuals, relative to that of independent residuals."""
    low, high = moved[:, :2].min(axis=0), moved[:, :2].max(axis=0)
    place = np.minimum(((moved[:, :2] - low) / (high - low + 1e-9) * BLOCK_CELLS).astype(np.intp), BLOCK_CELLS - 1)
    flat = place[:, 0] * BLOCK_CELLS + place[:, 1]
    count = np.bincount(flat)
    total = np.bincount(flat, weights=residual)
    full = count > 1
    expected = 1 + surface.coefficients.size / np.count_nonzero(full)  # including the error of the cold surface
    return float(np.mean(total[full] ** 2 / count[full]) / sigma**2 / expected)


def _unseen(surface: Surface, design: Array, moved: Array) -> tuple[str, ...]:
    """Shifts and rotations whose observability rests on slopes that noise of the cold scan alone could produce."""
    middle = moved.mean(axis=0)
    size = float(np.ptp(moved[:, :2], axis=0).max()) / 2
    arms = np.r_[np.ones(3), np.full(3, size)]  # rotations scaled to displacements at the rim
    about = design.copy()
    about[:, 3:] -= np.cross(middle, design[:, :3])
    information = (about / arms).T @ (about / arms) / len(about)
    some = moved[:: max(1, len(moved) // SLOPE_POINTS)]
    by_noise = np.zeros((6, 6))
    for k in (0, 1):
        slope = np.zeros(3)
        slope[k] = -1.0
        rows = np.hstack([np.tile(slope, (len(some), 1)), np.cross(some - middle, slope)]) / arms
        by_noise += (rows * surface.slope_variance(some[:, :2], k)[:, None]).T @ rows / len(some)
    sizes, vectors = np.linalg.eigh(information)
    unseen = np.zeros(6, dtype=np.bool_)
    for size_, vector in zip(sizes, vectors.T, strict=True):
        if size_ < OBSERVABLE_RATIO * max(float(vector @ by_noise @ vector), 1e-12):
            unseen |= np.abs(vector) > 0.5
    return tuple(name for name, gone in zip(SHIFTS_AND_TURNS, unseen, strict=True) if gone)
