"""A programme executed block by block: where each goes in positions of the axes, and what is not known is refused.

Sources: NIST IR 6556, section 3.8 and table 8 (order of execution in a block); LinuxCNC manual, "G codes"; Marlin
documentation, G0 to G3, G28, G90 to G92, M82, M83.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.setup import Setup
from errormodel.gcode import grammar
from errormodel.gcode.codes import ENDS, EXACT, PLANES, Dialect
from errormodel.gcode.grammar import Codes
from errormodel.gcode.paths import Line, arc_of, centre_by_radius
from errormodel.gcode.reading import START, STAY, UNKNOWN, Reading
from errormodel.gcode.words import Block

INCH = 25.4
Kind = Literal["rapid", "feed", "as it is"]


@dataclass(frozen=True)
class Modes:
    """Modal state behind a block. The motion of a programme is unknown until it is said."""

    motion: str = ""
    plane: str = "G17"
    distance: str = "G90"
    arc: str = "G91.1"
    units: str = "G21"
    feed: str = "G94"
    origin: str = ""
    tool: str = ""
    path: str = ""

    @property
    def absolute(self) -> bool:
        return self.distance == "G90"

    @property
    def inch(self) -> bool:
        return self.units == "G20"


@dataclass(frozen=True)
class Step:
    """What a block does.

    Attributes
    ----------
    kind : `rapid`, `feed`, or `as it is`: no motion, or one that is not corrected.
    path : of a motion whose start and end are known.
    named : columns of the axes that have words.
    movable : columns that were commanded up to here and are known: only these may get words.
    placed : columns that a command of its own rules left where `q` says.
    shift : what positions of the programme lack to be those of the axes (axes,).
    came : directions of arrival before the block, 0 where an axis has not moved yet.
    q : where the axes stand behind it, not a number where that is unknown.
    extruded : position of the extruder before the block and behind it; not a number where unknown.
    """

    block: Block
    modes: Modes
    kind: Kind = "as it is"
    path: Line | None = None
    named: tuple[int, ...] = ()
    movable: tuple[int, ...] = ()
    placed: tuple[int, ...] = ()
    shift: Array = field(default_factory=lambda: np.zeros(0))
    came: Array = field(default_factory=lambda: np.zeros(0))
    q: Array = field(default_factory=lambda: np.zeros(0))
    extruded: tuple[float, float] = (np.nan, np.nan)
    spread: Literal["absolute", "relative", ""] = ""  # how E counts; empty: not certain


class Interpreter:
    """Executes blocks of one dialect on one machine."""

    def __init__(self, dialect: Dialect, setup: Setup, reading: Reading, blocks: Sequence[Block]) -> None:
        self.dialect, self.setup, self.reading = dialect, setup, reading
        self.modes = Modes()
        self.count = len(setup.axes)
        named = sorted({w.code for b in blocks for w in b.words if dialect.groups.get(w.code) == "work offset"})
        self.one_origin = len(named) < 2
        self.columns = {n: setup.place(n) for n in setup.names}
        needed = {*setup.moving, *setup.movers}
        self.needed = [k for n, k in self.columns.items() if n in needed]
        self.linear = np.array([not a.rotary for a in setup.axes])
        self.q = self._place(START) if START in reading.after else np.full(self.count, np.nan)
        self.came = np.zeros(self.count)
        self.commanded: frozenset[int] = frozenset()
        self.lost: dict[int, str] = {}  # why an axis' position is unknown
        self.extruder, self.extruder_modes = np.nan, {"M8x": "", "G9x": "absolute"}
        self.extrudes = any(b.has("E") for b in blocks)

    def run(self, blocks: Sequence[Block], optional: bool = True) -> Iterator[Step]:
        """Steps of the blocks, one each; without `optional` blocks those are passed over."""
        ended: Block | None = None
        for block in blocks:  # an unknown word is said before an unknown position
            if not block.empty:
                grammar.check(block, self.dialect, self.setup.names, self.reading.after)
        for block in blocks:
            if block.empty or (block.optional and not optional):
                yield self._still(block)
                continue
            if ended:
                block.refuse(f"it is behind the programme's end (line {ended.number})", "Take it out")
            yield self._step(block)
            if ENDS & {*block.codes("M")} and not self.dialect.printer:
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

    def _step(self, block: Block) -> Step:
        codes = grammar.check(block, self.dialect, self.setup.names, self.reading.after)
        self.modes = grammar.modes_behind(self.modes, codes)
        if codes.event:
            return self._event(block, codes.event)
        self._extruder_modes(codes)
        if block.extended or "G4" in codes or "G92" in codes:
            self.extruder = (block.number_of("E") or 0.0) if "G92" in codes else self.extruder
            return self._still(block)
        named = tuple(self.columns[n] for n in self.setup.names if block.has(n))
        if "tool length" in codes.groups:
            self._tool_length(block, named)
        circle = self.modes.motion in ("G2", "G3") and any(block.has(c) for c in "IJK")
        if self.dialect.printer and block.words[0].letter != "G":
            return self._still(block)
        if not named and not circle:
            grammar.no_path_words(block)
            before = self.extruder
            self._extrude(block)
            return replace(self._still(block), extruded=(before, self.extruder), spread=self._spread())
        return self._move(block, named)

    def _event(self, block: Block, name: str) -> Step:
        """A command that moves axes by rules of its own."""
        which = tuple(range(self.count))
        if name in ("G28", "G30"):
            which = tuple(self.columns[n] for n in self.setup.names if block.has(n)) or which
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
        """G28 runs through the point of its words: it must be where the axes stand, or a known one."""
        shift = self._shift(block)
        for n, k in self.columns.items():
            value = block.number_of(n)
            if value is None:
                continue
            if not self.modes.absolute and value:
                block.refuse(f"{n} runs through another point before it returns", f"Write G91 and {n}0")
            if self.modes.absolute:
                self._inside(block, k, value * self._unit(k) + shift[k])

    def _unit(self, column: int) -> float:
        return INCH if self.modes.inch and self.linear[column] else 1.0

    def _shift(self, block: Block) -> Array:
        """Work offset and tool length."""
        out, offsets, origin = self._zero(), self.reading.offsets, self.modes.origin
        name = origin if origin in offsets else ""
        if origin and (name or (offsets and self.one_origin and "" in offsets)):
            pass
        elif origin or (offsets and "" not in offsets and any(n.startswith("G5") for n in offsets)):
            found = f"the work offset {origin}" if origin else "the work offset that is active here"
            cure = f"Write --offset {origin + '=' if origin else ''}X..,Y..,Z.. (positions of its zero on the axes)"
            block.refuse(f"{found} is not known", cure)
        for place in (offsets.get(name, {}), offsets.get(self.modes.tool, {}) if self.modes.tool else {}):
            for letter, value in place.items():
                out[self.setup.place(letter)] += value
        return out

    def _tool_length(self, block: Block, named: tuple[int, ...]) -> None:
        """G43 and G49: without a Z of their own some controls move Z at once, others with the next Z."""
        height = self.columns.get("Z")
        if "G43" in block.codes("G"):
            number = block.number_of("H")
            if number is None:
                block.refuse("a tool length without H", "Write G43 with H")
            name = f"H{number:g}"
            if name not in self.reading.offsets:
                found = f"the tool length {name} is not known"
                block.refuse(found, f"Write --offset {name}=Z.. (Z0 where the work offset holds it)")
        else:
            name = ""
        if name == self.modes.tool:
            return
        self.modes = replace(self.modes, tool=name)
        if height in named and height is not None:
            if self.modes.motion != "G0" or not self.modes.absolute:
                block.refuse("a tool length that changes along a cut", "Write G43 in a block with G90 G0 Z")
        elif height is not None:
            self.q[height] = np.nan
            self.lost[height] = f"the change of tool length in line {block.number}"

    def _extruder_modes(self, codes: Codes) -> None:
        """M82 and M83 say how E counts; of G90 and G91 firmwares differ in whether they change it, too."""
        for code in codes.groups.values():
            if code in ("M82", "M83"):
                self.extruder_modes = {"M8x": "absolute" if code == "M82" else "relative", "G9x": ""}
            elif code in ("G90", "G91"):
                self.extruder_modes["G9x"] = "absolute" if code == "G90" else "relative"

    def _spread(self) -> Literal["absolute", "relative", ""]:
        said, later = self.extruder_modes["M8x"], self.extruder_modes["G9x"]
        if not said or (later and later != said):
            return ""
        return "absolute" if said == "absolute" else "relative"

    def _extrude(self, block: Block) -> None:
        value = block.number_of("E")
        if value is None:
            return
        spread = self._spread()
        value *= INCH if self.modes.inch else 1.0
        self.extruder = value if spread == "absolute" else self.extruder + value if spread else np.nan

    def _move(self, block: Block, named: tuple[int, ...]) -> Step:
        modes, own = self.modes, "G53" in block.codes("G")
        if modes.motion in ("", "G80"):
            block.refuse("positions without G0, G1, G2 or G3", "Write how it moves")
        if modes.motion in ("G0", "G1"):
            grammar.no_path_words(block)
        if own and ("G0" not in block.codes("G") or not modes.absolute):
            block.refuse("G53 that is no absolute rapid of its own", "Write G90 and G0 G53")
        shift = self._zero() if own else self._shift(block)
        start, end = self.q.copy(), self.q.copy()
        for k in named:
            value = float(block.number_of(self.setup.names[k]) or 0.0) * self._unit(k)
            end[k] = value + shift[k] if modes.absolute else end[k] + value
        rapid = modes.motion == "G0"
        travelling = self.dialect.printer and self.extrudes and not block.has("E") and modes.motion in ("G0", "G1")
        commanded = self.commanded | {*named}
        kind: Kind = "rapid" if rapid and not self.dialect.printer else "feed"
        whole = bool(np.isfinite(end[[*self.needed, *named]]).all())
        started = bool(np.isfinite(start[[*self.needed, *named]]).all())
        if own or ((rapid or travelling) and not (whole and (kind == "rapid" or started))):
            kind = "as it is"  # nothing is added to a positioning whose correction is not known
        elif kind == "feed" and not (whole and started):
            self._unknown(block, start if not started else end, named)
        self._feed_words(block, kind)
        path = self._path(block, start, end) if kind != "as it is" else Line(start, end)
        for k in named:
            self._inside(block, k, end[k])
        before = self.extruder
        self._extrude(block)
        known = np.isfinite(end) & (np.isfinite(start) | np.isin(np.arange(self.count), named))
        movable = tuple(k for k in sorted(commanded) if known[k])
        step = Step(
            block, modes, kind, path, named, movable, (), shift, self.came.copy(), end,
            (before, self.extruder), self._spread(),
        )  # fmt: skip
        self.q, self.commanded = end.copy(), commanded
        self._arrive(path)
        return step

    def _path(self, block: Block, start: Array, end: Array) -> Line:
        modes = self.modes
        if modes.motion in ("G0", "G1"):
            return Line(start, end)
        a, b, first, second, third = PLANES[modes.plane]
        if a not in self.columns or b not in self.columns:
            block.refuse(f"an arc in {a}{b}, and the machine has no such axes", "Write lines")
        i, j = self.columns[a], self.columns[b]
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

    def _feed_words(self, block: Block, kind: Kind) -> None:
        if self.modes.feed == "G93" and kind == "feed" and not block.has("F"):
            block.refuse("a cut without F in inverse time (G93)", "Write F in every block")
        if block.has("F") and not block.number_of("F") and self.modes.feed == "G93":
            block.refuse("F0", "Write a feed")

    def _arrive(self, path: Line) -> None:
        """Directions of arrival: of an arc, those of its last quarter."""
        ends = path.at(path.corners()[-2:])
        step = ends[1] - ends[0]
        moved = np.isfinite(step) & (np.abs(np.nan_to_num(step)) > 1e-9)
        self.came = np.where(moved, np.sign(np.nan_to_num(step)), self.came)

    def _unknown(self, block: Block, q: Array, named: tuple[int, ...]) -> None:
        missing = [k for k in sorted({*self.needed, *named}) if not np.isfinite(q[k])]
        names = [self.setup.names[k] for k in missing]
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


def stops_exactly(step: Step) -> bool:
    """Whether the control stops at the end of every block."""
    return bool(EXACT & {*step.block.codes("G"), step.modes.path})

