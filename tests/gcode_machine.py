"""A small control of its own, to execute programmes and compare two of them. Nothing of the package is in it.

It reads character by character, keeps positions of the axes in mm, and writes down what happens in order: rapids with
the axes they name, cuts with their path, feed and extrusion, and every other word. Arcs are complex numbers here.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from tests.chains import Array

AXES = "XYZ"
CENTRE = {17: ("XY", "IJ"), 18: ("ZX", "KI"), 19: ("YZ", "JK")}


@dataclass
class Event:
    """Something that happens: `what` is rapid, cut or word."""

    what: str
    text: str = ""
    named: str = ""
    start: Array = field(default_factory=lambda: np.zeros(3))
    end: Array = field(default_factory=lambda: np.zeros(3))
    turn: tuple[int, int, complex, float] | None = None  # columns, centre, angle
    minutes: float = math.nan  # in inverse time
    feed: str = ""
    extruded: float = 0.0
    modes: tuple[object, ...] = ()

    def at(self, share: Array) -> Array:
        out = self.start + np.outer(share, self.end - self.start)
        if self.turn:
            i, j, centre, angle = self.turn
            ray = complex(self.start[i], self.start[j]) - centre
            last = abs(complex(self.end[i], self.end[j]) - centre)
            size = 1 + share * (last / abs(ray) - 1)
            z = centre + ray * size * np.exp(1j * angle * share)
            out[:, i], out[:, j] = z.real, z.imag
        return out

    @property
    def length(self) -> float:
        rise = np.linalg.norm(self.end - self.start)
        if not self.turn:
            return float(rise)
        i, j, centre, angle = self.turn
        k = 3 - i - j
        return math.hypot(abs(complex(self.start[i], self.start[j]) - centre) * angle, (self.end - self.start)[k])


def scan(line: str, printer: bool) -> list[tuple[str, str]]:
    """Letters with what follows them; comments are words of their own."""
    out: list[tuple[str, str]] = []
    k = 0
    while k < len(line):
        c = line[k]
        if c == ";":
            return [*out, (";", line[k:])]
        if c == "(" and not printer:
            end = line.index(")", k)
            out.append(("(", line[k : end + 1]))
            k = end + 1
        elif c.isalpha():
            start = k = k + 1
            while k < len(line) and line[k] in "+-.0123456789 ":
                k += 1
            out.append((c.upper(), line[start:k].replace(" ", "")))
        else:
            assert c in " /%", (c, line)
            k += 1
    return out


def execute(
    text: str,
    offsets: Mapping[str, Mapping[str, float]] | None = None,
    printer: bool = False,
    switch: bool = True,
    start: tuple[float, float, float] = (math.nan,) * 3,
) -> list[Event]:
    """Everything that happens. `switch`: optional blocks are carried out."""
    at = np.array(start)
    motion, plane, absolute, centre_absolute, unit, timing = None, 17, True, False, 1.0, 94
    origin, tool, filament, relative = "", "", 0.0, False
    given = offsets or {}
    events: list[Event] = []
    for line in text.split("\n"):
        if line.startswith("/") and not switch:
            continue
        words = scan(line, printer)
        gs = [float(v) for c, v in words if c == "G"]
        value = {c: v for c, v in words if c not in "GM(;N"}
        ends, done = [], []
        for c, v in words:
            if c == "M" and float(v) in (82, 83):
                relative = float(v) == 83
            if c == "M" and int(float(v)) in (0, 1, 2, 30):
                ends.append(Event("word", f"{c}{v}"))
            elif (c in "MSTH(;N" and c != "N") or (c == "F" and timing != 93 and 93 not in gs):
                done.append(Event("word", c + v))
        if printer and words and words[0][0] in "MT":
            events += [Event("word", line.strip())]
            continue
        for g in gs:
            if g in (17, 18, 19):
                plane = int(g)
            elif g in (20, 21):
                unit = 25.4 if g == 20 else 1.0
            elif g in (90, 91):
                absolute = g == 90
            elif g in (90.1, 91.1):
                centre_absolute = g == 90.1
            elif g in (93, 94, 95):
                timing = int(g)
            elif 54 <= g <= 59:
                origin = f"G{g:g}"
            elif g == 43:
                tool = f"H{float(value['H']):g}"
            elif g == 49:
                tool = ""
            elif g in (0, 1, 2, 3):
                motion = int(g)
            elif g in (4, 28, 92, 53, 40, 80, 64, 61):
                done.append(Event("word", f"G{g:g}"))
            else:
                raise AssertionError(f"G{g:g}")
        events += done
        if 4 in gs or 28 in gs or 92 in gs:
            filament = float(value.get("E", filament)) if 92 in gs else filament
            events += [Event("word", line.strip()), *ends]
            continue
        named = "".join(a for a in AXES if a in value)
        shift = np.array([given.get(origin, {}).get(a, 0.0) + given.get(tool, {}).get(a, 0.0) for a in AXES])
        if not named and not (motion in (2, 3) and {"I", "J", "K"} & {*value}):
            if "E" in value:
                events.append(Event("word", f"E{value['E']}"))
                filament = float(value["E"]) + (filament if relative else 0.0)
            events += ends
            continue
        goal = at.copy()
        for a in named:
            k, v = AXES.index(a), float(value[a]) * unit
            goal[k] = v + (0.0 if 53 in gs else shift[k]) if absolute else at[k] + v
        modes = (absolute, unit, timing, origin, tool, plane, centre_absolute)
        event = Event("rapid" if motion == 0 and not printer else "cut", "", named, at, goal, modes=modes)
        if motion in (2, 3):
            event.turn = turn(motion == 2, *CENTRE[plane], value, at, goal, unit, shift if centre_absolute else at)
        if timing == 93 and event.what == "cut":
            event.minutes = 1 / float(value["F"])
        if "E" in value:
            target = float(value["E"]) + (filament if relative else 0.0)
            event.extruded, filament = target - filament, target
        events += [event, *ends]
        at = goal
    return events


def turn(
    clockwise: bool,
    plane: str,
    letters: str,
    value: Mapping[str, str],
    at: Array,
    goal: Array,
    unit: float,
    base: Array,
) -> tuple[int, int, complex, float]:
    i, j = (AXES.index(a) for a in plane)
    a, b = complex(at[i], at[j]), complex(goal[i], goal[j])
    if "R" in value:
        radius = float(value["R"]) * unit
        half = cmath.asin(min(abs(b - a) / 2 / abs(radius), 1.0)).real
        angle = 2 * half if radius > 0 else 2 * math.pi - 2 * half
        angle *= -1 if clockwise else 1
        centre = (b - a * cmath.exp(1j * angle)) / (1 - cmath.exp(1j * angle))
        return i, j, centre, angle
    centre = complex(base[i], base[j]) + unit * complex(*(float(value.get(c, 0)) for c in letters))
    angle = cmath.phase((b - centre) / (a - centre))
    if abs(b - a) < 1e-9:
        angle = 0.0
    if clockwise and angle >= 0:
        angle -= 2 * math.pi
    if not clockwise and angle <= 0:
        angle += 2 * math.pi
    return i, j, centre, angle


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
