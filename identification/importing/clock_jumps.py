"""A clock that was set, or went back, between a log of commands and the measurements: one offset does not join them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.exceptions import InputError
from identification.importing.words import LISTED

INSIDE = 0.9  # of a part of a recording must lie within the other
SHARE = 4  # the first and the last of so many parts of a recording are joined for themselves
STEPS = 10.0  # intervals of the slower clock: offsets of two parts that are nearer are one
BETTER = 2.0  # times smaller must the differences of the speeds be with two offsets than with the better of them
PAUSE = 5.0  # times the usual interval of a recording
NEAR = 0.25  # of the usual time between two poses: so near does a reading lie at its command
FEWEST = 3  # readings behind a jump
CURE = (
    "Import the rows before and behind by themselves (--leave-out), or leave the times out: --columns time=- and, "
    "where the numbers agree, --match order"
)


def gone_back(when: Array) -> tuple[Index, Array]:
    """Rows (k,), from 0, before which the times (n,) of a recording go back, and by how much, s."""
    seen = np.flatnonzero(np.isfinite(when))
    steps = np.diff(when[seen])
    back = np.flatnonzero(steps < 0)
    return seen[back + 1], -steps[back]


def refuse_backwards(when: Array, name: str) -> None:
    """InputError about the times (n,) of a recording, in its order, that go back."""
    rows, sizes = gone_back(when)
    if len(rows):
        raise InputError(name, f"its clock {_went(rows, sizes)}: it was set, or the rows are in another order", CURE)


def _went(rows: Index, sizes: Array) -> str:
    """That times go back, by how much and where, in words."""
    if len(rows) == 1:
        return f"goes back by {sizes[0]:.4g} s before row {rows[0] + 1}"
    shown = ", ".join(str(k + 1) for k in rows[:LISTED])
    more = " ..." if len(rows) > LISTED else ""
    return f"goes back {len(rows)} times, by up to {sizes.max():.4g} s, before rows {shown}{more}"


def unordered_times(when: Array, groups: Index, log: bool) -> str:
    """What to say of times that go back where another order than theirs joined the rows; empty: nothing.

    Parameters
    ----------
    when : (n,) s, in the order of the rows.
    groups : (n,) numbers of rows that have one clock: a run may begin at zero again.
    log : whether it is a continuous recording, whose rows are in the order of time. There an interval less is no
        clock that was set: two readings changed places on their way into the file.
    """
    steps = np.diff(when[np.isfinite(when)])
    least = float(np.median(steps[steps > 0])) if log and (steps > 0).any() else 0.0
    found = [(own[k], size) for own, k, size in _in_groups(when, groups) if size > least]
    if not found:
        return ""
    rows, sizes = (np.array(part) for part in zip(*sorted(found), strict=True))
    if log:
        return (
            f"its clock {_went(rows, sizes)}: it was set. Its times were left out, so that nothing follows from "
            "them (drift, order of the rows)"
        )
    return (
        f"its clock {_went(rows, sizes)}: sides of arrival and drift follow the times, as of rows in another order "
        "than they were measured in. If the clock was set, leave the times out: --columns time=-"
    )


def _in_groups(when: Array, groups: Index) -> Iterator[tuple[Index, int, float]]:
    """Rows of a group, the place among them before which its times go back, and by how much, s."""
    for label in np.unique(groups):
        own = np.flatnonzero(groups == label)
        for k, size in zip(*gone_back(when[own]), strict=True):
            yield own, int(k), float(size)


def speeds_part(
    path: Array, command_times: Array, points: Array, when: Array, offsets: tuple[float, float],
    singles: Sequence[float],
) -> int | None:  # fmt: skip
    """The reading from which on the second offset joins two logs, where no single one joins them half as well.

    Parameters
    ----------
    path : (m, 3) nominal points at the commands, mm; command_times : (m,) s.
    points : (n, 3) mm; when : (n,) s, in the order of recording.
    offsets : s that the clock of the measurements is ahead, by the first part of them and by the last.
    singles : s, offsets that may join all of it.
    """
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    moved = np.linalg.norm(np.diff(points, axis=0), axis=1)
    steps = np.diff(when)
    steady = steps <= PAUSE * np.median(steps)  # a pause, or the jump itself, says nothing of speeds

    def off(offset: float) -> Array:
        return np.where(steady, np.abs(moved - np.diff(np.interp(when - offset, command_times, way))), 0.0)

    before, behind = map(off, offsets)
    both = np.append(0.0, np.cumsum(before)) + np.append(np.cumsum(behind[::-1])[::-1], 0.0)
    at = int(np.argmin(both))
    if both[at] * BETTER > min(float(off(single).sum()) for single in singles) or not 0 < at < len(before):
        return None
    return at + 1


def refuse_jump(found: str, jump: float, row: int, name: str, commands: str) -> None:
    """InputError about a clock that was set on the way; `row` of the measured file, from 0."""
    size = f"{abs(jump):.4g} s {'further ahead' if jump > 0 else 'further behind'}"
    text = f"{found}: from row {row + 1} on its clock is {size} of that of {commands} than before. One of them was set"
    raise InputError(name, text, CURE)


def listed_jump(command_times: Array, middle: Array, command: Index, offset: float) -> tuple[int, float] | None:
    """The reading from which on (or up to which) another offset joins a list, and by how much it is larger there, s.

    Parameters
    ----------
    command_times : (m,) s; middle : (k,) s, of the readings.
    command : (k,) row of the command of each reading with `offset`, -1: none.
    """
    bare = command < 0
    n = len(bare)
    if bare.sum() < FEWEST or bare.all():
        return None
    gap = float(np.median(np.diff(command_times))) if len(command_times) > 1 else 1.0
    first = int(np.argmax(bare))
    behind = first > 0
    part = slice(first, n) if behind else slice(0, int(n - np.argmax(bare[::-1])))
    if bare[part].mean() < 1 - 1 / n and not bare[part].all():
        return None
    used = command[~bare]
    left = np.setdiff1d(np.arange(len(command_times)), used)
    left = left[left > used.max()] if behind else left[left < used.min()]
    own = middle[part]
    if len(left) < len(own):
        return None
    other = float(np.median(own - command_times[left[: len(own)] if behind else left[-len(own) :]]))
    near = np.abs((own - other)[:, None] - command_times[left]).min(axis=1) < NEAR * gap
    if not near.all() or abs(other - offset) < gap:
        return None
    return (part.start, other - offset) if behind else (part.stop, offset - other)
