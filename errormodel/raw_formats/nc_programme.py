"""NC programmes as lists of commands: where the axes stand at each dwell, from which side and at which feed they came.

A pose is where the programme waits (G4) or stops (M0, M1); in a programme that does neither, the end of each block that
moves an axis. Moves between them, such as overruns, tell the side of arrival.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from errormodel.exceptions import InputError
from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.controllers.setup import Setup
    from errormodel.gcode.steps import Step
    from errormodel.machine import Machine

_BLOCK = re.compile(r"\s*/?\s*(?:[NO]\d+\s*)?(?:[A-Z]=?\s*[-+]?(?:\d+(?:\.\d*)?|\.\d+)\s*)*$", re.IGNORECASE)
_MOTION = re.compile(r"(?<![A-Z])G0*[0-3](?![\d.])", re.IGNORECASE)
_COMMENT = re.compile(r"\([^()]*\)|;.*$")
_WAITS = ("G4",)
_STOPS = ("M0", "M1")
SAME_PLACE = 1e-9  # mm or degrees: round-off of a position that is commanded again
MOST_OTHER = 0.2  # of the lines of a programme may be something else before it is taken for another file


class NcProgramme(RawFormat):
    """Commands of a programme in mm and degrees of the axes, as the interpreter of ``compensate`` reads it."""

    name = "nc-programme"
    title = "an NC programme"
    source = "NIST IR 6556 (RS274/NGC), and the dialects of errormodel.gcode"
    seen = True
    uses = ("offsets", "at", "dialect")

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        if raw.text is None:
            return False
        lines = [_COMMENT.sub(" ", line).strip() for line in raw.lines]
        lines = [line for line in lines if line and line != "%"]
        blocks = sum(bool(_BLOCK.fullmatch(line)) for line in lines)
        return bool(lines) and blocks >= (1 - MOST_OTHER) * len(lines) and any(map(_MOTION.search, lines))

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        from errormodel.gcode.programme import Source
        from errormodel.gcode.reading import Reading

        if asked.machine is None:
            raise InputError(raw.name, "an NC programme, and no machine", "Give the machine whose axes it moves")
        setup = plain_setup(asked.machine)
        reading = Reading.of(asked.dialect, asked.offsets, asked.at)
        source = Source.of(raw.name, raw.text or "", reading)
        steps = source.steps(setup)
        frame, lines, notes = _poses(raw, setup, steps)
        units = {a.joint: "deg" if a.rotary else "mm" for a in setup.axes}
        if source.switched:
            notes.append("blocks behind '/' taken as carried out")
        return Recording(frame, units | {"feed": "mm/min"}, tuple(lines), (*raw.notes, *notes))


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
    return Setup(machine.name, tuple(axes), ())


def _poses(raw: RawFile, setup: Setup, steps: list[Step]) -> tuple[pd.DataFrame, list[int], list[str]]:
    """Commands at each pose, their lines, and notes."""
    import pandas as pd

    from errormodel.gcode.extruder import INCH_MM

    waits = any(_waiting(step) for step in steps)
    rows: list[dict[str, float]] = []
    lines: list[int] = []
    came = np.zeros(len(setup.axes))
    feed, moved, again, named = np.nan, False, 0, False
    before = np.full(len(setup.axes), np.nan)
    for step in steps:
        if step.block.has("F") and step.modes.feed == "G94":
            feed = float(step.block.number_of("F") or np.nan) * (INCH_MM if step.modes.inch else 1.0)
        if step.path is not None:
            ends = step.path.at(step.path.corners()[-2:])
            last = ends[-1] - ends[0]
            came = np.where(np.abs(last) > SAME_PLACE, np.sign(last), came)
            changed = np.abs(step.q - before) > SAME_PLACE
            moved = moved or bool((changed | np.isnan(before))[list(step.named)].any())
            before, named = step.q.copy(), True
        if waits and _waiting(step):
            again += named and not moved  # commanded again, and waited again, where it stood
            named = False
        if not moved or (waits and not _waiting(step)) or (not waits and step.path is None):
            continue
        unknown = [a.name for a, q in zip(setup.axes, step.q, strict=True) if not np.isfinite(q)]
        if unknown:
            found = f"where {', '.join(unknown)} stands is not known"
            letter = unknown[0]
            cure = f"Say where the axes stand at the beginning, such as --at start={letter}0, or move {letter} first"
            step.block.refuse(found, cure)
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
    notes = [f"{len(rows)} poses at {how}"]
    if again:
        notes.append(f"{again} dwell{'s' * (again > 1)} at the place of the dwell before, counted as one pose with it")
    return frame, lines, notes


def _waiting(step: Step) -> bool:
    codes = {*step.block.codes("G"), *step.block.codes("M")}
    return bool(codes & {*_WAITS, *_STOPS})


def _row(setup: Setup, q: np.ndarray, came: np.ndarray, feed: float) -> dict[str, float]:
    row = {axis.joint: float(v) for axis, v in zip(setup.axes, q, strict=True)}
    return row | {f"dir_{a.joint}": float(c) for a, c in zip(setup.axes, came, strict=True)} | {"feed": float(feed)}
