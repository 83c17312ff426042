"""Which measured reading belongs to which command: by name, by order, or by time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.exceptions import InputError
from identification.importing.clock_jumps import (
    FEWEST,
    INSIDE,
    SHARE,
    STEPS,
    listed_jump,
    refuse_backwards,
    refuse_jump,
    speeds_part,
)
from identification.observation.frames import align

ALIKE = 0.3  # least correlation of two speeds
PEAKS = 5  # offsets at which the paths are laid on each other
APART = 3  # steps between two of them
OVERLAP = 0.3  # of the shorter of two logs must lie within the other
NAMED = 0.5  # of the measured points must have a name that a command has, for the names to count
DENSE = 4.0  # commands a reading, from which on they are a log of the way and no list of poses
GRID = 200_000  # most instants at which two recordings are compared
NEAR_IN_TIME = 0.45  # of the usual time between two poses
FINER = 24  # halvings of the interval in which the offset of two clocks lies


@dataclass(frozen=True)
class Matched:
    """Commands of readings.

    Attributes
    ----------
    command : (n,) row of the command of each reading, from 0; -1: none.
    how : in words, as the end of "joined by ...".
    offset : s that the clock of the measurements is ahead of that of the commands; None: no clock was used.
    """

    command: Index
    how: str
    offset: float | None = None


def plain_name(text: object) -> str:
    """A point's name without blanks, case and the asterisk that some programs put behind a repeated one."""
    name = " ".join(str(text).split()).rstrip("*").rstrip().casefold()
    return name[:-2] if name.endswith(".0") and name[:-2].isdigit() else name


def common_names(measured: Sequence[object], commands: Sequence[object]) -> float:
    """Share of the measured points whose name a command has."""
    known = {plain_name(n) for n in commands}
    return float(np.mean([plain_name(n) in known for n in measured])) if len(measured) else 0.0


def by_name(measured: Sequence[object], commands: Sequence[object]) -> Matched:
    """Commands of the same name; of one that comes several times on both sides, the first to the first, and so on."""
    places: dict[str, list[int]] = {}
    for row, name in enumerate(commands):
        places.setdefault(plain_name(name), []).append(row)
    seen: dict[str, int] = {}
    out = []
    for name in map(plain_name, measured):
        own = places.get(name)
        k = seen.get(name, 0)
        seen[name] = k + 1
        out.append(-1 if own is None else own[k % len(own)])
    return Matched(np.array(out, dtype=np.intp), "name")


def by_order(count: int, commands: int, nominal: Array, measured: Array, again: Sequence[int] = ()) -> Matched | None:
    """The k-th reading to the k-th command; or a whole number of readings a command, or passes through them.

    Parameters
    ----------
    count, commands : numbers of readings and commands.
    nominal : (commands, 3) mm.
    measured : (count, 3) mm, by which several readings a command and several passes are distinguished.
    again : rows of commands that were waited at once more each, and read then as well where the count says so.
    """
    rows = np.arange(count)
    if count == commands:
        return Matched(rows, "order")
    if again and count == commands + len(again):
        every = np.sort(np.append(np.arange(commands), again))
        return Matched(every, f"order, {len(again)} of them at a place that was waited at again")
    if commands == 0 or count % commands:
        return None
    times = count // commands
    block, cycle = rows // times, rows % commands
    if _misfit(nominal[block], measured) <= _misfit(nominal[cycle], measured):
        return Matched(block, f"order, {times} readings a command")
    return Matched(cycle, f"order, {times} passes through the commands")


def _misfit(nominal: Array, measured: Array) -> float:
    good = np.isfinite(measured).all(axis=1)
    a, b = nominal[good], measured[good]
    return float(np.median(np.linalg.norm(b - align(a, b).apply(a), axis=1))) if len(a) else np.inf


