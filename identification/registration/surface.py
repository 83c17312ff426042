"""Cold surface as a smooth function z(x, y) in the sensor's frame, with its slopes and its uncertainty; mm.

A tensor product of cubic B-splines is fitted to all points by robust least squares; generalised cross-validation
chooses the spacing of the knots. Averaging over many points makes the registration more accurate than the noise of a
single point.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from errormodel.arrays import MAD_STD, Array, Mask
from identification.registration.cleaning import cell_size, lines_of

SURFACE_CLIP_SIGMA = 5.0  # robust standard deviations beyond which a point is left out; by judgement
# intervals along the longer side: the first trial, and the following ones
COARSEST_INTERVALS, FINER_INTERVALS = 4, (8, 16, 32, 64, 128)
REFINEMENT_RATIO = 0.995  # ratio of cross-validation errors that finer knots must reach; by judgement
SURFACE_ROUNDS = 8  # iterations of the outlier rejection; by judgement
KNOT_POINTS = 60_000  # points that choose the knots; more cost time only
CHUNK_POINTS = 200_000  # points per evaluation, to limit memory
_STIFFNESS = 1e-7  # penalty on second differences, so that coefficients without points are smooth as well


@dataclass(frozen=True)
class Surface:
    """A surface fitted to points.

    Attributes
    ----------
    knots : tuple of two arrays
    coefficients : (mx, my)
    sigma : float
        Standard deviation of a point's height, mm.
    factor : SuperLU
        Factorisation of the normal equations' matrix (m, m), for the uncertainty of the surface.
    cell, seen : float, (cx, cy) bool
        Side of the cells of a grid, mm, and mask of the cells surrounded by points.
    inliers : (n,) bool
    """

    knots: tuple[Array, Array]
    coefficients: Array
    sigma: float
    factor: Any
    cell: float
    seen: Mask
    inliers: Mask

    def height(self, xy: Array, nu: tuple[int, int] = (0, 0)) -> Array:
        """Heights (n,) in mm at points (n, 2), or their derivatives."""
        from scipy.interpolate import NdBSpline

        spline = NdBSpline(self.knots, self.coefficients, 3)
        return np.concatenate([spline(part, nu=nu) for part in _chunks(xy)])

    def basis(self, xy: Array) -> Any:
        """B-splines at points (n, 2), sparse (n, m)."""
        return _basis(xy, self.knots)

    def covers(self, xy: Array) -> Mask:
        """Whether the surface was measured all around each point (n, 2)."""
        low, high = np.array([[t[0], t[-1]] for t in self.knots]).T
        inside: Mask = ((xy >= low) & (xy <= high)).all(axis=1)
        place = np.floor((xy[inside] - low) / self.cell).astype(np.intp)
        inside[inside] = self.seen[place[:, 0], place[:, 1]]
        return inside

    @property
    def score(self) -> float:
        """Prediction error by generalised cross-validation, mm."""
        used = int(np.count_nonzero(self.inliers))
        return self.sigma * float(np.sqrt(used / max(used - self.coefficients.size, 1)))

    def solve(self, right: Array) -> Array:
        """Solution of the normal equations for right-hand sides (m, k)."""
        return np.asarray(self.factor.solve(np.ascontiguousarray(right)))

    def slope_variance(self, xy: Array, k: int) -> Array:
        """Variance (n,) of the slope along x (k = 0) or y (1) due to the noise of the points."""
        step = np.zeros(2)
        step[k] = 1e-2 * float(np.diff(self.knots[k]).max())
        low, high = ([[t[0], t[-1]][end] for t in self.knots] for end in (0, 1))
        ahead, behind = (np.clip(xy + sign * step, low, high) for sign in (1, -1))
        slopes = (self.basis(ahead) - self.basis(behind)).T.toarray() / (ahead - behind)[:, k]
        variance: Array = self.sigma**2 * np.einsum("mn,mn->n", slopes, self.solve(slopes))
        return variance


def fit_surface(points: Array) -> Surface:
    """Smooth surface of cleaned points (n, 3), mm: knots from a subset of the points, coefficients from all."""
    lines = lines_of(points)
    cell = cell_size(points, lines)
    seen = _cells(points, cell)
    some = points[:: max(1, len(points) // KNOT_POINTS)]
    apart = 1.25 * lines.spacing  # a wider spacing than that of the profiles, so that these determine the coefficients
    longest = float(np.ptp(points[:, :2], axis=0).max())
    surface = _robust(
        some, _knots(points, longest / COARSEST_INTERVALS, apart), np.ones(len(some), dtype=np.bool_), cell, seen
    )
    for intervals in FINER_INTERVALS:
        knots = _knots(points, longest / intervals, apart)
        if _count(knots) > len(some) / 8:
            break
        finer = _robust(some, knots, surface.inliers, cell, seen)
        if finer.score > REFINEMENT_RATIO * surface.score:
            break
        surface = finer
    if len(some) == len(points):
        return surface
    return _robust(points, surface.knots, inliers(points[:, 2] - surface.height(points[:, :2])), cell, seen)


def _robust(points: Array, knots: tuple[Array, Array], start: Mask, cell: float, seen: Mask) -> Surface:
    """Fit and reject outliers until the selection is stable."""
    good = start
    for _ in range(SURFACE_ROUNDS):
        used = good
        coefficients, factor = _solved(points[used], knots)
        surface = Surface(knots, coefficients, 0.0, factor, cell, seen, used)
        residual = points[:, 2] - surface.height(points[:, :2])
        good = inliers(residual)
        if np.count_nonzero(good != used) <= 1e-3 * len(good):
            break
    free = max(int(np.count_nonzero(used)) - _count(knots), 1)
    return replace(surface, sigma=float(np.sqrt(np.sum(residual[used & good] ** 2) / free)))


def inliers(residual: Array) -> Mask:
    """Mask of residuals within `SURFACE_CLIP_SIGMA` robust standard deviations of their median."""
    middle = np.median(residual)
    spread = MAD_STD * float(np.median(np.abs(residual - middle)))
    near: Mask = np.abs(residual - middle) <= max(SURFACE_CLIP_SIGMA * spread, 1e-9)
    return near


def _solved(points: Array, knots: tuple[Array, Array]) -> tuple[Array, Any]:
    from scipy.sparse.linalg import splu

    count = _count(knots)
    normal: Any = 0
    right = np.zeros(count)
    for part in _chunks(points):
        basis = _basis(part[:, :2], knots)
        normal = basis.T @ basis + normal if not isinstance(normal, int) else basis.T @ basis
        right += basis.T @ part[:, 2]
    normal = (normal + _STIFFNESS * len(points) / count * _roughness(knots)).tocsc()
    shape = tuple(len(t) - 4 for t in knots)
    factor = splu(normal)
    return factor.solve(right).reshape(shape), factor


def _roughness(knots: tuple[Array, Array]) -> Any:
    """Sum of squared second differences of the coefficients along x and along y, sparse (m, m)."""
    from scipy.sparse import diags_array, eye_array, kron

    parts = []
    for k, t in enumerate(knots):
        n = len(t) - 4
        second = diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(n - 2, n))
        other = eye_array(len(knots[1 - k]) - 4)
        parts.append(kron(second.T @ second, other) if k == 0 else kron(other, second.T @ second))
    return parts[0] + parts[1]


def _knots(points: Array, spacing: float, apart: float) -> tuple[Array, Array]:
    """Knots with a given spacing, mm; along y at least `apart`."""
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    both = []
    for a, b, least in zip(low, high, (0.0, apart), strict=True):
        n = max(round((b - a) / max(spacing, least)), 1)
        both.append(np.r_[[a] * 3, np.linspace(a, b, n + 1), [b] * 3])
    return both[0], both[1]


def _count(knots: tuple[Array, Array]) -> int:
    return (len(knots[0]) - 4) * (len(knots[1]) - 4)


def _basis(xy: Array, knots: tuple[Array, Array]) -> Any:
    from scipy.interpolate import NdBSpline
    from scipy.sparse import csr_array

    basis = NdBSpline.design_matrix(np.ascontiguousarray(xy), knots, 3)
    return csr_array((basis.data, basis.indices, basis.indptr), shape=(len(xy), _count(knots)))  # all columns


def _chunks(rows: Array) -> list[Array]:
    return np.array_split(rows, max(1, -(-len(rows) // CHUNK_POINTS)))


def _cells(points: Array, cell: float) -> Mask:
    """Grid of cells (mm) over the points: mask of those whose neighbours all hold points."""
    from scipy.ndimage import binary_closing, binary_erosion

    place = np.floor((points[:, :2] - points[:, :2].min(axis=0)) / cell).astype(np.intp)
    full = np.zeros(place.max(axis=0) + 1, dtype=np.bool_)
    full[place[:, 0], place[:, 1]] = True
    closed = binary_closing(np.pad(full, 1))[1:-1, 1:-1]  # a single cell emptied by outliers is no hole
    inside: Mask = binary_erosion(closed, structure=np.ones((3, 3), dtype=np.bool_), border_value=1)
    return inside
