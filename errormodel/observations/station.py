"""Rough place of a station from distances to known points, and the constant that the distances lack.

Linear solution first (squares of the distances differ by a linear function of the station: S. Bancroft, IEEE Trans.
Aerosp. Electron. Syst. 21 (1985) 56), then nonlinear least squares with a robust loss, from several starts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from errormodel.arrays import MAD_STD, Array
from errormodel.observations.base import LineError

SAME_PLACE = 1e-3  # of the distance: solutions that lie closer together are one
SAME_MISFIT = 3.0  # ratio of misfits up to which two places explain the lengths alike, by judgement
FOREIGN = 0.02  # of the spread of the points: errors of a machine go less far
ROUND_OFF = 1e-9  # of the distance: smaller misfits are the same
STEP = 2e-4  # of the spread of the points: errors of a machine make no larger steps from one reading to the next
STANDS_OUT = 5.0  # times the scatter on both sides: a step; by judgement
NEEDED = 2.0  # times the scatter: what readings are off without the step, which a moved station hides in part
FEWEST_BEHIND = 5  # readings behind a step: fewer are outliers
MOST_STEPS = 5  # in one recording
MOST_EVALUATIONS = 50  # of one start: where lengths fit a station, 33 were the most
MOST_TURNS = 10  # of the robust estimation, and
SETTLED = 0.5  # of the scale before: less of a change ends it
BEHIND = -0.7  # cosine of the directions to two places, which are on opposite sides below it; by judgement
FAR_AWAY = 100.0  # times the spread of the points: 80 m about a machine of 0.8 m, the range of the instruments
FLAT = 1e-6  # smallest over largest spread of points below which they lie in a plane or on a line


def located(
    points: Array, readings: Array, known: Mapping[str, float], near: Sequence[float] | None = None
) -> dict[str, float]:
    """Unknown ones of a station's ``x y z`` (mm) and ``dead_path`` (mm), from nominal points.

    Parameters
    ----------
    points : (n, 3) mm; readings : (n,) distance less dead path, mm.
    known : the known ones, by name.
    near : rough place, by which one of several places that explain the readings alike is chosen.

    Raises
    ------
    ValueError
        Too few readings, or two places explain them alike; `LineError`: the points lie on a straight line.
    """
    names = [n for n in ("x", "y", "z", "dead_path") if n not in known]
    if not names:
        return {}
    if len(readings) < len(names):
        raise ValueError(
            f"{len(readings)} readings for the {len(names)} unknowns {', '.join(names)}. Measure more from that place"
        )
    if names == ["dead_path"]:
        station = np.array([known[n] for n in "xyz"])
        return {"dead_path": float(np.median(np.linalg.norm(points - station, axis=1) - readings))}
    if any(n in known for n in "xyz"):  # the schema gives all three or none
        raise ValueError("a station of which one coordinate is known. Give all three or none")
    way, spread = _direction(points), float(np.ptp(points, axis=0).max())
    if near is None and way is not None:
        raise LineError(
            "lengths to points on a straight line, which do not show where the station stands. Write near: with where "
            "it stood, roughly; `iso` takes such lengths as displacements along the line without it",
            _on_line(points, way, readings, known),
        )
    fixed = known.get("dead_path")
    starts = _starts(points, readings, fixed)
    if near is not None:
        starts.append(_from(points, readings, fixed, np.asarray(near, dtype=np.float64)))
        if way is not None and (place := _kept_on_line(points, way, readings, fixed, starts[-1])) is not None:
            return _named(names, place)
    found = sorted((_refined(points, readings, fixed, s) for s in starts), key=lambda f: f[1])
    best, misfit = found[0]
    if misfit > FOREIGN * spread:
        raise ValueError(
            f"lengths that fit a station nowhere: at best half of them are {misfit:.3g} mm off. Look for a wrong unit, "
            "column, machine or dead path"
        )
    reach = float(np.abs(readings).max()) + spread
    alike = [place for place, its in found if its <= SAME_MISFIT * misfit + ROUND_OFF * reach]
    if near is not None:  # a start there may end at another place that explains the lengths as well
        best = min(alike, key=lambda place: float(np.linalg.norm(place[:3] - near)))
        _refuse_other_side(points, best, np.append(near, 0.0))
    for other in alike if near is None else ():
        if np.linalg.norm(other[:3] - best[:3]) > SAME_PLACE * reach:
            if min(np.linalg.norm(s[:3] - points.mean(axis=0)) for s in (best, other)) > FAR_AWAY * spread:
                raise ValueError(
                    f"lengths that fit no station within {FAR_AWAY * spread / 1e3:.0f} m. Look for a wrong sign, unit "
                    "or column"
                )
            one, two = (_shown(s) for s in (best, other))
            raise ValueError(
                f"lengths that fit a station at {one} and at {two} mm alike. Write near: with the one where it stood, "
                "roughly"
            )
    return _named(names, best)


def _from(points: Array, readings: Array, dead_path: float | None, place: Array) -> Array:
    """A place (3,) with its dead path: the known one, or the one that most lengths from there lack, (4,)."""
    lacking = float(np.median(np.linalg.norm(points - place, axis=1) - readings))
    return np.append(place, lacking if dead_path is None else dead_path)


def _kept_on_line(points: Array, way: Array, readings: Array, dead_path: float | None, near: Array) -> Array | None:
    """The place (4,) on the straight line of the points that is nearest to `near`, if lengths fit it; else None.

    Lengths show how far beside that line their station stands to second order, and no better than the errors of the
    machine let them: from a place on the line an estimation does not leave it.
    """
    middle = points.mean(axis=0)
    place = _from(points, readings, dead_path, middle + ((near[:3] - middle) @ way) * way)
    if dead_path is not None:
        too_far = float(np.median(np.linalg.norm(points - place[:3], axis=1) - readings)) - dead_path
        place[:3] -= too_far * np.sign((place[:3] - middle) @ way) * way
    on_line, there = (
        float(np.median(np.abs(np.linalg.norm(points - at[:3], axis=1) - readings - at[3]))) for at in (place, near)
    )
    spread = float(np.ptp(points, axis=0).max())
    return place if on_line <= min(STEP * spread, SAME_MISFIT * there + ROUND_OFF * spread) else None


def _refuse_other_side(points: Array, place: Array, near: Array) -> None:
    """ValueError where lengths put a station behind the points, as seen from where it is said to stand."""
    there, said = (at[:3] - points.mean(axis=0) for at in (place, near))
    away, off = float(np.linalg.norm(there)), float(np.linalg.norm(said))
    outside = min(away, off) > 0.5 * float(np.linalg.norm(np.ptp(points, axis=0)))
    if outside and float(there @ said) < BEHIND * away * off:
        raise ValueError(
            f"lengths that fit a station at {_shown(place)} mm, on the other side of the points than near: "
            f"{_shown(near)}. Look for a wrong sign of the lengths, or write near: with where it stood"
        )


def _named(names: Sequence[str], place: Array) -> dict[str, float]:
    """Those of x, y, z and the dead path that are asked for, of a place (4,)."""
    return {n: float(place["xyz".index(n)] if n in "xyz" else place[3]) for n in names}


def _direction(points: Array) -> Array | None:
    """Unit vector (3,) of the straight line on which points (n, 3) lie; None where they do not, or at one place."""
    _, spread, ways = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    one = spread[0] > 0 and (len(spread) == 1 or spread[1] <= FLAT * spread[0])
    return np.asarray(ways[0]) if one else None


def _on_line(points: Array, way: Array, readings: Array, known: Mapping[str, float]) -> dict[str, float]:
    """The unknown ones of `located` with the station on the line of the points, whose direction is `way` (3,)."""
    middle = points.mean(axis=0)
    along = (points - middle) @ way
    sign = 1.0 if along @ (readings - readings.mean()) >= 0 else -1.0  # the way in which the readings grow
    along, way = sign * along, sign * way
    whole = readings + known["dead_path"] if "dead_path" in known else None
    away = float(np.ptp(along)) if whole is None else float(np.median(whole - along))
    found = dict(zip("xyz", (middle - away * way).tolist(), strict=True))
    return found if whole is not None else {**found, "dead_path": float(np.median(along + away - readings))}


def _shown(place: Array) -> str:
    """A place in mm, of four digits: it is roughly known."""
    digits = 3 - int(np.floor(np.log10(max(float(np.abs(place[:3]).max()), 1e-3))))
    return f"[{', '.join(f'{round(float(v), min(digits, 0)) + 0.0:.0f}' for v in place[:3])}]"


def interruptions(points: Array, readings: Array, place: Array) -> list[tuple[int, float]]:
    """Readings from which on all are longer or shorter by a constant, as when a beam is lost and the counter goes on.

    Parameters
    ----------
    points : (n, 3) mm; readings : (n,) mm, in the order of recording.
    place : (4,) station and dead path, roughly.

    Returns
    -------
    steps : places of the first reading behind each step, and by how much the readings are then longer, mm.
    """
    n, spread = len(readings), float(np.ptp(points, axis=0).max())
    away = place[:3] - points
    distance = np.linalg.norm(away, axis=1)
    gap = distance - readings - place[3]
    # the place may have followed the step: it is estimated with it
    columns = np.column_stack([away / np.maximum(distance, 1e-9)[:, None], np.ones(n)])
    base = columns
    found: list[int] = []
    for _ in range(MOST_STEPS):
        x = _least_sum(columns, gap)
        before = gap - columns @ x
        at, left, tried = _split(before), before, columns
        for _ in range(10):
            if at is None:
                break
            tried = np.column_stack([columns, np.arange(n) >= at])
            x = _least_sum(tried, gap)
            left = gap - tried @ x
            again = _split(left + tried[:, -1] * x[-1])
            if again == at:
                break
            at = again
        if at is None:
            break
        low, high = max([0, *(k for k in found if k < at)]), min([n, *(k for k in found if k > at)])
        shorter = slice(at, high) if high - at <= at - low else slice(low, at)
        scatter = MAD_STD * max(float(np.median(np.abs(left))), float(np.median(np.abs(left[shorter]))))
        explained = float(np.median(np.abs(before[shorter])))
        size = abs(float(x[-1]))
        if size < max(STEP * spread, STANDS_OUT * scatter) or explained < NEEDED * scatter:
            break
        columns = tried
        found.append(at)
    x = _least_sum(columns, gap)
    return sorted((k, -float(step)) for k, step in zip(found, x[base.shape[1] :], strict=True))


def _split(values: Array) -> int | None:
    """The place at which the means before and behind differ most, by the variance between them; None of too few."""
    n = len(values)
    if n < 2 * FEWEST_BEHIND:
        return None
    low, high = np.quantile(values, [0.02, 0.98])  # single readings far off decide nothing
    clipped = np.clip(values, low, high)
    k = np.arange(1, n)
    total = np.cumsum(clipped)
    between = (total[:-1] / k - (total[-1] - total[:-1]) / (n - k)) ** 2 * k * (n - k)
    inside = slice(FEWEST_BEHIND - 1, n - FEWEST_BEHIND)
    return int(k[inside][int(np.argmax(between[inside]))])


def _least_sum(columns: Array, values: Array) -> Array:
    """Coefficients with the smallest sum of absolute residuals, by reweighted least squares."""
    x = np.linalg.lstsq(columns, values, rcond=None)[0]
    for _ in range(30):
        left = np.abs(values - columns @ x)
        weight = 1 / np.sqrt(np.maximum(left, 1e-3 * max(float(np.median(left)), 1e-9)))
        x = np.linalg.lstsq(columns * weight[:, None], values * weight, rcond=None)[0]
    return np.asarray(x)


def _starts(points: Array, readings: Array, dead_path: float | None) -> list[Array]:
    """Places (x, y, z, dead path) to start from: the linear solution, and far ones on all sides."""
    middle = points.mean(axis=0)
    at = points - middle
    out = []
    spread = np.linalg.svd(at, compute_uv=False)
    if spread[-1] > FLAT * spread[0] and len(points) >= 5:
        whole = readings if dead_path is None else readings + dead_path
        columns = [2 * at, np.ones((len(at), 1))] + ([2 * readings[:, None]] if dead_path is None else [])
        # |p|^2 - r^2 = 2 p s + 2 r d + (d^2 - |s|^2), with r the reading, s the station, d the dead path
        solved = np.linalg.lstsq(np.hstack(columns), (at**2).sum(axis=1) - whole**2, rcond=None)[0]
        out.append(np.append(solved[:3] + middle, solved[4] if dead_path is None else dead_path))
    far = float(np.median(np.abs(readings))) if dead_path is None else float(np.median(readings + dead_path))
    far = max(far, float(np.ptp(points, axis=0).max()), 1.0)
    ways = np.array([(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1) if i or j or k], dtype=float)
    if out:  # the linear solution is near; others show whether a place on another side explains the lengths as well
        ways = ways[np.abs(ways).sum(axis=1) != 2]
    unit = ways / np.linalg.norm(ways, axis=1)[:, None]
    return out + [_from(points, readings, dead_path, middle + far * way) for way in unit]


def _refined(points: Array, readings: Array, dead_path: float | None, start: Array) -> tuple[Array, float]:
    """The place (x, y, z, dead path) that a start leads to, and its misfit (median of the distances left, mm)."""
    from scipy.optimize import least_squares

    def left(x: Array) -> Array:
        gap = np.linalg.norm(points - x[:3], axis=1) - readings
        return np.asarray(gap - (x[3] if dead_path is None else dead_path))

    def slopes(x: Array) -> Array:
        away = x[:3] - points
        by_place = away / np.maximum(np.linalg.norm(away, axis=1), 1e-12)[:, None]
        return by_place if dead_path is not None else np.column_stack([by_place, np.full(len(points), -1.0)])

    x = start if dead_path is None else start[:3]
    scale = max(float(np.median(np.abs(left(x)))), 1e-6)
    for turn in range(MOST_TURNS):  # the scale of the loss is known after the first, and falls where readings are wrong
        x = least_squares(left, x, slopes, x_scale="jac", loss="soft_l1", f_scale=scale, xtol=1e-13, ftol=1e-13,
                          max_nfev=MOST_EVALUATIONS).x  # fmt: skip
        before, scale = scale, max(3 * float(np.median(np.abs(left(x)))), 1e-6)
        if turn and scale > SETTLED * before:
            break
    return np.append(x[:3], x[3] if dead_path is None else dead_path), float(np.median(np.abs(left(x))))
