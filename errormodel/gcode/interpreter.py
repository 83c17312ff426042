"""Interpreter of programmes: executes block by block, gives positions of the axes, and refuses unknown positions.

Sources: NIST IR 6556, section 3.8 and table 8 (order of execution in a block); LinuxCNC manual, "G codes"; Marlin
documentation, G0 to G3, G28, G90 to G92, M82, M83.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.setup import Setup
from errormodel.controllers.turning import DIAMETERS, NOT_KNOWN, OPTION, RADII, in_words, is_lathe, x_counts
from errormodel.exceptions import InputError
from errormodel.gcode import grammar
from errormodel.gcode.codes import END_CODES, PLANES, Dialect
from errormodel.gcode.extruder import INCH_MM, Extruder
from errormodel.gcode.grammar import Codes
from errormodel.gcode.origins import Origins
from errormodel.gcode.paths import Line, arc_of, centre_by_radius
from errormodel.gcode.reading import START, STAY, UNKNOWN, Reading
from errormodel.gcode.steps import Kind, Modes, Step
from errormodel.gcode.words import Block


class Interpreter:
    """Execution of blocks of one dialect on one machine."""

    def __init__(self, dialect: Dialect, setup: Setup, reading: Reading, blocks: Sequence[Block]) -> None:
        _check_radii(dialect, setup, blocks)
        self.dialect, self.setup, self.reading = dialect, setup, reading
        self.modes = Modes()
        self.names, self.count = setup.names, len(setup.axes)
        self.feed_of = ""  # feed mode of the last F
        self.origins = Origins.of(setup, reading, dialect, blocks)
        self.columns = {n: setup.place(n) for n in self.names}
        needed = {*setup.moving, *setup.movers}
        self.needed = [k for n, k in self.columns.items() if n in needed]
        self.linear = np.array([not a.rotary for a in setup.axes])
        self.q = self._place(START) if START in reading.after else np.full(self.count, np.nan)
        self.came = np.zeros(self.count)
        self.commanded: frozenset[int] = frozenset()
        self.lost: dict[int, str] = {}  # reasons why positions of axes are unknown, by column
        self.extruder = Extruder()
        self.extrudes = any(b.has("E") for b in blocks)

    def run(self, blocks: Sequence[Block], optional: bool = True) -> Iterator[Step]:
        """Steps of the blocks, one each; without `optional` blocks those are skipped."""
        ended: Block | None = None
        codes = [Codes() if b.empty else grammar.check(b, self.dialect, self.names, self.reading.after) for b in blocks]
        for block, code in zip(blocks, codes, strict=True):
            if block.empty or (block.optional and not optional):
                yield self._still(block)
                continue
            if ended:
                block.refuse(f"it is behind the programme's end (line {ended.number})", "Take it out")
            yield self.step(block, code)
            if END_CODES & {*block.codes("M")} and not self.dialect.printer:
                ended = block

    def _still(self, block: Block, placed: tuple[int, ...] = ()) -> Step:
        return Step(block, self.modes, placed=placed, came=self.came.copy(), q=self.q.copy(), shift=self._zero())

    def _zero(self) -> Array:
        return np.zeros(self.count)

    def _place(self, event: str) -> Array:
        stated = self.reading.after[event]
        out = np.full(self.count, np.nan)
        if not isinstance(stated, str):
            for letter, value in stated.items():
                out[self.setup.place(letter)] = value
        return out

    def modes_of(self, codes: Codes) -> Modes:
        """Modal state behind the codes of the next block."""
        return grammar.modes_behind(self.modes, codes)

    def programme_position(self, block: Block, letter: str) -> float:
        """Where an axis stands, in the units of the programme and from its origin.

        Raises
        ------
        InputError
            It is not known.
        """
        k = self.columns.get(letter)
        if k is None:
            block.refuse(f"the machine has no axis {letter}", "Write lines")
        if not np.isfinite(self.q[k]):
            self._unknown(block, self.q, (k,))
        return float((self.q[k] - self._shift(block)[k]) / self._unit(k))

    def step(self, block: Block, codes: Codes) -> Step:
        """Execute the next block; `codes` are those that `grammar.check` found in it."""
        self.modes = grammar.modes_behind(self.modes, codes)
        if block.has("F"):
            self.feed_of = self.modes.feed
        if codes.event:
            return self._event(block, codes.event)
        self.extruder.count(codes)
        if block.extended or "G4" in codes or "G92" in codes:
            if "G92" in codes:
                self.extruder.set(block)
            return self._still(block)
        named = tuple(self.columns[n] for n in self.names if block.has(n))
        if "tool length" in codes.groups:
            self._tool_length(block, named)
        circle = self.modes.motion in ("G2", "G3") and any(block.has(c) for c in "IJK")
        if self.dialect.printer and block.words[0].letter != "G":
            return self._still(block)
        if not named and not circle:
            grammar.no_path_words(block)
            self.extruder.move(block, self.modes.inch)
            return self._still(block)
        return self._move(block, named)

    def _event(self, block: Block, name: str) -> Step:
        """Execute a command that moves axes by rules of its own."""
        which = tuple(range(self.count))
        if name in ("G28", "G30"):
            which = tuple(self.columns[n] for n in self.names if block.has(n)) or which
            if not self.dialect.printer:
                self._by_way(block)
        stated = self.reading.after.get(name, UNKNOWN)
        if stated != STAY:
            place = self._place(name) if name in self.reading.after else np.full(self.count, np.nan)
            for k in which:
                self.q[k] = place[k]
                self.came[k] = 0.0
                self.lost[k] = f"{name} in line {block.number}"
            self._travels(block)
        return self._still(block, which if stated != STAY else ())

    def _by_way(self, block: Block) -> None:
        """Check the intermediate point of G28, which must be the present or a known position."""
        shift = self._shift(block) if self.modes.absolute else self._zero()
        for n, k in self.columns.items():
            value = block.number_of(n)
            if value is None:
                continue
            if not self.modes.absolute and value:
                block.refuse(f"{n} runs through another point before it returns", f"Write G91 and {n}0")
            if self.modes.absolute:
                self._inside(block, k, value * self._unit(k) + shift[k])

    def _unit(self, column: int) -> float:
        return INCH_MM if self.modes.inch and self.linear[column] else 1.0

    def _shift(self, block: Block) -> Array:
        return self.origins.shift(block, self.modes.origin, self.modes.tool)

    def _tool_length(self, block: Block, named: tuple[int, ...]) -> None:
        """Check G43 and G49: without a Z of their own some controls move Z at once, others with the next Z."""
        height = self.columns.get("Z")
        name = self.origins.tool(block) if "G43" in block.codes("G") else ""
        if name == self.modes.tool:
            return
        self.modes = replace(self.modes, tool=name)
        if height in named and height is not None:
            if self.modes.motion != "G0" or not self.modes.absolute:
                how = f"while {self.modes.motion} is in force" if self.modes.absolute else "with an incremental Z (G91)"
                how = how if self.modes.motion else "in a block whose motion (G0, G1) nothing states"
                block.refuse(f"a tool length that changes {how}", "Write G43 in a block with G90 G0 Z")
        elif height is not None:
            self.q[height] = np.nan
            self.lost[height] = f"the change of tool length in line {block.number}"

    def _move(self, block: Block, named: tuple[int, ...]) -> Step:
        modes, own = self.modes, "G53" in block.codes("G")
        if modes.motion not in ("G0", "G1", "G2", "G3"):
            block.refuse("positions without G0, G1, G2 or G3", "Write how it moves")
        if modes.motion in ("G0", "G1"):
            grammar.no_path_words(block)
        if own and ("G0" not in block.codes("G") or not modes.absolute):
            block.refuse("G53 that is no absolute rapid of its own", "Write G90 and G0 G53")
        shift = self._zero() if own else self._shift(block)
        start, end = self.q.copy(), self.q.copy()
        for k in named:
            value = float(block.number_of(self.names[k]) or 0.0) * self._unit(k)
            end[k] = value + shift[k] if modes.absolute else end[k] + value
        if modes.motion in ("G2", "G3"):
            named = tuple(sorted({*named, *self._plane(block)}))
        rapid = modes.motion == "G0"
        travelling = self.dialect.printer and self.extrudes and not block.has("E") and modes.motion in ("G0", "G1")
        commanded = self.commanded | {*named}
        kind: Kind = "rapid" if rapid and not self.dialect.printer else "feed"
        whole = bool(np.isfinite(end[[*self.needed, *named]]).all())
        started = bool(np.isfinite(start[[*self.needed, *named]]).all())
        if own or ((rapid or travelling) and not (whole and (kind == "rapid" or started))):
            kind = "as it is"  # nothing is added to a positioning whose correction is not known
        elif kind == "feed" and not (whole and started):
            if self.needed or modes.motion not in ("G0", "G1"):
                self._unknown(block, start if not started else end, named)
            kind = "as it is"  # nothing is corrected: a line from an unknown place still ends at a known one
        self._feed_words(block, kind)
        path = self._path(block, start, end) if kind != "as it is" else Line(start, end)
        for k in named:
            self._inside(block, k, end[k])
        before = self.extruder.position
        self.extruder.move(block, modes.inch)
        movable = tuple(k for k in sorted(commanded) if np.isfinite(end[k]) and (k in named or np.isfinite(start[k])))
        step = Step(
            block, modes, kind, path, named, movable, (), shift, self.came.copy(), end,
            (before, self.extruder.position), self.extruder.spread,
        )  # fmt: skip
        self.q, self.commanded = end.copy(), commanded
        self._arrive(path)
        return step

    def _path(self, block: Block, start: Array, end: Array) -> Line:
        modes = self.modes
        if modes.motion in ("G0", "G1"):
            return Line(start, end)
        first, second, third = PLANES[modes.plane][2:]
        i, j = self._plane(block)
        if block.has(third):
            block.refuse(f"{third} in the plane {modes.plane} (turns, or another plane)", f"Write {first} and {second}")
        clockwise = modes.motion == "G2"
        radius, parts = block.number_of("R"), [block.number_of(first), block.number_of(second)]
        unit = self._unit(i)
        if radius is not None and parts != [None, None]:
            block.refuse("an arc with a radius and a centre", "Write one of them")
        if radius is not None:
            centre = centre_by_radius(block, start[[i, j]], end[[i, j]], radius * unit, clockwise)
        elif parts == [None, None] or (modes.arc == "G90.1" and None in parts):
            block.refuse("an arc without a centre", f"Write {first} and {second}, or R")
        else:
            origin = self._shift(block)[[i, j]] if modes.arc == "G90.1" else start[[i, j]]
            centre = origin + unit * np.array([p or 0.0 for p in parts])
        arc = arc_of(block, start, end, clockwise, (i, j), centre)
        for point in arc.at(arc.corners()):
            self._inside(block, i, point[i])
            self._inside(block, j, point[j])
        return arc

    def _plane(self, block: Block) -> tuple[int, int]:
        """Columns of the axes of the plane: an arc moves both, named or not."""
        a, b = PLANES[self.modes.plane][:2]
        if a not in self.columns or b not in self.columns:
            block.refuse(f"an arc in {a}{b}, and the machine has no such axes", "Write lines")
        return self.columns[a], self.columns[b]

    def _feed_words(self, block: Block, kind: Kind) -> None:
        if self.modes.feed == "G93" and kind == "feed" and not block.has("F"):
            block.refuse("a cut without F in inverse time (G93)", "Write F in every block")
        if block.has("F") and not block.number_of("F") and not self.dialect.printer:
            block.refuse("F0", "Write a feed")
        if kind == "feed" and self.modes.feed != self.feed_of == "G93":
            block.refuse("a cut without F since the inverse time (G93) ended", "Write F behind G94")

    def _arrive(self, path: Line) -> None:
        """Update directions of approach; those of an arc are taken from its last quarter."""
        ends = path.at(path.corners()[-2:])
        step = ends[1] - ends[0]
        self.came = np.where(np.abs(step) > 1e-9, np.sign(step), self.came)  # NaN is not larger

    def _unknown(self, block: Block, q: Array, named: tuple[int, ...]) -> None:
        missing = [k for k in sorted({*self.needed, *named}) if not np.isfinite(q[k])]
        names = [self.names[k] for k in missing]
        why = sorted({self.lost[k] for k in missing if k in self.lost})
        event = why[0].split()[0] if why and why[0].split()[0].startswith(("M", "G", "T")) else "start"
        since = f" since {' and '.join(why)}" if why else ""
        block.refuse(
            f"where {', '.join(names)} {'stands' if len(names) == 1 else 'stand'} is not known here{since}, "
            "and the correction depends on it",
            f"Write --at {event}={','.join(f'{n}..' for n in names)} (positions of the axes), or a rapid to it first",
        )

    def _inside(self, block: Block, column: int, value: float) -> None:
        axis = self.setup.axes[column]
        low, high = axis.travel
        if np.isfinite(value) and not low - 1e-6 <= value <= high + 1e-6:
            found = f"{axis.name} at {value:.4f} (position of the axis), beyond its travel {low:g} to {high:g}"
            block.refuse(found, "Correct the position, or give the offset that is active as --offset")

    def _travels(self, block: Block) -> None:
        for k in range(self.count):
            self._inside(block, k, self.q[k])


def _check_radii(dialect: Dialect, setup: Setup, blocks: Sequence[Block]) -> None:
    """Raise InputError where X counts diameters, or a lathe's dialect has no word for radii."""
    counts = x_counts(setup)
    open_to_both = counts == NOT_KNOWN and not (dialect.header and is_lathe(setup))  # radii are granted, and said
    if counts == RADII or open_to_both or dialect.printer:
        return
    found, write = f"a programme of {dialect.title}", "Write it as RS274/NGC with radii (--dialect iso, G8)"
    if counts == DIAMETERS:
        if not dialect.header and any("G8" in b.codes("G") for b in blocks):
            return
        cure = f"{write}, or a CSV of commands, whose positions are those of the axes"
        raise InputError("--program", f"{found} whose X counts diameters ({OPTION})", cure)
    found += f" for {in_words(setup)}: X counts diameters there, and G90 to G99 mean others"
    raise InputError("--program", found, f"{write}, or a CSV of commands")
