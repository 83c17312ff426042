"""Programmes as lists of commands: where the axes stand at each dwell, from which side and at which feed they came.

A pose is where the programme waits (G4) or stops (M0, M1); in a programme that does neither, the end of each block that
moves an axis. Moves between them, such as overruns, tell the side of arrival.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from errormodel.exceptions import InputError
from errormodel.raw_formats.base import Asked, RawFile, Recording

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.controllers.setup import Setup
    from errormodel.gcode.programme import Source
    from errormodel.gcode.reading import Reading
    from errormodel.gcode.steps import Step
    from errormodel.gcode.words import Block
    from errormodel.machine import Machine

_WAITS = ("G4",)
_STOPS = ("M0", "M1")
_COMMENT = re.compile(r"\([^()\n]*\)|;.*")
_END = re.compile(r"(?<![A-Z0-9])M0*(2|30|17|99)(?![\d.])|END +PGM|^\s*(N\d+ +)?RET\b|\n\s*%\s*$", re.IGNORECASE)
NO_END = "the programme has no end (M30, M2, END PGM)"
TRAVEL_SLACK = 1e-6  # mm or degrees
MOST_OTHER = 0.2  # of the lines of a programme may be something else before it is taken for another file
SAME_PLACE = 1e-9  # mm or degrees: round-off of a position that is commanded again


@dataclass(frozen=True)
class Programme:
    """A programme as the interpreter executed it.

    Attributes
    ----------
    ways : (block's number, axis): how a rotary axis turns there: 1, -1, or 0 the shorter way; else as its numbers say.
    """

    setup: Setup
    source: Source
    ways: Mapping[tuple[int, str], int] = field(default_factory=dict)


def setup_and_reading(raw: RawFile, asked: Asked, dialect: str) -> tuple[Setup, Reading]:
    """The axes of the machine whose programme it is, and what the user states of it.

    Raises
    ------
    InputError
        There is no machine, or an option cannot be read.
    """
    from errormodel.gcode.reading import Reading

    if asked.machine is None:
        raise InputError(raw.name, "an NC programme, and no machine", "Give the machine whose axes it moves")
    return plain_setup(asked.machine), Reading.of(dialect, asked.offsets, asked.at)


def recording_of(raw: RawFile, programme: Programme) -> Recording:
    """Poses of a programme, in mm and degrees of the axes.

    Raises
    ------
    InputError
        A block is not understood, or where an axis stands is not known.
    """
    from errormodel.controllers.turning import in_words, spindle_of

    setup, source = programme.setup, programme.source
    # ways between poses may leave the travels of machine.yaml, as to the place of the tool change
    free = replace(setup, axes=tuple(replace(a, travel=(-np.inf, np.inf)) for a in setup.axes))
    frame, lines, again, notes = _poses(raw, programme, source.steps(free))
    units = {a.joint: "deg" if a.rotary else "mm" for a in setup.axes}
    if spindle_of(setup) is not None:
        notes.append(f"X taken as radii, for {in_words(setup)}: write a programme in diameters in radii")
    if source.switched:
        notes.append("blocks behind '/' taken as carried out")
    return Recording(frame, units | {"feed": "mm/min"}, tuple(lines), (*raw.notes, *notes), again=tuple(again))


def recording_of_blocks(
    raw: RawFile, title: str, setup: Setup, reading: Reading, blocks: list[Block], ways: Mapping[tuple[int, str], int]
) -> Recording:
    """Poses of blocks that were put into words of RS274/NGC from the language `title`; `ways` as `Programme.ways`.

    Raises
    ------
    InputError
        As `recording_of`.
    """
    from errormodel.gcode.codes import DIALECTS
    from errormodel.gcode.programme import Source

    dialect = replace(DIALECTS["iso"], title=title)
    return recording_of(raw, Programme(setup, Source(raw.name, dialect, blocks, reading), ways))


@dataclass
class ProgrammeZero:
    """What displaces the zero of a programme by an amount that only the user knows.

    Attributes
    ----------
    stated : whether he states it.
    tool : the tool that is in the spindle and counts, empty without one.
    preset : what else displaces the zero, in words.
    origin : its name in ``--offset``, such as ``G54=``; empty: that which is active.
    used : tools with which positions were commanded.
    """

    stated: bool
    tool: str = ""
    preset: str = ""
    origin: str = ""
    used: set[str] = field(default_factory=set)

    def check(self, block: Block) -> None:
        """Check the zero of a block that moves.

        Raises
        ------
        InputError
            It is not known, or not the same as before.
        """
        what = " and ".join(w for w in (self.tool and f"the length of the tool {self.tool}", self.preset) if w)
        if what and not self.stated:
            where = "where the programme's zero is on the axes, with the tool in the spindle"
            block.refuse(f"a position that depends on {what}", f"Write --offset {self.origin}X..,Y..,Z..: {where}")
        self.used |= {self.tool} - {""}
        if len(self.used) > 1:
            found = f"positions with the tools {' and '.join(sorted(self.used))}, whose lengths are not known here"
            block.refuse(found, "Give a programme for each tool, or positions of the axes")


def plain_setup(machine: Machine) -> Setup:
    """A machine in terms of the axes of a programme.

    Raises
    ------
    InputError
        Which letter a joint has is not certain.
    """
    from errormodel.chain import Chain
    from errormodel.controllers.axes import axis_letters, directions_at_zero
    from errormodel.controllers.setup import Axis, Setup
    from errormodel.controllers.turning import RADII, spindle_of

    along = directions_at_zero(machine, Chain(machine))
    letters, unsure = axis_letters(machine.joints, along, {})
    if unsure:
        found = f"which letter the joint {unsure[0]} has in a programme is not certain"
        raise InputError("machine", found, "Name the joints in machine.yaml by their letters")
    axes = []
    for letter, joint, line in zip(letters, machine.joints, along, strict=True):
        rotary = joint.type == "rotary"
        low, high = np.degrees(joint.travel).tolist() if rotary else joint.travel
        x, y, z = line.tolist()
        axes.append(Axis(letter, joint.name, rotary, (low, high), (low, low), (x, y, z)))
    setup = Setup(machine.name, tuple(axes), ())
    return replace(setup, x_stated=RADII) if spindle_of(setup) else setup  # a note says so


def _poses(
    raw: RawFile, programme: Programme, steps: list[Step]
) -> tuple[pd.DataFrame, list[int], list[int], list[str]]:
    """Commands at each pose, their lines, rows that were waited at again, and notes."""
    import pandas as pd

    from errormodel.gcode.extruder import INCH_MM

    setup = programme.setup
    waits = any(_waiting(step) for step in steps)
    rows: list[dict[str, float]] = []
    lines: list[int] = []
    came = np.zeros(len(setup.axes))
    feed, moved, named = np.nan, False, False
    again: list[int] = []
    before = np.full(len(setup.axes), np.nan)
    for step in steps:
        if step.block.has("F") and step.modes.feed == "G94":
            feed = float(step.block.number_of("F") or np.nan) * (INCH_MM if step.modes.inch else 1.0)
        if step.path is not None:
            ends = step.path.at(step.path.corners()[-2:])
            last = ends[-1] - ends[0]
            came = np.where(np.abs(last) > SAME_PLACE, np.sign(last), came)
            for k in step.named:
                way = programme.ways.get((step.block.number, setup.names[k]))
                if way is not None and abs(last[k]) > SAME_PLACE:
                    came[k] = way or np.sign((last[k] + 180.0) % 360.0 - 180.0)
            changed = np.abs(step.q - before) > SAME_PLACE
            moved = moved or bool((changed | np.isnan(before))[list(step.named)].any())
            before, named = step.q.copy(), True
        if waits and _waiting(step):
            if rows and named and not moved:  # commanded again, and waited again, where it stood
                again.append(len(rows) - 1)
            named = False
        if not moved or (waits and not _waiting(step)) or (not waits and step.path is None):
            continue
        unknown = [a.name for a, q in zip(setup.axes, step.q, strict=True) if not np.isfinite(q)]
        if unknown:
            found = f"where {', '.join(unknown)} stand{'s' * (len(unknown) == 1)} is not known"
            letter = unknown[0]
            cure = f"Say where the axes stand at the beginning, such as --at start={letter}0, or move {letter} first"
            step.block.refuse(found, cure)
        _check_travels(setup, step)
        rows.append(_row(setup, step.q, came, feed))
        lines.append(step.block.number)
        moved = False
    if not rows:
        raise InputError(raw.name, "a programme that moves no axis", "Give the programme that was measured")
    how = "dwells and stops" if waits else "ends of blocks: it neither waits (G4) nor stops (M0)"
    frame = pd.DataFrame(rows)
    for axis in setup.axes:  # before its first move the side of an axis is not known
        name = f"dir_{axis.joint}"
        frame[name] = frame[name].replace(0.0, np.nan)
    if frame["feed"].isna().any():
        frame = frame.drop(columns=["feed"])
    zero = "" if programme.source.reading.offsets else ", taken as positions of the axes"
    notes = [f"{len(rows)} poses at {how}{zero}"]
    if not programme.source.dialect.printer and not _END.search(_COMMENT.sub(" ", raw.text or "")):
        notes.append(f"{NO_END}: it may have been cut off")
    if again:
        count = len(again)
        notes.append(f"{count} dwell{'s' * (count > 1)} at the place of the dwell before, counted as one pose with it")
    return frame, lines, again, notes


def _check_travels(setup: Setup, step: Step) -> None:
    """InputError where a pose lies beyond the travel of an axis."""
    for axis, q in zip(setup.axes, step.q, strict=True):
        low, high = axis.travel
        if not low - TRAVEL_SLACK <= q <= high + TRAVEL_SLACK:
            found = f"{axis.name} at {q:.4f} (position of the axis), beyond its travel {low:g} to {high:g}"
            step.block.refuse(found, "Correct the position, or give the offset that is active as --offset")


def _waiting(step: Step) -> bool:
    codes = {*step.block.codes("G"), *step.block.codes("M")}
    return bool(codes & {*_WAITS, *_STOPS})


def _row(setup: Setup, q: np.ndarray, came: np.ndarray, feed: float) -> dict[str, float]:
    row = {axis.joint: float(v) for axis, v in zip(setup.axes, q, strict=True)}
    return row | {f"dir_{a.joint}": float(c) for a, c in zip(setup.axes, came, strict=True)} | {"feed": float(feed)}
