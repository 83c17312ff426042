"""A small control of its own, to execute programmes. Nothing of the package is in it.

It reads character by character, keeps positions of the axes in mm, and writes down what happens in order: rapids with
the axes they name, cuts with their path, feed and extrusion, and every other word. Arcs are complex numbers here.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from tests.helpers.chains import Array

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
            elif g in (4, 28, 92, 53, 40, 80, 64, 61, 98, 99):
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
