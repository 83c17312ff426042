"""A station that was moved on the way: from a reading on, distances fit another place.

From a reading on, a moved station adds to the distances its shift along the lines of sight, and a constant where the
counter was set. Borders are compared by what these four columns explain beside a model of the rest (two-sample
comparison with covariates, by cumulative sums). Where no one place fits at all, two are looked for from either end.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from errormodel.arrays import Array

FEWEST_BEHIND = 5  # readings behind a border more than its unknowns: fewer are outliers
UNSEEN = 1e-5  # of the readings behind a border: directions of a shift that they see less are left out
FEWEST_OF_PLACE = 10  # readings of a place: its four unknowns, and as many again that could contradict them
SHARES = (0.5, 0.25, 0.125)  # of the readings, from either end, that may be of one place
SAME_PLACE = 0.1  # of a jump of the counter: places found from either side are no better known
AGREE = 0.9  # of the readings must lie on the side of the border that they are said to: the others are outliers
MOST_ROWS = 20_000  # that are compared one by one; of more, every second, third ...


Locate = Callable[[Array, Array], Array]


class Move(NamedTuple):
    """A move before the reading `first` (from 0), by `shift` (3,) in mm; readings are `longer` by a constant, mm."""

    first: int
    shift: Array
    longer: float

    @property
    def counter_only(self) -> bool:
        """Whether the place is the same, and only the counter was set."""
        return float(np.linalg.norm(self.shift)) < SAME_PLACE * abs(self.longer)

    @property
    def text(self) -> str:
        """By how much, in words."""
        return f"{np.linalg.norm(self.shift):.3g} mm ({', '.join(f'{v:+.3g}' for v in self.shift)} in x, y, z)"


def sight(points: Array, station: Array) -> Array:
    """Changes (n, 4) of distances less a dead path with x, y, z of the station and with the dead path."""
    away = station[:3] - points
    unit = away / np.maximum(np.linalg.norm(away, axis=1), 1e-9)[:, None]
    return np.column_stack([unit, -np.ones(len(points))])


def border(known: Array, changes: Array, left: Array) -> tuple[int, float] | None:
    """The row from which on `changes` explain most of `left` beside `known`, and how much of its sum of squares.

    Parameters
    ----------
    known : (n, p) columns that explain rows on both sides alike.
    changes : (n, m) columns whose coefficients change at the border.
    left : (n,) what is to be explained.

    Returns
    -------
    row and gain, or None of too few rows.
    """
    every = max(1, len(left) // MOST_ROWS)
    own, columns, values = known[::every], changes[::every], left[::every]
    scale = np.linalg.norm(own, axis=0)
    u, s, _ = np.linalg.svd(own / np.where(scale > 0, scale, 1.0), full_matrices=False)
    u = u[:, s > 1e-9 * s[0]]
    values = values - u @ (u.T @ values)
    n, m = columns.shape
    fewest = m + FEWEST_BEHIND
    if n < max(2 * fewest, u.shape[1] + 2 * m):
        return None
    pairs = _behind(np.einsum("ni,nj->nij", columns, columns))
    shared = _behind(np.einsum("ni,nj->nij", u, columns))
    product = _behind(columns * values[:, None])
    inside = slice(fewest, n - fewest + 1)
    free = pairs[inside] - np.einsum("kpi,kpj->kij", shared[inside], shared[inside])
    size, way = np.linalg.eigh(free)
    along = np.einsum("kij,ki->kj", way, product[inside])
    gain = np.sum(np.where(size > UNSEEN * n, along**2 / np.maximum(size, UNSEEN * n), 0.0), axis=1)
    at = int(np.argmax(gain))
    return every * (at + fewest), float(gain[at]) * every


def _behind(values: Array) -> Array:
    """Sums of each row and those behind it."""
    return np.asarray(np.cumsum(values[::-1], axis=0)[::-1])


def parted(points: Array, readings: Array, place: Locate, near: float) -> list[tuple[int, Array]]:
    """Places far apart, of which each fits a stretch of the readings, where no one place fits all.

    Parameters
    ----------
    place : station and dead path (4,) that fit some of the readings; ValueError where there is no such place.
    near : mm, within which readings fit a place.

    Returns
    -------
    first reading of each stretch, and its place; empty where stretches do not explain the readings either.
    """
    n = len(readings)
    for share in SHARES:
        size = int(share * n)
        for part, front in ((slice(0, size), True), (slice(n - size, n), False)):
            if size < FEWEST_OF_PLACE:
                continue
            try:
                at = place(points[part], readings[part])
            except ValueError:
                continue
            fits = np.abs(np.linalg.norm(points - at[:3], axis=1) - at[3] - readings) < near
            k = _end(fits if front else ~fits)
            agree = fits[:k].sum() + (~fits[k:]).sum() if front else (~fits[:k]).sum() + fits[k:].sum()
            if agree < AGREE * n or not FEWEST_OF_PLACE <= k <= n - FEWEST_OF_PLACE:
                continue
            rest = slice(k, n) if front else slice(0, k)
            try:
                others = [(0, place(points[rest], readings[rest]))]
            except ValueError:
                others = parted(points[rest], readings[rest], place, near)
            if others:
                own = [(0, at)] if front else others
                return [*own, *((k + first, there) for first, there in (others if front else [(0, at)]))]
    return []


def refined(points: Array, readings: Array, places: list[tuple[int, Array]], near: float) -> list[tuple[int, Array]]:
    """Places with the borders at which the readings on both sides lie nearest to theirs; arguments as of `parted`."""
    off = [np.minimum(np.abs(np.linalg.norm(points - p[:3], axis=1) - p[3] - readings), near) for _, p in places]
    out = places[:1]
    for k in range(1, len(places)):
        low = out[-1][0]
        high = places[k + 1][0] if k + 1 < len(places) else len(readings)
        one, two = off[k - 1][low:high], off[k][low:high]
        score = np.append(0, np.cumsum(one)) + np.append(np.cumsum(two[::-1])[::-1], 0)
        out.append((low + int(np.argmin(score)), places[k][1]))
    return out


def _end(own: Array) -> int:
    """Where a stretch of rows with a property, and one of rows without it, part best."""
    score = np.append(0, np.cumsum(np.where(own, 1, -1)))
    return int(np.argmax(score))
