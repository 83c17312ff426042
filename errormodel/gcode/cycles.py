"""Drilling cycles written out as the single moves that they stand for.

G81, G82, G85 and G89, and on RS274/NGC controls G83 and G73, whose clearance LinuxCNC states (0.010 inch); on
FANUC-like ones it is a parameter of the control, and they are refused. Where controls differ the programme is refused,
too: a tool below the level R, levels that would count from a level that itself was relative, tapping, and boring with a
stopped spindle.

Sources: NIST IR 6556, section 3.5.16 (canned cycles); LinuxCNC manual, "Canned cycles"; FANUC B-64484EN, "Canned cycle
for drilling".
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from decimal import Decimal

from errormodel.gcode.codes import MOTION, PECK_CYCLES, Dialect
from errormodel.gcode.grammar import Codes, check
from errormodel.gcode.interpreter import Interpreter
from errormodel.gcode.words import Block, split

CYCLES = {"G81": "", "G82": "P", "G85": "", "G89": "P", "G83": "Q", "G73": "Q"}  # and the letter that each needs
PECK_CLEARANCE_INCH = Decimal("0.010")  # LinuxCNC manual, G73 and G83: the rapid back stops so far above the last depth
CLEARANCE = {False: PECK_CLEARANCE_INCH * Decimal("25.4"), True: PECK_CLEARANCE_INCH}  # in mm, and in inches
HEAD_M = {"M3", "M4", "M7", "M8", "M9"}  # carried out with the first positioning
DECIMALS = 6  # of the initial level, which is a computed number; a thousandth of the least increment of a control
MOST_PECKS = 2000  # of a hole; by judgement
_SINGLE = "Write the cycle as single moves (most CAM systems can)"


@dataclass
class Series:
    """A series of holes: its cycle, and the values that stay from hole to hole, in the programme's units."""

    code: str
    distance: str
    initial: Decimal | None  # level before the series; None while positions are relative
    holes: int = 0
    low: bool = False  # whether the tool was left at the level R, below the level before the series
    words: dict[str, str] = field(default_factory=dict)


