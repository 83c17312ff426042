"""Reference straight lines of ISO 230-1: least squares, end points, minimum zone.

A line is taken off the deviations ``y`` at positions ``x``; the straightness error is the range of what is left.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise

import numpy as np

from errormodel.arrays import Array

LEAST_SQUARES, END_POINTS, MINIMUM_ZONE = "least squares", "end points", "minimum zone"


def least_squares(x: Array, y: Array) -> tuple[Array, Array]:
    """Slopes and heights at the mean position of the least-squares lines of y (..., n) over x (n,)."""
    about = x - x.mean()
    slope = np.asarray(y @ about / (about @ about))
    return slope, np.asarray(y.mean(axis=-1) - slope * x.mean())


def end_points(x: Array, y: Array) -> tuple[Array, Array]:
    """Slopes and heights at zero of the lines through the first and the last position."""
    first, last = int(np.argmin(x)), int(np.argmax(x))
    slope = np.asarray((y[..., last] - y[..., first]) / (x[last] - x[first]))
    return slope, np.asarray(y[..., first] - slope * x[first])


def minimum_zone(x: Array, y: Array) -> tuple[Array, Array]:
    """Slopes and heights at zero of the middle lines of the narrowest zones (Chebyshev lines).

    The width over the slope is convex and bends where the slope is that of an edge of the convex hull, so that the
    narrowest zone lies along one of these edges.
    """
    order = np.argsort(x, kind="stable")
    rows = y.reshape(-1, y.shape[-1])
    out = np.array([_zone(x[order], row[order]) for row in rows])
    return out[:, 0].reshape(y.shape[:-1]), out[:, 1].reshape(y.shape[:-1])


def _zone(x: Array, y: Array) -> tuple[float, float]:
    middle, size = x.mean(), max(float(np.ptp(y)), 1e-300)
    u, v = (x - middle) / float(np.ptp(x)), y / size
    slopes = {s for sign in (1.0, -1.0) for s in _hull_slopes(u, sign * v, sign)}
    best = min(sorted(slopes), key=lambda s: float(np.ptp(v - s * u)))
    left = v - best * u
    slope = best * size / float(np.ptp(x))
    height = (left.max() + left.min()) / 2 * size
    return slope, height - slope * middle


def _hull_slopes(x: Array, y: Array, sign: float) -> list[float]:
    """Slopes of the edges of the lower convex hull (monotone chain), with the sign of the unmirrored points."""
    hull: list[int] = []
    for k in range(len(x)):
        while len(hull) > 1:
            a, b = hull[-2], hull[-1]
            if (x[b] - x[a]) * (y[k] - y[a]) - (y[b] - y[a]) * (x[k] - x[a]) > 0:
                break
            hull.pop()
        hull.append(k)
    return [sign * (y[b] - y[a]) / (x[b] - x[a]) for a, b in pairwise(hull) if x[b] > x[a]]


LINES: Mapping[str, Callable[[Array, Array], tuple[Array, Array]]] = {
    LEAST_SQUARES: least_squares,
    END_POINTS: end_points,
    MINIMUM_ZONE: minimum_zone,
}


def straightened(x: Array, y: Array, line: str) -> Array:
    """Deviations y (..., n) from a reference line over x (n,)."""
    slope, height = LINES[line](x, y)
    return np.asarray(y - slope[..., None] * x - height[..., None])


def straightness(x: Array, y: Array, line: str) -> Array:
    """Straightness error (...) of deviations y (..., n): their range about a reference line."""
    return np.asarray(np.ptp(straightened(x, y, line), axis=-1))