def by_time(
    path: Array, command_times: Array, points: Array, when: Array, middle: Array, *, same_clock: bool, name: str,
    measured: str = "the measured file",
) -> Matched:  # fmt: skip
    """The command that was in force in the middle of each reading, after the offset of the clocks.

    Parameters
    ----------
    path : (m, 3) nominal points at the commands, mm.
    command_times : (m,) s, their times.
    points : (n, 3) mm, all measured points in the order of recording.
    when : (n,) s, their times.
    middle : (k,) s, of the readings.
    same_clock : whether both have dates; their offset is then looked for all the same.
    name : of the commands' file, for messages; `measured`: of the other.

    Raises
    ------
    InputError
        Times are missing or not in order, a clock was set on the way, or no offset brings the recordings together.
    """
    refuse_backwards(command_times, name)
    if np.isnan(command_times).any():
        row = int(np.argmax(np.isnan(command_times)))
        raise InputError(f"{name}, row {row + 1}", "a time that is missing", "Join by order")
    if len(command_times) > DENSE * len(middle):
        refuse_backwards(when, measured)
        _refuse_two_offsets(path, command_times, points, when, measured, name)
        offset = speed_offset(path, command_times, points, when)
        if offset is None:
            raise InputError(name, "its motions and those measured do not resemble each other in time", "Join by order")
        at = np.searchsorted(command_times, middle - offset, side="right") - 1
        inside = (middle - offset >= command_times[0]) & (middle - offset <= command_times[-1])
        return Matched(np.where(inside, np.clip(at, 0, None), -1), "time", offset)
    offset = 0.0 if same_clock else _listed_offset(command_times, middle)
    gap = float(np.median(np.diff(command_times))) if len(command_times) > 1 else np.inf
    nearest = np.abs((middle - offset)[:, None] - command_times).argmin(axis=1)
    far = np.abs(middle - offset - command_times[nearest]) > NEAR_IN_TIME * gap
    if same_clock and far.mean() > 0.5:  # dates of two clocks, one of them in another zone or set wrongly
        offset = _listed_offset(command_times, middle)
        nearest = np.abs((middle - offset)[:, None] - command_times).argmin(axis=1)
        far = np.abs(middle - offset - command_times[nearest]) > NEAR_IN_TIME * gap
    command = np.where(far, -1, nearest)
    if far.sum() >= FEWEST:  # a list in another order, such as that of its names, joins as well
        refuse_backwards(when, measured)
    jump = listed_jump(command_times, middle, command, offset)
    if jump is not None:
        row = int(np.argmin(np.abs(when - middle[jump[0]])))
        refuse_jump(
            f"readings of which one offset joins {int((~far).sum())} of {len(far)}", jump[1], row, measured, name
        )
    return Matched(command, "time", offset)


def _refuse_two_offsets(
    path: Array, command_times: Array, points: Array, when: Array, measured: str, name: str
) -> None:
    """InputError where two offsets, of the first and the last part of a recording, join it far better than one."""
    good = np.flatnonzero(np.isfinite(points).all(axis=1) & np.isfinite(when))
    size = len(good) // SHARE
    if size < SHARE:
        return
    parts = (good[:size], good[-size:], good)
    ends = [_rough_offset(path, command_times, points[part], when[part], INSIDE) for part in parts]
    if ends[0] is None or ends[1] is None:
        return
    (first, step), (last, _) = ends[0], ends[1]
    if abs(first - last) < STEPS * step:
        return
    whole = [*ends[2:], _rough_offset(path, command_times, points, when)]  # of cycles that repeat, one may fit all
    singles = [first, last, *(found[0] for found in whole if found is not None)]
    at = speeds_part(path, command_times, points[good], when[good], (first, last), singles)
    if at is not None:
        refuse_jump("two logs that no one offset joins", last - first, int(good[at]), measured, name)


def _listed_offset(command_times: Array, middle: Array) -> float:
    """Offset that brings most readings to a command, from all differences between the first and any."""
    gap = float(np.median(np.diff(command_times))) if len(command_times) > 1 else 1.0
    best, most = 0.0, -1
    for first in middle[:5]:
        for offset in first - command_times:
            near = np.abs((middle - offset)[:, None] - command_times).min(axis=1) < 0.25 * gap
            if near.sum() > most:
                best, most = float(offset), int(near.sum())
    return best


