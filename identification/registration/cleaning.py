"""Removal of points that do not belong to an artefact's surface: edges, outliers, stray light, other objects.

Edges and outliers follow the paper (section 3.3): 20 points (250 um) beside every edge are removed, then points whose
mean distance to their neighbours exceeds the average by a number of standard deviations. In addition, points not
connected with the artefact's surface are removed. Points in mm in the sensor's frame.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from errormodel.arrays import Array, Index, Mask
from errormodel.exceptions import InputError
from errormodel.extras import optional

OUTLIER_NEIGHBOURS = 8  # neighbours of the outlier test
OUTLIER_SIGMA = 3.0  # standard deviations of the mean distance to the neighbours: larger ones are outliers
# mm beside an edge along a profile, and largest number of points; the paper's section 3.3
EDGE_MM, EDGE_POINTS = 0.25, 20
EDGE_SPACINGS = 10.0  # spacings without a point that count as an edge; by judgement
# mm of height between neighbouring points that count as an edge, in addition to EDGE_SLOPE times their distance
EDGE_STEP_MM = 0.1
EDGE_SLOPE = 2.0  # height per distance; by judgement
FEWEST_CLOUD_POINTS = 300  # points that must remain for a registration; by judgement


@dataclass(frozen=True)
class Lines:
    """Points in the order of a line sensor's profiles.

    Attributes
    ----------
    order : (n,) int
        Rows of the cloud, profile after profile, along x in each.
    first : (n,) bool
        Where a profile begins, in that order.
    pitch : float
        Median distance of neighbours in a profile, mm.
    spacing : float
        Distance of neighbouring profiles, mm.
    """

    order: Index
    first: Mask
    pitch: float
    spacing: float


def lines_of(points: Array) -> Lines:
    """Profiles of a cloud (n, 3): points of equal y, or strips of equal width if the points are unordered."""
    y = points[:, 1]
    levels = np.unique(np.round(y, 6))
    if len(levels) * 10 <= len(y):
        label = np.searchsorted(levels, np.round(y, 6))
        spacing = float(np.median(np.diff(levels))) if len(levels) > 1 else 0.0
    else:
        area = float(np.prod(np.ptp(points[:, :2], axis=0)))
        spacing = 2 * np.sqrt(max(area, 1e-12) / len(y))
        label = np.floor((y - y.min()) / spacing).astype(np.intp)
    order = np.lexsort((points[:, 0], label))
    first = np.r_[True, np.diff(label[order]) != 0]
    steps = np.diff(points[order, 0])[~first[1:]]
    return Lines(order, first, float(np.median(steps)) if len(steps) else 0.0, spacing)


def breaks(points: Array, lines: Lines) -> Mask:
    """Mask (n,) in the order of the lines: an edge (gap, step, end of the profile) lies before the point."""
    ordered = points[lines.order]
    dx, dz = np.diff(ordered[:, 0]), np.abs(np.diff(ordered[:, 2]))
    strip = lines.spacing if lines.pitch < lines.spacing / 4 and _unordered(points, lines) else 0.0
    edge = (dx > EDGE_SPACINGS * max(lines.pitch, 1e-9)) | (dz > EDGE_STEP_MM + EDGE_SLOPE * (np.abs(dx) + strip))
    before: Mask = lines.first | np.r_[True, edge]
    return before


def _unordered(points: Array, lines: Lines) -> bool:
    y = points[lines.order, 1]
    return bool(np.any(np.diff(y)[~lines.first[1:]] != 0))


def point_cloud_library() -> Any:
    """The module small_gicp; InputError where it is not installed."""
    return optional("small_gicp", "register", "a comparison of point clouds")


def clean(points: Array, name: str) -> Array:
    """Points (n, 3) of the artefact's surface.

    Raises
    ------
    InputError
        Fewer than `FEWEST_CLOUD_POINTS` remain.
    """
    kept = points
    if len(points) >= FEWEST_CLOUD_POINTS:
        kept = kept[~_lonely(kept)]
        kept = kept[~_beside_edges(kept)]
        kept = kept[_largest_sheet(kept)]
    if len(kept) < FEWEST_CLOUD_POINTS:
        found = f"{len(points)} points" + (
            f", of which {len(kept)} belong to a surface" if len(kept) < len(points) else ""
        )
        raise InputError(
            name, found, f"Scan the artefact with {FEWEST_CLOUD_POINTS} points at least, thousands for micrometres"
        )
    return kept


def _lonely(points: Array) -> Mask:
    """Statistical outliers by the mean distance to their neighbours."""
    small_gicp = point_cloud_library()
    threads = os.cpu_count() or 1
    tree = small_gicp.KdTree(points, num_threads=threads)
    _, squared = tree.batch_knn_search(points, OUTLIER_NEIGHBOURS + 1, num_threads=threads)
    distance = np.sqrt(np.asarray(squared)[:, 1:]).mean(axis=1)
    lonely: Mask = distance > distance.mean() + OUTLIER_SIGMA * distance.std()
    return lonely


def _beside_edges(points: Array) -> Mask:
    """Points closer than EDGE_MM to an edge along their profile; at most a tenth of the profile at either end."""
    lines = lines_of(points)
    edge = np.flatnonzero(breaks(points, lines))
    sizes = np.diff(np.r_[edge, len(points)])
    place = np.arange(len(points)) - np.repeat(edge, sizes)
    most = int(np.clip(np.ceil(EDGE_MM / max(lines.pitch, 1e-9)), 1, EDGE_POINTS))
    margin = np.minimum(most, np.repeat(sizes, sizes) // 10)
    beside = np.empty(len(points), dtype=np.bool_)
    beside[lines.order] = (place < margin) | (place >= np.repeat(sizes, sizes) - margin)
    return beside


def _largest_sheet(points: Array) -> Mask:
    """Points of the largest surface without steps, by grid cells and their median heights."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    size = cell_size(points, lines_of(points))
    cell = np.floor((points[:, :2] - points[:, :2].min(axis=0)) / size).astype(np.intp)
    shape = cell.max(axis=0) + 1
    flat = np.ravel_multi_index((cell[:, 0], cell[:, 1]), tuple(shape))
    order = np.lexsort((points[:, 2], flat))
    cells, start, count = np.unique(flat[order], return_index=True, return_counts=True)
    height = np.full(int(np.prod(shape)), np.nan)
    height[cells] = points[order, 2][start + count // 2]
    grid = height.reshape(shape)
    place = np.arange(height.size).reshape(shape)
    pairs = [(place[1:], place[:-1], grid[1:] - grid[:-1]), (place[:, 1:], place[:, :-1], grid[:, 1:] - grid[:, :-1])]
    limit = EDGE_STEP_MM + EDGE_SLOPE * size
    joined = [(a[near], b[near]) for a, b, d in pairs for near in [np.abs(d) < limit]]  # False for empty cells
    rows, columns = (np.concatenate([pair[k] for pair in joined]) for k in (0, 1))
    links = coo_array((np.ones(len(rows)), (rows, columns)), shape=(height.size, height.size))
    _, label = connected_components(links, directed=False)
    sheet = label[flat]
    same: Mask = (sheet == np.bincount(sheet).argmax()) & (np.abs(points[:, 2] - height[flat]) < limit)
    return same


def cell_size(points: Array, lines: Lines) -> float:
    """Side (mm) of grid cells that hold several points each, even where profiles are far apart."""
    area = float(np.prod(np.ptp(points[:, :2], axis=0)))
    return max(1.5 * lines.spacing, 3.0 * float(np.sqrt(area / len(points))))
