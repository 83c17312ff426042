"""G-code and tables of commands, for controllers without compensation tables: the commands themselves are corrected.

A programme's positions are taken as those of the axes; a comment ``(ERRORMODEL OFFSET X100 Y-20 Z310)`` says what to
add to them to get the axes' positions (work offset, tool length). Straight cuts are divided where the correction
bends, arcs into chords. What changes the path inside the control (increments, cycles, cutter radius, tool centre
point) is refused. A CSV has a column a joint, in mm and degrees.

Source: RS274/NGC (NIST IR 6556) for words and modal groups.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.base import Correct, Rewriter
from errormodel.controllers.setup import Setup
from errormodel.controllers.text import Lines
from errormodel.exceptions import InputError

WORD = re.compile(r"([A-Z])\s*([-+]?\d*\.?\d+)")
COMMENT = re.compile(r"\(.*?\)|;.*$")
OFFSET = re.compile(r"\(\s*ERRORMODEL OFFSET([^)]*)\)", re.IGNORECASE)
REFUSED = {
    20.0: "inches (G20)",
    91.0: "increments (G91)",
    41.0: "cutter radius compensation (G41)",
    42.0: "cutter radius compensation (G42)",
    43.4: "tool centre point control (G43.4)",
    **{float(g): f"a canned cycle (G{g})" for g in range(81, 90)},
}
PASSED = {28.0, 30.0, 53.0, 92.0, 10.0, 4.0}  # lines whose axis words are no positions of the path
PLANES = {17.0: ("X", "Y", "I", "J"), 18.0: ("Z", "X", "K", "I"), 19.0: ("Y", "Z", "J", "K")}
BEND = 0.0002  # mm, by which a divided cut may miss the curve of the correction
CHORD = 0.0005  # mm, between an arc and its chords
LONGEST = 10_000  # pieces of one line


@dataclass(frozen=True)
class Move:
    """One line that moves: its words without axes, and the positions (k, axes) it runs through."""

    line: int
    words: str
    rapid: bool
    path: Array


class GCode(Rewriter):
    """Corrected programmes."""

    name: ClassVar[str] = "gcode"
    title: ClassVar[str] = "corrected G-code or CSV of commands (controllers without tables)"
    source: ClassVar[str] = "NIST IR 6556 (RS274/NGC)"

    def quantum(self, setup: Setup) -> float:
        return 0.5 * 10.0 ** -self._figures(setup)

    @staticmethod
    def _figures(setup: Setup) -> int:
        return int(np.ceil(-np.log10(setup.resolution or 1e-4) - 1e-9))

    def example(self, setup: Setup, q: Array) -> dict[str, str]:
        figures = self._figures(setup)
        if any(len(a.joint) > 1 for a in setup.axes) and not setup.linear:
            rows = [",".join(f"{v:.{figures}f}" for v in row) for row in q]
            return {"check.csv": "\n".join([",".join(a.joint for a in setup.axes), *rows]) + "\n"}
        rows = [
            " ".join(["G0", *(f"{n}{v:.{figures}f}" for n, v in zip(setup.names, row, strict=True)), "\nM0"])
            for row in q
        ]
        return {"check.nc": "\n".join(["G90 G21", *rows, "M30"]) + "\n"}

    def positions(self, name: str, text: str, setup: Setup) -> Array:
        if name.lower().endswith(".csv"):
            return self._table(name, text, setup)[1]
        moves, _, _ = self._moves(name, text, setup)
        return np.vstack([m.path[-1] for m in moves]) if moves else np.zeros((0, len(setup.axes)))

    def rewrite(self, name: str, text: str, setup: Setup, correct: Correct) -> str:
        figures = self._figures(setup)
        if name.lower().endswith(".csv"):
            head, q = self._table(name, text, setup)
            rows = [",".join(f"{v:.{figures}f}" for v in row) for row in correct(q, _arrivals(q))]
            return "\n".join([",".join(head), *rows]) + "\n"
        moves, lines, offset = self._moves(name, text, setup)
        pieces, at = [], dict[int, str]()
        came = np.ones(len(setup.axes))
        for move in moves:
            sign = np.sign(np.diff(move.path, axis=0))
            came = np.where(sign[-1] != 0, sign[-1], came) if len(sign) else came
            path = move.path[1:] if move.rapid else _divided(move.path, came, correct)
            pieces.append(correct(path, np.tile(came, (len(path), 1))) - offset)
        shown: dict[str, str] = {}
        for move, piece in zip(moves, pieces, strict=True):
            out = []
            for k, row in enumerate(piece):
                cells = {n: f"{n}{v:.{figures}f}" for n, v in zip(setup.names, row, strict=True)}
                words = [c for n, c in cells.items() if shown.get(n) != c]
                shown.update(cells)
                out.append(" ".join([w for w in [move.words if not k else "", *words] if w]))
            at[move.line] = "\n".join(line for line in out if line)
        return "\n".join(at.get(k, line) for k, line in enumerate(lines)) + "\n"

    def checklist(self, setup: Setup) -> list[str]:
        return [
            "positions are those of the axes: give work offset and tool length as (ERRORMODEL OFFSET X.. Y.. Z..)",
            "switch off every compensation that was off when the survey was measured; no tool centre point control",
            "run the programme above the part first: positions differ from the old ones by micrometres only",
        ]

    def _table(self, name: str, text: str, setup: Setup) -> tuple[list[str], Array]:
        lines = Lines.of(name, text)
        head = [w.strip() for w in lines.lines[0][1].split(",")] if lines.lines else []
        if head != [a.joint for a in setup.axes]:
            raise lines.error(1, f"columns {', '.join(head)}", f"Write {','.join(a.joint for a in setup.axes)}")
        return head, np.array([lines.numbers(k, s, len(head), ",") for k, s in lines.lines[1:]]).reshape(-1, len(head))

    def _moves(self, name: str, text: str, setup: Setup) -> tuple[list[Move], list[str], Array]:
        lines = text.splitlines()
        offset = np.zeros(len(setup.axes))
        for words in OFFSET.findall(text):
            for letter, value in WORD.findall(words.upper()):
                offset[setup.place(letter)] = float(value)
        parsed = [WORD.findall(COMMENT.sub("", line).upper()) for line in lines]
        here = offset + _first(parsed, setup)
        moves: list[Move] = []
        motion, plane = 0.0, 17.0
        for k, words in enumerate(parsed):
            where = f"{name}, line {k + 1}"
            codes = [float(v) for c, v in words if c == "G"]
            if "TRAORI" in lines[k].upper() or any(g in REFUSED for g in codes):
                what = next((REFUSED[g] for g in codes if g in REFUSED), "tool centre point control (TRAORI)")
                raise InputError(where, what, "Write absolute positions of the axes in mm, cycles and radii worked out")
            plane = next((g for g in codes if g in PLANES), plane)
            motion = next((g for g in codes if g in (0.0, 1.0, 2.0, 3.0)), motion)
            axes = {c: float(v) for c, v in words if c in setup.names}
            still = not axes and not (motion > 1 and any(c in "IJK" for c, _ in words))
            if still or any(g in PASSED for g in codes):
                continue
            target = here.copy()
            for letter, value in axes.items():
                target[setup.place(letter)] = value + offset[setup.place(letter)]
            path = np.vstack([here, target])
            rest = [(c, v) for c, v in words if c not in setup.names]
            if motion > 1:
                path = _arc(where, here, target, dict(words), motion, PLANES[plane], setup)
                rest = [(c, v) for c, v in rest if c not in "IJKR" and (c, float(v)) not in (("G", 2.0), ("G", 3.0))]
                rest.append(("G", "1"))
                motion_word = 1.0
            else:
                motion_word = motion
            if not any(c == "G" and float(v) == motion_word for c, v in rest):
                rest.append(("G", f"{motion_word:g}"))
            comment = " ".join(COMMENT.findall(lines[k]))
            moves.append(
                Move(k, " ".join([*(f"{c}{v}" for c, v in rest), *([comment] if comment else [])]), motion == 0, path)
            )
            here = target
        return moves, lines, offset


def _first(parsed: list[list[tuple[str, str]]], setup: Setup) -> Array:
    """Where each axis stands before it is named: where the programme first sends it."""
    out = np.array([sum(a.measured) / 2 for a in setup.axes])
    for words in reversed(parsed):
        for letter, value in words:
            if letter in setup.names:
                out[setup.place(letter)] = float(value)
    return out


def _arrivals(q: Array) -> Array:
    """Directions from which rows of a table are reached."""
    step = np.sign(np.diff(q, axis=0, prepend=q[:1]))
    for k in range(1, len(step)):
        step[k] = np.where(step[k] == 0, step[k - 1], step[k])
    return np.where(step == 0, 1.0, step)


def _divided(path: Array, came: Array, correct: Correct) -> Array:
    """Ends of the pieces of a path (k, axes), short enough that the correction is straight along each."""
    middle = (path[1:] + path[:-1]) / 2
    full = np.vstack([path, middle])
    moved = correct(full, np.tile(came, (len(full), 1))) - full
    n = len(path)
    bend = np.abs(moved[n:] - (moved[1:n] + moved[: n - 1]) / 2).max(axis=1, initial=0.0)
    pieces = np.minimum(np.ceil(np.sqrt(bend / BEND)), LONGEST).astype(int)
    return np.vstack(
        [path[k] + (path[k + 1] - path[k]) * np.linspace(0, 1, max(p, 1) + 1)[1:, None] for k, p in enumerate(pieces)]
    )


def _arc(
    where: str, start: Array, end: Array, words: dict[str, str], motion: float, plane: tuple[str, ...], setup: Setup
) -> Array:
    """Chords of an arc or helix given by its centre."""
    i, j = setup.place(plane[0]), setup.place(plane[1])
    if plane[2] not in words and plane[3] not in words:
        raise InputError(where, "an arc without a centre", f"Write {plane[2]} and {plane[3]}")
    centre = np.array([start[i] + float(words.get(plane[2], 0)), start[j] + float(words.get(plane[3], 0))])
    a, b = start[[i, j]] - centre, end[[i, j]] - centre
    turn = float(np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b))
    if motion == 3.0 and turn <= 1e-9:
        turn += 2 * np.pi
    elif motion == 2.0 and turn >= -1e-9:
        turn -= 2 * np.pi
    radius = float(np.hypot(*a))
    step = 2 * np.arccos(max(1 - CHORD / max(radius, CHORD), 0.0))
    share = np.linspace(0, 1, int(np.ceil(abs(turn) / step)) + 1)
    out = start + share[:, None] * (end - start)
    size = radius + share * (float(np.hypot(*b)) - radius)
    angle = np.arctan2(a[1], a[0]) + share * turn
    out[:, i], out[:, j] = centre[0] + size * np.cos(angle), centre[1] + size * np.sin(angle)
    out[-1] = end
    return out