class CycleWriter:
    """Writes cycles out, block by block, and executes what it writes to know where the axes stand."""

    def __init__(self, interpreter: Interpreter) -> None:
        self.control = interpreter
        self.dialect: Dialect = interpreter.dialect
        self.series: Series | None = None
        self.count = 0

    def block(self, block: Block) -> list[Block]:
        """The block, or those that stand for it; they are executed."""
        if block.empty:
            return [block]
        control = self.control
        also = "QPLK" if self._is_cycle(block) else ""
        codes = check(block, self.dialect, control.names, control.reading.after, also)
        if not also:
            if MOTION in codes.groups or codes.event or "G53" in codes:
                self.series = None if MOTION in codes.groups else self._interrupted(block, codes)
            control.step(block, codes)
            return [block]
        texts = list(self._lines(block, codes))
        out = [split(Block(block.file, block.number, text), False) for text in texts]
        for one in out:
            control.step(one, check(one, self.dialect, control.names, control.reading.after))
        return out

    def _interrupted(self, block: Block, codes: Codes) -> Series | None:
        if self.series is not None:
            block.refuse(f"{codes.event or 'G53'} within a canned cycle", "Write G80 before it")
        return None

    def _is_cycle(self, block: Block) -> bool:
        motion = [c for c in block.codes("G") if self.dialect.groups.get(c) == MOTION]
        if motion:
            return motion[0] in CYCLES
        return self.series is not None and any(block.has(letter) for letter in (*self.control.names, *"RQPLK"))

    def _lines(self, block: Block, codes: Codes) -> Iterator[str]:
        modes = self.control.modes_of(codes)
        self._suits(block, codes)
        own = {w.letter: w.text for w in block.words if w.letter in "XYZRQPFLK"}
        series, code = self._series(block, codes, modes.distance, own)
        needed = CYCLES[code]
        missing = [letter for letter in f"ZR{needed}" if letter not in series.words]
        if missing:
            block.refuse(f"{code} without {', '.join(missing)}", "Write it in the cycle's first block")
        relative, times = modes.distance == "G91", self._times(block, own, modes.distance)
        r, z = Decimal(series.words["R"]), Decimal(series.words["Z"])
        high = -r if relative else self._level(block) - r  # heights over the level R
        depth = z if relative else z - r
        first = -r if series.initial is None else series.initial - r
        if high < 0 or first < 0:
            block.refuse("a canned cycle with the tool below its level R, which controls carry out differently",
                         "Write a rapid to a height above R before it")  # fmt: skip
        if depth >= 0:
            block.refuse(f"{code} with Z above R", "Write Z below R")
        if not modes.back and first != 0:
            found = "a canned cycle without G98 or G99, of which controls take one or the other where none is written"
            block.refuse(found, "Write G98 (back to the height before the cycle) or G99 (back to R)")
        up = Decimal(0) if modes.back == "G99" else first

        if high < up and not self.dialect.header:
            found = "a hole with G98 behind one with G99: LinuxCNC goes there and up in one rapid, others go up later"
            block.refuse(found, "Write G80 and a rapid up before it")

        def level(height: Decimal, stands: Decimal) -> str:
            return f"Z{_plain(height - stands if relative else r + height)}"

        lines, stands = [], high
        travel = [f"{a}{own[a]}" for a in "XY" if a in own]
        for _ in range(times):
            if travel:
                lines.append(f"G0 {' '.join(travel)}")
            if stands != 0:
                lines.append(f"G0 {level(Decimal(0), stands)}")
            stands = Decimal(0)
            for motion, height in self._strokes(block, code, depth, up, series.words, modes.inch):
                lines.append(f"{motion} {level(height, stands)}")
                stands = height
                if needed == "P" and height == depth:
                    lines.append(f"G4 P{series.words['P']}")
            if stands != up:
                lines.append(f"G0 {level(up, stands)}")
            stands = up
        series.holes += times
        series.low = up != first
        self.count += times
        yield from self._with_words(block, lines, own)

    def _suits(self, block: Block, codes: Codes) -> None:
        modes = self.control.modes_of(codes)
        if modes.plane != "G17" or modes.feed == "G93":
            block.refuse("a canned cycle in another plane than G17, or in inverse time (G93)", _SINGLE)
        for group, code in codes.groups.items():
            if group not in (MOTION, "distance", "return") and code[0] == "G":
                block.refuse(f"{code} in the block of a canned cycle", f"Write {code} in a block of its own")
        for code in block.codes("M"):
            if code not in HEAD_M:
                block.refuse(f"{code} in the block of a canned cycle", f"Write {code} in a block of its own")
        for word in block.words:
            if word.letter not in "GMXYZRFSQPLK" or (word.letter == "K" and not self.dialect.header):
                block.refuse(f"{word} in the block of a canned cycle", _SINGLE)

    def _series(self, block: Block, codes: Codes, distance: str, own: dict[str, str]) -> tuple[Series, str]:
        code = codes.groups.get(MOTION, self.series.code if self.series else "")
        if code in PECK_CYCLES and self.dialect.header:
            block.refuse(f"{code}, whose clearance is a parameter of the control (5114, 5115)", _SINGLE)
        series = self.series
        if series is None:
            series = Series(code, distance, None)
            series.initial = None if distance == "G91" else self._level(block)
        elif (code, distance) != (series.code, series.distance):
            if distance != series.distance:
                block.refuse("G90 and G91 within a series of holes", "Write G80 before it")
            series = Series(code, distance, series.initial, series.holes, series.low)
        if distance == "G91" and series.low:
            found = "a further block of holes in G91 behind one with G99, whose levels controls count differently"
            block.refuse(found, "Write G80 and a rapid before it, or G98")
        if series.holes and not any(a in own for a in "XY"):
            block.refuse(
                "a block within a canned cycle without X and Y, which not all controls take for a hole", _SINGLE
            )
        needed = CYCLES[code]
        for letter in "QP":
            if letter in own and letter != needed:
                block.refuse(f"{letter}{own[letter]} in {code}", "Take it out")
        series.words |= {k: v for k, v in own.items() if k in f"ZR{needed}"}
        self.series = series
        return series, code

    def _times(self, block: Block, own: dict[str, str], distance: str) -> int:
        repeats = [own[k] for k in "LK" if k in own]
        if not repeats:
            return 1
        if len(repeats) > 1 or not repeats[0].isdigit() or not int(repeats[0]):
            block.refuse("a cycle with such a number of repeats", "Write a whole number from 1")
        times = int(repeats[0])
        if times > 1 and (distance != "G91" or not any(a in own for a in "XY")):
            block.refuse("a cycle that is repeated at one place", "Write G91 with X or Y")
        return times

    def _level(self, block: Block) -> Decimal:
        """Where Z stands, in the programme's units and from its origin."""
        return round(Decimal(self.control.programme_position(block, "Z")), DECIMALS)

    def _strokes(
        self, block: Block, code: str, depth: Decimal, up: Decimal, words: dict[str, str], inch: bool
    ) -> Iterator[tuple[str, Decimal]]:
        """Motions from the level R to the depth, and back if at feed: the word, and the height over R.

        From G89 LinuxCNC comes back at feed to where the cycle ends (`up`), FANUC-like controls to R.
        """
        if code not in PECK_CYCLES:
            yield "G1", depth
            if code in ("G85", "G89"):
                yield "G1", up if code == "G89" and not self.dialect.header else Decimal(0)
            return
        step = Decimal(words["Q"])
        if step <= CLEARANCE[inch] or -depth / step > MOST_PECKS:
            block.refuse(f"{code} with Q{words['Q']}", "Write a depth of each peck above the clearance, 0.254 mm")
        at = -step
        while at > depth:
            yield "G1", at
            if code == "G83":
                yield "G0", Decimal(0)
            yield "G0", at + CLEARANCE[inch]
            at -= step
        yield "G1", depth

    def _with_words(self, block: Block, lines: list[str], own: dict[str, str]) -> Iterator[str]:
        """The lines with the block's other words: the first has them, the first at feed has F."""
        head = [str(w) for w in block.words if w.letter in "GMST" and w.code not in CYCLES]
        slash, label = ("/" if block.optional else ""), (f"{block.label} " if block.label else "")
        cut = next(k for k, line in enumerate(lines) if line.startswith("G1"))
        for k, line in enumerate(lines):
            words = [*(head if k == 0 else []), line, *([f"F{own['F']}"] if k == cut and "F" in own else [])]
            yield slash + (label if k == 0 else "") + " ".join([*words, *(block.comments if k == 0 else ())])


def _plain(value: Decimal) -> str:
    """A number in plain digits with a decimal point, which FANUC-like controls need."""
    text = f"{value:f}"
    text = text.rstrip("0") if "." in text else f"{text}."
    return "0." if text in ("-0.", "0.", "-.") else text
