"""Correction of a whole programme: parsed, corrected with and without the optional blocks, verified, written.

The switch of the optional blocks is taken to stay as it is while a programme runs. A programme whose positions were
corrected says so in a comment before its first command, and is not corrected again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.setup import Setup
from errormodel.controllers.text import Comment
from errormodel.controllers.turning import NOT_KNOWN, OPTION, in_words, is_lathe, x_counts
from errormodel.exceptions import InputError
from errormodel.gcode.calls import written_out
from errormodel.gcode.check import Deviation, checked
from errormodel.gcode.codes import Dialect
from errormodel.gcode.cycles import CYCLES, CycleWriter
from errormodel.gcode.detect import COMMENT_TEXT, dialect_of
from errormodel.gcode.divide import Correct
from errormodel.gcode.increments import in_plain_numbers
from errormodel.gcode.interpreter import Interpreter
from errormodel.gcode.reading import Reading
from errormodel.gcode.rewrite import rewritten
from errormodel.gcode.steps import Step
from errormodel.gcode.words import Block, lines_of, split

MARK = "corrected by errormodel"
COMMENTS = {False: Comment("(", ")", upper=True), True: Comment("; ")}  # of mills, of printers


@dataclass(frozen=True)
class Source:
    """A programme whose words are all known, with its dialect and offsets."""

    name: str
    dialect: Dialect
    blocks: list[Block]
    reading: Reading
    calls: int = 0  # that were written out
    holes: int = 0  # of canned cycles that were written out

    @classmethod
    def of(cls, name: str, text: str, reading: Reading) -> Source:
        """Parse a programme's text; calls of its subprogrammes are written out.

        Raises
        ------
        InputError
            A character, or the dialect, is not understood.
        """
        raw = lines_of(name, text)
        reading = reading.with_comment(name, text)
        dialect = dialect_of(reading.dialect, raw)
        if not any(b.text.strip() for b in raw):
            raise InputError(name, "the programme is empty", "Give a programme")
        raw, calls = written_out(raw, dialect)
        return cls(name, dialect, _blocks(raw, dialect), reading, calls)

    def without_cycles(self, setup: Setup) -> Source:
        """The programme with its canned cycles written out as single moves.

        Raises
        ------
        InputError
            A cycle is not certain, or depends on whether optional blocks are carried out.
        """
        if not any(c in CYCLES for b in self.blocks for c in b.codes("G")):
            return self
        found = []
        for switch in (True, False) if self.switched else (True,):
            writer = CycleWriter(Interpreter(self.dialect, setup, self.reading, self.blocks))
            parts = [[b] if b.optional and not switch else writer.block(b) for b in self.blocks]
            found.append((parts, writer.count))
        (parts, holes), other = found[0], found[-1][0]
        for block, one, two in zip(self.blocks, parts, other, strict=True):
            if not block.optional and [b.text for b in one] != [b.text for b in two]:
                what = "a canned cycle that depends on whether an optional block above is carried out"
                block.refuse(what, "Take the '/' away, or write the cycle as single moves")
        return replace(self, blocks=[b for part in parts for b in part], holes=holes)

    def steps(self, setup: Setup, optional: bool = True) -> list[Step]:
        """Steps of the blocks.

        Raises
        ------
        InputError
            A block is not understood, or leads where the machine does not reach.
        """
        return list(Interpreter(self.dialect, setup, self.reading, self.blocks).run(self.blocks, optional))

    def start(self, setup: Setup) -> Array:
        """Initial positions of the axes (axes,), NaN where unknown."""
        return Interpreter(self.dialect, setup, self.reading, self.blocks).q

    @property
    def switched(self) -> bool:
        """Whether there are optional blocks."""
        return any(b.optional for b in self.blocks)


@dataclass(frozen=True)
class Corrected:
    """A corrected programme, and notes on the result of its check."""

    text: str
    notes: tuple[str, ...] = ()


def corrected(name: str, text: str, setup: Setup, correct: Correct, reading: Reading, figures: int) -> Corrected:
    """Correct the positions of a programme, execute the result and compare it with the original.

    Parameters
    ----------
    figures : digits after the decimal point, of mm and degrees; inches get one more.

    Raises
    ------
    InputError
        A word is not understood, a position is not known or out of reach, or the check does not agree.
    """
    if any(len(n) > 1 for n in setup.names):
        raise InputError(name, f"axes {', '.join(setup.names)} are no letters of G-code", "Give a CSV of commands")
    source = Source.of(name, text, reading).without_cycles(setup)
    for block in source.blocks:
        if any(MARK in c.lower() for c in block.comments):
            block.refuse("a programme that compensate wrote: it is corrected already", "Give the plain one")
    runs = [
        _once(source, setup, correct, figures, switch) for switch in ((True, False) if source.switched else (True,))
    ]
    steps, lines, deviation = runs[0]
    last = 0
    for block, with_, without in zip(source.blocks, lines, runs[-1][1], strict=True):
        last = block.number if block.optional else last
        if not block.optional and with_ != without:
            found = f"this block depends on whether the optional block in line {last} is carried out"
            block.refuse(found, "Name all axes in a rapid behind the optional block, or take its '/' away")
    if any(part != [b.text] for part, b in zip(lines, source.blocks, strict=True)):
        first = next(k for k, b in enumerate(source.blocks) if not b.empty)
        mark = COMMENTS[source.dialect.printer].lines([f"{MARK} for {setup.machine}"])[:1]
        lines = [*lines[:first], mark, *lines[first:]]
    written = "\n".join(line for part in lines for line in part) + "\n"
    deviation = deviation.with_other(runs[-1][2])
    return Corrected(written, (deviation.text(name), *_notes(source, steps, setup)))


def _once(
    source: Source, setup: Setup, correct: Correct, figures: int, optional: bool
) -> tuple[list[Step], list[list[str]], Deviation]:
    steps = source.steps(setup, optional)
    lines = rewritten(steps, source.start(setup), setup, correct, figures, source.dialect.printer)
    again = Source(source.name, source.dialect, _split_again(source, lines), source.reading)
    sizes = [len(part) for part in lines]
    try:
        written = again.steps(setup, optional)
    except InputError as error:
        found = f"corrected, this line leads where the machine does not reach: {error.found}"
        cure = "Keep the programme farther from the ends of the travels than the correction, which is added to it"
        raise InputError(error.where.split(" (", 1)[0], found, cure) from error
    return steps, lines, checked(steps, written, sizes, setup, correct, figures)


def _split_again(source: Source, lines: Sequence[Sequence[str]]) -> list[Block]:
    """Parse the written lines again; a block keeps the number of its original line."""
    out = []
    for block, part in zip(source.blocks, lines, strict=True):
        for line in part:
            fresh = Block(source.name, block.number, line)
            passed = block.empty and not block.words and line == block.text
            out.append(block if passed else split(fresh, source.dialect.printer))
    return in_plain_numbers(out) if source.dialect.increments else out


def _blocks(raw: Sequence[Block], dialect: Dialect) -> list[Block]:
    """Blocks with their words; ``%`` and the programme's number must stand in their places."""
    full = [k for k, b in enumerate(raw) if COMMENT_TEXT.sub("", b.text).strip()]
    out, begun = [], False
    for k, block in enumerate(raw):
        text = block.text.strip()
        if text == "%" and not dialect.printer and k in (full[0], full[-1]):
            out.append(block)
            continue
        if not dialect.printer and not begun and text.upper().startswith(("O", ":")):
            number = text[1:].split("(", 1)[0].strip()
            rest = split(Block(block.file, block.number, text[1 + len(number) :]), False)
            if number.isdecimal() and number.isascii() and rest.empty:
                out.append(Block(block.file, block.number, block.text, comments=rest.comments))
                begun = True
                continue
        if text.upper().startswith(("O", ":")):
            block.refuse("a subprogramme or a programme's number", "Write one programme without calls")
        out.append(split(block, dialect.printer))
        if dialect.header and any(c.startswith(";") and c.strip("; \t") for c in out[-1].comments):
            block.refuse("text behind ';', which ends a block on these controls", "Write ( ) around comments")
        begun = begun or not out[-1].empty
    return in_plain_numbers(out) if dialect.increments else out


