"""Writing of a programme with corrected positions.

What is written, and what is not:

- a line that moves no axis, and a positioning whose correction is not known, stays as it is, to the letter;
- a rapid of a mill stays one rapid with the axis words that it had, corrected at its end; none is added (its path is
  the control's own). A printer's G0 is a straight move as G1 is, and is corrected as a cut;
- a cut is divided where the correction bends, an arc into chords. It gets words of further axes only if the programme
  commanded them before, their position is known, and their correction changes;
- where the axes do not stand where a cut's correction begins (behind a rapid that did not name them, where an axis
  turns back), a first block of micrometres brings them there at the cut's own feed;
- extrusion and the time of G93 are shared out by length.

Source: NIST IR 6556, sections 3.5 (G codes), 3.8 (order of execution).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.setup import Setup
from errormodel.gcode.codes import STOP_CODES
from errormodel.gcode.divide import Correct, Run, directions, divided, known, reasonable
from errormodel.gcode.extruder import INCH_MM
from errormodel.gcode.steps import Step, stops_exactly

# mm or deg: permitted distance of the axes from the start of a cut's correction; by judgement
TAKE_UP_TOLERANCE = 0.0005
PATH_WORDS = frozenset("IJKR")  # words of arcs
PATH_CODES = frozenset({"G0", "G1", "G2", "G3"})  # rapid, straight cut, arcs
MOST_STRETCH = 0.1  # permitted relative change of the length in X, Y, Z where other axes move as well; by judgement


@dataclass(frozen=True)
class Piece:
    """A line to write: commands of the axes, and shares of the block's length at both ends and of its time."""

    target: Array
    share: float
    time: float
    last: bool
    begin: float = 0.0