def speed_offset(path: Array, command_times: Array, points: Array, when: Array) -> float | None:
    """How far (s) the measuring clock is ahead of the controller's, from the speeds of the two paths.

    A speed is the same in every frame. The correlation of both gives the offset to an interval of the slower clock, the
    alignment of the interpolated path then to a fraction of it. None where they do not correlate.
    """
    rough, step = _rough_offsets(path, command_times, points, when)
    good = np.isfinite(points).all(axis=1) & np.isfinite(when)
    refined = [_refined(path, command_times, points[good], when[good], r, 2 * step) for r in rough]
    return min(refined, key=lambda f: f[1])[0] if refined else None


def _rough_offset(
    path: Array, command_times: Array, points: Array, when: Array, inside: float = OVERLAP
) -> tuple[float, float] | None:
    """The offset of the highest correlation, and how near it is, s; None where the speeds do not correlate."""
    rough, step = _rough_offsets(path, command_times, points, when, inside)
    return (rough[0], step) if rough else None


def _rough_offsets(
    path: Array, command_times: Array, points: Array, when: Array, inside: float = OVERLAP
) -> tuple[list[float], float]:
    """Offsets by the correlation of both speeds, the highest first, and how near they are, s.

    At least `inside` of the shorter recording lies within the other.
    """
    from scipy.signal import correlate

    good = np.isfinite(points).all(axis=1) & np.isfinite(when)
    points, when = points[good], when[good]
    step = max(float(np.median(np.diff(command_times))), float(np.median(np.diff(when))))
    longest = max(float(np.ptp(command_times)), float(np.ptp(when)))
    step = max(step, longest / GRID)
    one, other = _speed(path, command_times, step), _speed(points, when, step)
    if one.std() == 0 or other.std() == 0:
        return [], step
    a, b = one - one.mean(), other - other.mean()
    overlap = correlate(np.ones(len(b)), np.ones(len(a)), mode="full")
    alike = correlate(b, a, mode="full") / (a.std() * b.std())
    share = np.where(overlap > inside * min(len(a), len(b)), alike / np.maximum(overlap, 1), -1.0)
    places: list[int] = []
    for at in np.argsort(-share):
        if share[at] < ALIKE or len(places) == PEAKS:
            break
        if all(abs(int(at) - other) > APART for other in places):
            places.append(int(at))
    return [(at - (len(a) - 1)) * step + float(when[0] - command_times[0]) for at in places], step


def _speed(points: Array, when: Array, step: float) -> Array:
    grid = np.arange(when[0], when[-1] + step / 2, step)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return np.diff(np.interp(grid, when, way)) if len(grid) > 2 else np.zeros(1)


def _refined(
    path: Array, command_times: Array, points: Array, when: Array, rough: float, width: float
) -> tuple[float, float]:
    """The offset within `width` of a rough one at which the paths lie on each other best, and how far off, mm.

    By golden section.
    """
    every = slice(None, None, max(1, len(points) // 2000))
    own, at = points[every], when[every]

    def miss(offset: float) -> float:
        clock = at - offset
        inside = (clock >= command_times[0]) & (clock <= command_times[-1])
        if inside.sum() < 4:
            return np.inf
        reached = np.column_stack([np.interp(clock[inside], command_times, path[:, k]) for k in range(3)])
        return float(
            np.mean(np.linalg.norm(own[inside] - align(reached, own[inside], rounds=3).apply(reached), axis=1))
        )

    low, high = rough - width, rough + width
    ratio = (5**0.5 - 1) / 2
    for _ in range(FINER):
        left, right = high - ratio * (high - low), low + ratio * (high - low)
        if miss(left) <= miss(right):
            high = right
        else:
            low = left
    return (low + high) / 2, miss((low + high) / 2)