def _notes(source: Source, steps: Sequence[Step], setup: Setup) -> tuple[str, ...]:
    """Notes on assumptions and on what stays uncorrected."""
    steps = [s for s in steps if s.path is not None]
    if not steps:
        return (f"{source.name}: it moves no axis",)
    said = {c for b in source.blocks for c in b.codes("G")}
    granted = [
        word
        for word, others in (("G90", {"G90", "G91"}), ("G21", {"G20", "G21"}), ("G17", {"G17", "G18", "G19"}))
        if not said & others and (word != "G17" or said & {"G2", "G3"})
    ]
    if any(b.has(c) for b in source.blocks for c in "IJK") and not said & {"G90.1", "G91.1"}:
        granted.append("I, J, K from the start (G91.1)")
    out = list[str]()
    if x_counts(setup) == NOT_KNOWN and "G8" not in said and not source.dialect.printer:
        if is_lathe(setup):
            granted.append("X in radii (G8)")
        else:
            out.append(
                f"{source.name}: X is taken for radii ({OPTION} radii says so). This is {in_words(setup)}: where its "
                f"control counts X in diameters, these corrections are wrong"
            )
    if not steps[0].modes.origin and not source.reading.offsets:
        granted.append("positions of the axes (no work offset)")
    if granted:
        out.append(f"{source.name}: taken for granted, since it does not say: {', '.join(granted)}")
    if source.calls or source.holes:
        out.append(
            f"{source.name}: {source.calls} calls and {source.holes} holes of cycles are written out as single lines"
        )
    stated = [
        f"{name or 'the work offset'} {' '.join(f'{k}{v:g}' for k, v in place.items())}"
        for name, place in source.reading.offsets.items()
    ]
    if stated:
        out.append(f"{source.name}: corrected for {'; '.join(stated)}")
    x, y, z = setup.tool
    out.append(f"{source.name}: corrected for a tool whose tip lies at {x:g}, {y:g}, {z:g} mm (--tool)")
    never = [n for k, n in enumerate(setup.names) if n in setup.movers and not any(k in s.named for s in steps)]
    if never:
        out.append(
            f"{source.name}: {', '.join(never)} {'is' if len(never) == 1 else 'are'} never commanded, never moved"
        )
    plain = [s for s in steps if s.kind == "as it is"]
    if plain:
        why = _plain(plain[0], setup)
        first = f"first in line {plain[0].block.number}{f': {why}' if why else ''}"
        out.append(f"{source.name}: {len(plain)} positionings stay as they are ({first})")
    blind = [n for k, n in enumerate(setup.names) if n in setup.reversing and _blind(steps, k)]
    if blind:
        out.append(f"{source.name}: the direction from which {', '.join(blind)} first arrives is taken as positive")
    outside = [s.block.number for s in steps if outside_measured(s.q, setup)]
    if outside:
        out.append(f"{source.name}: {len(outside)} blocks leave the measured region (first in line {outside[0]})")
    return tuple(out)


def _plain(step: Step, setup: Setup) -> str:
    """Why a positioning stays as it is; empty: by a command with rules of its own."""
    if "G53" in step.block.codes("G"):
        return "G53 counts in machine coordinates"
    for place, when in ((step.q, "there"), (None if step.path is None else step.path.start, "before it")):
        unknown = [n for n, v in zip(setup.names, () if place is None else place, strict=False) if not np.isfinite(v)]
        if unknown:
            return f"the position of {', '.join(unknown)} is not known {when}, and errors depend on it"
    return ""


def _blind(steps: Sequence[Step], column: int) -> bool:
    """Whether a correction is made before the axis has moved in a known direction."""
    return any(
        s.kind != "as it is" and not s.came[column] and s.path is not None
        and not abs(s.path.end[column] - s.path.start[column]) > 0
        for s in steps
    )  # fmt: skip


def outside_measured(q: Array, setup: Setup) -> bool:
    """Whether a position (axes,) lies beyond the measured part of an axis that moved."""
    return any(
        a.name in setup.moving and np.isfinite(v) and not a.measured[0] - 1e-6 <= v <= a.measured[1] + 1e-6
        for a, v in zip(setup.axes, q, strict=True)
    )
