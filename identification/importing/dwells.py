"""Dwells in a continuous log: stretches of readings at one place, between which the target moves.

Displacements over a few readings are either noise or motion; where their sizes on a logarithmic scale fall into two
groups, the threshold between them is Otsu's. A list of single points has one group, and no dwells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index, Mask

LAGS = (1, 3, 10, 30)  # readings over which a displacement is taken: slow motion shows over many only
APART = 0.7  # decades between the mean sizes of noise and motion, from which on there are two groups; by judgement
FEWEST = 12  # readings of a log
SHORTEST = 0.2  # of the median number of readings of a dwell: what is shorter is a reversal on the way; by judgement
HALF = 0.5  # of the median number of readings: a shorter stretch may be a reversal, if its readings scatter more
# times the usual scatter of a dwell: that of three readings is so large by chance once in 10^10 (chi-square of 2)
RESTLESS = 5.0
LEAST = 3  # readings of a dwell
MANY = 10  # readings of a dwell that are averaged even if nothing was recorded on the way
OUTSIDE = 4.0  # times the scatter: readings at the ends of a dwell that still settle
TINY = 1e-6  # mm: resolution of a display, for readings that do not change at all
LARGEST_SCATTER = 1.0  # mm: of readings at one place; by judgement
ONE_PLACE = 30.0  # times the usual step: readings within it are at one place


@dataclass(frozen=True)
class Dwells:
    """Dwells of a log.

    Attributes
    ----------
    first, last : (n,) rows of each dwell, from 0.
    moving : number of readings on the way.
    short : number of stretches that were too short.
    turning : (k, 2) first and last row of stretches in which the target only turned back on its way.
    """

    first: Index
    last: Index
    moving: int
    short: int
    turning: Index

    def __len__(self) -> int:
        return len(self.first)


def find_dwells(points: Array) -> Dwells | None:
    """Dwells of a continuous recording; None where every row is a point of its own.

    Parameters
    ----------
    points : (n, 3) mm in the order of recording; NaN where the target was not seen.
    """
    rows = np.flatnonzero(np.isfinite(points).all(axis=1))
    seen = points[rows]
    if len(seen) < FEWEST:
        return None
    found = _still(seen)
    if found is None:
        return None
    parts = [settled(seen, a, b) for a, b in stretches_of(seen, *found)]
    parts = [(a, b) for a, b in parts if b - a + 1 >= LEAST]
    if not parts:
        return None
    sizes = np.array([b - a + 1 for a, b in parts])
    kept = sizes >= max(LEAST, SHORTEST * float(np.median(sizes)))
    turning = kept & turned_back(sizes, np.array([scatter_of(seen[a : b + 1]) for a, b in parts]))
    kept &= ~turning
    moving = len(seen) - int(sizes.sum())
    if float(np.median(sizes)) < MANY and moving <= len(parts):
        return None  # a few readings of each of several points, and nothing between them
    if float(np.median([_spread(seen[a : b + 1]) for a, b in parts])) > LARGEST_SCATTER:
        return None  # steps between points beside longer ones, such as from one station to the next
    first = rows[np.array([a for a, _ in parts])][kept]
    last = rows[np.array([b for _, b in parts])][kept]
    turned = np.array([[rows[a], rows[b]] for (a, b), own in zip(parts, turning, strict=True) if own], dtype=np.intp)
    return Dwells(first, last, moving, int((~kept & ~turning).sum()), turned.reshape(-1, 2))


def scatter_of(points: Array) -> float:
    """Root mean square distance of some readings (n, 3) from their mean, of n - 1, mm."""
    return float(np.sqrt(np.sum(np.square(points - points.mean(axis=0))) / max(len(points) - 1, 1)))


def turned_back(sizes: Array, scatter: Array) -> Mask:
    """Stretches (n,) of so many readings in which the target was not at rest, but at the turn of its way.

    A length is at rest for a moment where the machine passes the place that is nearest to the station. Its readings
    there lie on a parabola: they scatter far more than those of the dwells, and are fewer.
    """
    usual = float(np.median(sizes))
    long = sizes >= HALF * usual
    return np.asarray(~long & (scatter > RESTLESS * max(float(np.median(scatter[long])), TINY)))


def _spread(points: Array) -> float:
    """Median distance of some readings from their middle, mm."""
    return float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))


def _still(points: Array) -> tuple[Mask, float] | None:
    """Readings at rest, (n,), and the largest step of one (mm); None where there are no two groups of displacements."""
    scale = scale_of([points])
    if scale is None:
        step = float(np.median(np.linalg.norm(np.diff(points, axis=0), axis=1)))
        reach = float(np.linalg.norm(points - np.median(points, axis=0), axis=1).max())
        one = reach < min(ONE_PLACE * max(step, TINY), LARGEST_SCATTER)
        return (np.ones(len(points), dtype=bool), np.inf) if one else None
    return at_rest(points, scale), scale.step


@dataclass(frozen=True)
class Scale:
    """What tells noise from motion: displacements over `lag` readings that are below `step` (mm) are noise."""

    lag: int
    step: float


def scale_of(stretches: Sequence[Array]) -> Scale | None:
    """From stretches (n, 3) of a recording, mm; None where there are no two groups of displacements."""
    best: tuple[float, Scale] | None = None
    for lag in LAGS:
        long = [points for points in stretches if len(points) >= 4 * lag]
        if not long:
            continue
        moved = np.concatenate([np.linalg.norm(points[lag:] - points[:-lag], axis=1) for points in long])
        threshold, apart = _otsu(np.log10(np.maximum(moved, TINY)))
        if apart > APART and (best is None or apart > best[0] + 0.3):
            best = apart, Scale(lag, 10**threshold)
    return None if best is None else best[1]


def at_rest(points: Array, scale: Scale) -> Mask:
    """Readings at rest, (n,): those of a stretch whose ends are near each other."""
    near = np.linalg.norm(points[scale.lag :] - points[: -scale.lag], axis=1) < scale.step
    still = np.zeros(len(points), dtype=bool)
    for shift in range(scale.lag + 1):
        still[shift : shift + len(near)] |= near
    return still


def stretches_of(points: Array, still: Mask, threshold: float) -> list[tuple[int, int]]:
    """First and last reading of each stretch at rest; a jump between two places ends one and begins another."""
    jump = np.linalg.norm(np.diff(points, axis=0), axis=1) > threshold
    joined = still[1:] & still[:-1] & ~jump  # a reading goes on with the stretch of the one before
    first = np.flatnonzero(still & np.append(True, ~joined))
    last = np.flatnonzero(still & np.append(~joined, True))
    return list(zip(first.tolist(), last.tolist(), strict=True))


def _otsu(values: Array) -> tuple[float, float]:
    """Threshold between two groups of values, and the distance of their means (Otsu 1979)."""
    ordered = np.sort(values)
    n = len(ordered)
    k = np.arange(1, n)
    total = np.cumsum(ordered)
    low, high = total[:-1] / k, (total[-1] - total[:-1]) / (n - k)
    between = k * (n - k) * (high - low) ** 2
    at = int(np.argmax(between))
    return float((ordered[at] + ordered[at + 1]) / 2), float(high[at] - low[at])


def settled(points: Array, first: int, last: int) -> tuple[int, int]:
    """A stretch without readings at its ends that lie outside the scatter of its middle."""
    part = points[first : last + 1]
    if len(part) < LEAST:
        return first, last
    distance = np.linalg.norm(part - np.median(part, axis=0), axis=1)
    scale = max(float(np.median(distance)), TINY)
    good = np.flatnonzero(distance < OUTSIDE * scale)
    if not len(good):
        return first, last
    return first + int(good[0]), first + int(good[-1])