class Writer:
    """Writer of the steps of one programme in order; it tracks the positions that the written programme reaches."""

    def __init__(self, setup: Setup, figures: int, printer: bool) -> None:
        self.names = setup.names
        self.setup, self.figures, self.printer = setup, figures, printer
        self.linear = np.array([not a.rotary for a in setup.axes])
        self.at = np.full(len(setup.axes), np.nan)
        self.motion = ""

    def lines(self, step: Step, runs: Sequence[Run], rapid: Array | None) -> list[str]:
        """Lines that replace a block; `rapid` (axes,) is the corrected end of a rapid."""
        lines = self._lines(step, runs, rapid)
        self.at[~np.isfinite(step.q)] = np.nan
        return lines

    def _lines(self, step: Step, runs: Sequence[Run], rapid: Array | None) -> list[str]:
        if step.kind == "as it is":
            self._follow(step)
            return [step.block.text]
        pieces = [Piece(rapid, 1.0, 1.0, True)] if rapid is not None else list(self._pieces(step, runs))
        if len(pieces) > 1:
            self._divisible(step)
        out: list[str] = []
        begin = time = 0.0
        for piece in pieces:
            time += piece.time
            axes = self._axes(step, piece)
            if axes or piece.last:  # less than the last digit is added to the next piece
                whole = replace(piece, begin=begin, time=time)
                out.append(self._line(step, whole, axes, not out, len(pieces) > 1))
                begin, time = piece.share, 0.0
        self.motion = "G0" if step.modes.motion == "G0" else "G1"
        return out

    def start(self, q: Array) -> None:
        """Set the positions of the axes at the start of the programme."""
        self.at = q.copy()

    def _follow(self, step: Step) -> None:
        """Track the motion of a line that stays unchanged."""
        for k in (*step.named, *step.placed):
            if step.path is None or step.modes.absolute:
                self.at[k] = step.q[k]
            else:
                self.at[k] += step.q[k] - step.path.start[k]
        own = [g for g in step.block.codes("G") if g in PATH_CODES or g == "G80"]
        self.motion = own[0] if own else self.motion

    def _pieces(self, step: Step, runs: Sequence[Run]) -> Iterator[Piece]:
        path = step.path
        movable = [k for k in step.movable if self.names[k] in self.setup.movers]
        if path is None:
            raise ValueError("a cut has a path")
        length = path.length
        targets: list[tuple[Array, float, float]] = []
        at = self.at
        for run in runs:
            gap = np.zeros(len(at))
            gap[movable] = (run.corrected[0] - at)[movable]
            if np.abs(gap).max() > max(TAKE_UP_TOLERANCE, 1.01 * self._quantum(step)):
                targets.append((run.corrected[0], float(run.share[0]), float(np.linalg.norm(gap))))
            inner = zip(run.corrected[1:], run.share[1:], np.diff(run.share), strict=True)
            targets += [(q, float(s), float(d * length)) for q, s, d in inner]
            at = run.corrected[-1]
        if not length:
            targets = targets[-1:]
        total = sum(d for *_, d in targets) or 1.0
        for k, (q, share, size) in enumerate(targets):
            yield Piece(q, share, size / total, k == len(targets) - 1)
        self._feeds(step, runs)

    def _quantum(self, step: Step) -> float:
        return 0.5 * 10.0 ** -self._figures(step) * (INCH_MM if step.modes.inch else 1.0)

    def _figures(self, step: Step) -> int:
        return self.figures + 1 if step.modes.inch else self.figures

    def _feeds(self, step: Step, runs: Sequence[Run]) -> None:
        """Check that F keeps its meaning: it counts along X, Y, Z where any of them moves.

        Source: NIST IR 6556, section 2.1.2.5; LinuxCNC manual, "Feed rate" (U, V, W and A, B, C only without them).
        """
        if step.modes.feed == "G93" or step.path is None:
            return
        first = np.isin(self.names, ["X", "Y", "Z"])
        if not (np.abs(step.path.end - step.path.start)[~first] > 1e-9).any():
            return
        for run in runs:
            asked = np.linalg.norm(np.diff(step.path.at(run.share), axis=0)[:, first], axis=1)
            moved = np.diff(run.corrected, axis=0)[:, first]
            sent = np.linalg.norm(moved, axis=1)
            if (np.abs(sent - asked) > MOST_STRETCH * asked + 1e-9).any():
                found = "a feed of other axes than X, Y, Z that a correction of these would change"
                step.block.refuse(found, "Write this cut in inverse time (G93)")

    def _divisible(self, step: Step) -> None:
        for code in step.block.codes("M"):
            if code in ("M5", "M9", "M19"):
                step.block.refuse(f"{code} in a cut that has to be divided", f"Write {code} in a block of its own")
        if stops_exactly(step):
            step.block.refuse("a cut to be divided under an exact stop (G9, G61, G61.1)", "Write G64 for it")
        if step.block.has("E") and not step.spread:
            found = "whether E counts absolutely is not certain, and the cut has to be divided"
            step.block.refuse(found, "Write M82 or M83 behind the last G90 or G91")
        if step.block.has("E") and step.spread == "absolute" and not np.isfinite(step.extruded[0]):
            step.block.refuse("where the extruder stands is not known, and the cut has to be divided", "Write G92 E0")

    def _line(self, step: Step, piece: Piece, axes: Sequence[str], first: bool, divided: bool) -> str:
        block = step.block
        code = "G0" if step.modes.motion == "G0" else "G1"
        words = []
        for word in block.words:
            if word.letter in self.names or word.letter in PATH_WORDS or word.letter == "E":
                continue
            if word.letter == "G" and word.code in PATH_CODES:
                words += [str(word) if word.code == code else code] if first else []
            elif word.letter == "F" and step.modes.feed == "G93" and divided:
                words.append(f"F{_plain(word.value / piece.time if piece.time else word.value)}")
            elif word.letter == "M" and word.code in STOP_CODES:
                words += [str(word)] if piece.last else []
            elif first:
                words.append(str(word))
        said = any(w.letter == "G" and w.code in PATH_CODES for w in block.words)
        if (self.printer and not (first and said)) or (first and not said and self.motion != code):
            words.insert(0 if self.printer else len(words), code)
        words += axes
        if block.has("E"):
            words.append(self._extrusion(step, piece, divided))
        head = ("/" if block.optional else "") + (f"{block.label} " if block.label and first else "")
        tail = " ".join(block.comments) if first else ""
        return (head + " ".join([*words, *([tail] if tail else [])])).rstrip(" ")

    def _axes(self, step: Step, piece: Piece) -> list[str]:
        """Words of the axes that move, and at the end those of the axes that the block names."""
        out, figures = [], self._figures(step)
        further = () if step.kind == "rapid" else step.movable
        for k, name in enumerate(self.names):
            if k not in step.named and not (k in further and name in self.setup.movers):
                continue
            unit = INCH_MM if step.modes.inch and self.linear[k] else 1.0
            base = step.shift[k] if step.modes.absolute else self.at[k]
            text = f"{(piece.target[k] - base) / unit:.{figures}f}"
            text = text[1:] if text.startswith("-") and not float(text) else text
            reached = base + float(text) * unit
            if (piece.last and k in step.named) or not abs(reached - self.at[k]) < 1e-9:
                out.append(f"{name}{text}")
                self.at[k] = reached
        return out

    def _extrusion(self, step: Step, piece: Piece, divided: bool) -> str:
        text = next(w.text for w in step.block.words if w.letter == "E")
        if not divided or (piece.last and step.spread == "absolute"):
            return f"E{text}"
        figures = max(5, len(text.partition(".")[2]))
        unit = INCH_MM if step.modes.inch else 1.0
        value, before = float(text), step.extruded[0] / unit
        if step.spread == "absolute":
            return f"E{before + piece.share * (value - before):.{figures}f}"
        return f"E{round(value * piece.share, figures) - round(value * piece.begin, figures):.{figures}f}"


def _plain(value: float) -> str:
    """A number in plain digits, nine of them significant."""
    text = np.format_float_positional(value, precision=9, fractional=False, trim="0")
    return str(text)


def rewritten(
    steps: Sequence[Step], start: Array, setup: Setup, correct: Correct, figures: int, printer: bool
) -> list[list[str]]:
    """Lines that replace each step.

    Parameters
    ----------
    start : (axes,) initial positions, NaN where unknown.
    figures : digits after the decimal point, of mm and degrees.

    Raises
    ------
    InputError
        A block cannot be corrected.
    """
    cuts = [s for s in steps if s.kind == "feed"]
    runs = dict(zip(map(id, cuts), divided(cuts, setup, correct), strict=True))
    ends = _rapid_ends([s for s in steps if s.kind == "rapid"], setup, correct)
    writer = Writer(setup, figures, printer)
    writer.start(start)
    return [writer.lines(s, runs.get(id(s), ()), ends.get(id(s))) for s in steps]


def _rapid_ends(steps: Sequence[Step], setup: Setup, correct: Correct) -> dict[int, Array]:
    """Corrected ends of rapids; unknown positions that have no effect stay unknown."""
    if not steps:
        return {}
    ends = np.array([s.q for s in steps])
    came = np.array([directions(s.came, known(s.q - _begin(s))) for s in steps])
    moved = correct(known(ends), came) - known(ends)
    for step, row in zip(steps, moved, strict=True):
        reasonable(step, row[None], setup)
    return {id(s): e + m for s, e, m in zip(steps, ends, moved, strict=True)}


def _begin(step: Step) -> Array:
    return step.q if step.path is None else step.path.start
