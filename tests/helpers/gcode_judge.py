"""Two programmes side by side, as `tests.gcode_machine` executed them: order, words, rapids, feeds and path."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from tests.helpers.chains import Array
from tests.helpers.gcode_machine import AXES, Event

Shift = Callable[[Array, Array], Array]
PATH = 0.0022  # mm: chord 0.5, bend 0.2 and take-up 0.5 um an axis, rounding
SMALL = 0.2  # mm, of a block that only takes up a change of the correction


def compare(asked: list[Event], sent: list[Event], correct: Shift, figure: float = 1e-4) -> float:
    """Largest distance of the sent path, without its correction, from the path that was asked for, mm.

    Raises
    ------
    AssertionError
        Words, order, rapids, feeds, extrusion or path differ.
    """
    queue, worst = list(sent), 0.0
    free = np.zeros(3, dtype=bool)  # axes that were named up to here
    placed = np.zeros(3, dtype=bool)
    came = np.ones(3)
    for event in asked:
        if event.what == "word":
            head = queue.pop(0)
            assert (head.what, head.text.upper()) == ("word", event.text.upper()), (event, head)
            continue
        step = np.nan_to_num(event.end - event.start)
        free = free | [a in event.named for a in AXES]
        if event.what == "cut" and not np.isfinite([*event.start, *event.end]).all():
            head = queue.pop(0)  # a printer's first positioning
            assert (head.what, head.named, event.extruded) == ("cut", event.named, 0.0)
            assert str(head.end) == str(event.end)
            came = np.where(np.abs(step) > 1e-9, np.sign(step), came)
            continue
        if event.what == "rapid":
            came = np.where(np.abs(step) > 1e-9, np.sign(step), came)
            rapid(event, queue.pop(0), correct, came, figure, placed)
            placed = placed | np.isfinite(event.end)
            continue
        worst = max(worst, cut(event, queue, correct, came, free))
        came = arrival(event, came)
    assert not queue, queue[:3]
    return worst


def arrival(event: Event, came: Array) -> Array:
    """Directions in which axes end a cut: those of their last micrometre."""
    points = event.at(np.linspace(0, 1, 4001)) if event.turn else np.array([event.start, event.end])
    back = points[-1] - points
    out = came.copy()
    for k in range(3):
        far = np.flatnonzero(np.abs(back[:, k]) > (0.001 if event.turn else 1e-9))
        out[k] = np.sign(back[far[-1], k]) if len(far) else came[k]
    return out


def rapid(event: Event, head: Event, correct: Shift, came: Array, figure: float, placed: Array) -> None:
    """One rapid with the same axes, to the corrected place, or to the very same while that is not known."""
    assert (head.what, head.named, head.modes) == ("rapid", event.named, event.modes), (event, head)
    columns = [AXES.index(a) for a in event.named]
    if np.isfinite(event.end).all():
        wanted = correct(event.end[None], came[None])[0]
        least = figure * (2.54 if event.modes[1] == 25.4 else 1.0)
        good = np.abs(head.end - wanted)[columns].max() <= 0.51 * least
        as_it_was = np.abs(head.end - event.end)[columns].max() < 1e-9  # G53
        assert good or as_it_was, (event, head, wanted)
    else:
        assert (head.end[columns] == event.end[columns]).all()
    still = [k for k in range(3) if k not in columns]
    np.testing.assert_array_equal(head.start[still], head.end[still])


def cut(event: Event, queue: list[Event], correct: Shift, came: Array, free: Array) -> float:
    """Take the pieces of one cut from the queue, and follow them along its path."""
    done, worst, extruded, minutes = 0.0, 0.0, 0.0, 0.0
    length = event.length
    share = np.array([0.0, 0.3, 0.6, 1.0])
    while True:
        piece = queue.pop(0)
        assert piece.what == "cut", (event, piece)
        assert piece.turn is None
        assert piece.modes[:5] == event.modes[:5]
        step = piece.end - piece.start
        size = float(np.linalg.norm(step))
        assert all(free[AXES.index(a)] for a in piece.named), (event, piece)
        extruded, minutes = extruded + piece.extruded, minutes + piece.minutes
        points = piece.at(share)
        turned = abs(event.turn[3]) if event.turn else math.inf
        ahead = max(size, 1e-4) / max(length, 1e-9)
        for part in (ahead, 0.05 / turned, 0.15 / turned, -0.05 / turned, -0.15 / turned):  # where an axis turns back
            ends = event.at(np.clip(np.sort([done + 1e-9, done + part]), 0.0, 1.0))
            slope = np.diff(ends, axis=0)[0] if event.turn else event.end - event.start
            sign = np.where(np.abs(slope) > 1e-9, np.sign(slope), came)
            back = points.copy()
            for _ in range(2):
                back = points - np.where(free, correct(back, np.tile(sign, (4, 1))) - back, 0.0)
            where, gap = along(event, back, done + share * size / max(length, 1e-9))
            advance = (where[-1] - where[0]) * length
            if (gap[-1] if advance < size / 2 else gap.max()) < PATH or not event.turn:
                break
        if advance < size / 2:  # a change of the correction is taken up
            assert size < SMALL, (event, piece, where)
            assert gap[-1] < PATH, (event, piece, gap)
        else:
            assert gap.max() < PATH, (event, piece, gap)
            assert where[0] * length < done * length + PATH, (event, piece, where, done)
            worst = max(worst, float(gap.max()))
            done = float(where[-1])
        if event.extruded:
            assert abs(extruded - done * event.extruded) < 4e-5 + abs(event.extruded) * (PATH / max(length, PATH)), (
                piece
            )
        reached = np.abs(back[-1] - event.end)[free].max() < PATH
        following = queue[0] if queue else None
        whole = done > 1 - 1e-9 - PATH / max(length, PATH)
        timed = math.isnan(event.minutes) or abs(minutes / event.minutes - 1) < 1e-6
        if reached and whole and timed and not remainder(event, following, free):
            break
        assert following is not None, (event, piece, done)
        assert following.what == "cut", (event, piece, done)
    assert abs(extruded - event.extruded) < 4e-5
    return worst


def remainder(event: Event, following: Event | None, free: Array) -> bool:
    """Whether a piece of a few micrometres stays at the end of a cut: an axis turned back just before it."""
    if following is None or following.what != "cut" or not math.isnan(event.minutes):
        return False
    size = np.abs(following.end - following.start)
    return bool(size.max() < 2 * PATH and np.abs(following.end - event.end)[free].max() < SMALL / 2)


def along(event: Event, points: Array, near: Array) -> tuple[Array, Array]:
    """Shares of the nearest points of a cut's path, and the distances."""
    step = event.end - event.start
    if event.turn:
        i, j, centre, angle = event.turn
        ray = complex(event.start[i], event.start[j]) - centre
        spin = np.angle((points[:, i] + 1j * points[:, j] - centre) / ray) / angle
        share = spin + np.round((near - spin) * abs(angle) / (2 * np.pi)) * (2 * np.pi / abs(angle))
        k, round_ = 3 - i - j, (abs(ray) * angle) ** 2
        share = (round_ * share + (points[:, k] - event.start[k]) * step[k]) / (round_ + step[k] ** 2)
    elif not step.any():
        share = np.ones(len(points))
    else:
        share = (points - event.start) @ step / (step @ step)
    share = np.clip(share, 0, 1)
    return share, np.linalg.norm(points - event.at(share), axis=1)
