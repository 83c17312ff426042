"""Programmes in Heidenhain's conversational language as lists of commands.

Each statement is said in words of RS274/NGC and executed by the interpreter of `errormodel.gcode`, which knows arcs,
inches and travels: ``L X+100 Y-50 R0 F1000`` is a line, with ``FMAX`` a rapid, ``IX+10`` an increment, ``M91`` counts
in machine coordinates, where tools have no length; cycle 9 waits. What is not certain is refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NoReturn

from errormodel.gcode.words import Block, Word
from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording
from errormodel.raw_formats.programme_poses import MOST_OTHER, ProgrammeZero, recording_of_blocks, setup_and_reading

_VALUE = r"[-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)"
_HEADS = (
    r"BEGIN +PGM|END +PGM|BLK +FORM|TOOL +(?:CALL|DEF)|LN?|C|CC|CR|CT|LP|CP|CTP|CYCL|CALL|LBL|FN|Q[LRS]?\d+|STOP|PLANE|"
    r"FUNCTION|TRANS|APPR|DEP|RND|CHF|F[LC]T?|M\d+|\*"
)
_STATEMENT = re.compile(rf"\s*(?:\d+\s+)?(?:{_HEADS})(?![A-Z])")
_LINE = re.compile(r"\s*(?:\d+\s+)?L\s+I?[XYZABCUVW]\s*[-+]?(?:[\d.,]|Q)")
_TOKEN = re.compile(
    rf"(?P<step>I?)(?P<axis>[XYZABCUVW])\s*(?P<value>{_VALUE})|(?P<none>R0)|F\s*(?P<rapid>MAX)|F\s*(?P<auto>AUTO|[ZU]\s*{_VALUE})"
    rf"|F\s*(?P<feed>{_VALUE})|M(?P<m>\s*\d+)?(?=\s|$)|DR(?P<turn>[-+])|R(?P<radius>{_VALUE})"
)

_PLAIN = "Write positions as plain numbers, or give a log or a table of the positions as --commands"
_SINGLE = "Write the statements one after the other as the control executes them, or give a log of the positions"
_AXES = "Write positions of the axes"
_FRAME = "Put it into --offset, and take it out"
_ENDS = "Write L, C and CR with the ends of the paths"
_REFUSED = (
    (r"CALL +LBL|CALL +PGM|SEL +PGM|CALL +SELECTED|CYCL +DEF +12(?!\d)", "a call", _SINGLE),
    (r"CYCL +CALL|CYCL +DEF|CYCL|TCH +PROBE", "a cycle", _SINGLE),
    (r"FN|Q[LRS]?\d+|DECLARE|IF", "a Q parameter", _PLAIN),
    (r"LN|M128|FUNCTION +TCPM", "tool centre point control", _AXES),
    (r"PLANE", "a tilted plane", _AXES),
    (r"TRANS", "a datum shift", _FRAME),
    (r"CC|[LC]P|CTP?|FPOL|F[LC]T?|APPR|DEP|RND|CHF", "a path by polar coordinates, tangents or corners", _ENDS),
)
_NO_MOTION = re.compile(
    r"(BEGIN +PGM|END +PGM|BLK +FORM|TOOL +DEF|LBL|PLANE +RESET +STAY|TRANS +DATUM +RESET|"
    r"FUNCTION +(MODE|RESET +TCPM|FEED)|\*)(?![A-Z])"
)
_QUIET_CYCLES = frozenset((13, 32))  # orientation of the spindle, tolerance
_FRAMES = {7: "a datum shift", 8: "mirroring", 10: "rotation", 19: "a tilted plane"}  # taken back by zeros, or nothing
_QUIET_M = frozenset((13, 14, 116, 117, 126, 127, 129, 136, 137, 145))  # spindle and coolant, feeds, rotary ways, off


class HeidenhainProgramme(RawFormat):
    """Commands of a programme in conversational language, in mm and degrees of the axes: plain numbers, lines, arcs."""

    name = "heidenhain-programme"
    title = "a Heidenhain programme in conversational language"
    source = "User's Manual HEIDENHAIN Conversational Programming, iTNC 530 HSCI and TNC 640"
    uses = ("offsets", "at")

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        if raw.text is None:
            return False
        lines = [text for line in raw.lines if (text := line.split(";", 1)[0].upper()).strip(" \t~")]
        if not any(map(_LINE.match, lines)):
            return False
        return sum(bool(_STATEMENT.match(t)) for t in lines) >= (1 - MOST_OTHER) * len(lines)

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        setup, reading = setup_and_reading(raw, asked, "auto")
        reader = _Reader(ProgrammeZero(bool(reading.offsets)))
        blocks = [reader.block(block, text) for block, text in _statements(raw.name, raw.lines)]
        return recording_of_blocks(raw, cls.title, setup, reading, blocks, reader.ways)


def _statements(name: str, lines: Sequence[str]) -> Iterator[tuple[Block, str]]:
    """Statements in capitals, without numbers and comments; lines of parameters belong to the cycle above them."""
    number, text, shown = 0, "", ""
    for k, line in enumerate(lines, start=1):
        own = re.sub(r"^\s*\d+(?:\s+|$)", "", line.split(";", 1)[0].upper()).strip(" \t~")
        if text.startswith("CYCL DEF") and re.match(r"Q\d+ *=", own):
            text += f" {own}"
            continue
        if number:
            yield Block(name, number, shown), text
        number, text, shown = k, re.sub(r"\s+", " ", own), line
    if number:
        yield Block(name, number, shown), text


@dataclass
class _Reader:
    """Statements one after the other, with what each leaves to the next."""

    zero: ProgrammeZero
    inch: bool = False
    centre: tuple[str, str] | None = None
    upright: bool = True  # the tool is along Z, so that circles are in XY
    shorter: bool = False  # rotary axes turn the shorter way (M126)
    ended: bool = False
    ways: dict[tuple[int, str], int] = field(default_factory=dict)  # as `Programme.ways`

    def block(self, block: Block, text: str) -> Block:
        """The statement in words of RS274/NGC.

        Raises
        ------
        InputError
            It is not certain what it does.
        """
        if not text or self.ended:
            return block
        words = self._words(block, text)
        self.ended = bool({"M2", "M30"} & {w.code for w in words})
        return replace(block, words=tuple(words))

    def _words(self, block: Block, text: str) -> list[Word]:
        if text.startswith("BEGIN PGM"):
            self.inch = text.endswith(" INCH")
        if found := re.match(r"CYCL DEF (\d+)(?:\.(\d+))?", text):
            return self._cycle(block, int(found[1]), found[2], text[found.end() :])
        if _NO_MOTION.match(text):
            return []
        if text.startswith("PLANE RESET"):
            return [Word("G", "28")]  # rotary axes turn, and all may move: to where is not known
        if found := re.fullmatch(r"(?:L )?(?:R0 )?(?:F ?MAX )?M140 MB ?(?:MAX|[-+\d.,]+).*", text):
            return [Word("G", "91"), Word("G", "28"), Word("Z", "0")]  # back along the tool
        if found := re.match(r"TOOL CALL *(\"[^\"]*\"|\d+(?:\.\d+)?)? *([XYZ])?", text):
            if not found[1]:
                return []  # another speed
            self.zero.tool = "" if found[1].strip("0") == "" else found[1].strip('"')
            self.upright = found[2] in (None, "Z")
            return [Word("M", "6")]
        if found := re.fullmatch(rf"CC X *({_VALUE}) Y *({_VALUE})", text):
            self.centre = found[1].replace(",", "."), found[2].replace(",", ".")
            return []
        if re.match(r"FUNCTION DWELL", text):
            return [Word("G", "4")]
        if not (found := re.match(r"(STOP|L|C|CR)(?= |$)|(?=M\d)", text)):
            self._refuse(block, text)
        return self._path(block, found[0], text[found.end() :].strip())

    def _refuse(self, block: Block, text: str) -> NoReturn:
        for pattern, found, cure in _REFUSED:
            if re.match(rf"(?:{pattern})(?![A-Z])", text):
                block.refuse(found, cure)
        block.refuse(f"'{text.split(maxsplit=1)[0]}', which is not followed here", _PLAIN)

    def _cycle(self, block: Block, number: int, part: str | None, rest: str) -> list[Word]:
        """Words of a cycle: a dwell waits, a preset displaces the zero, a frame is taken back."""
        if number == 9:
            return [Word("G", "4")] if part == "1" else []
        if number == 247:
            self.zero.preset = "the preset that cycle 247 takes"
            return []
        if number in _FRAMES:
            values = re.findall(r"[-+]?\d+(?:[.,]\d+)?|[A-Z]+(?= |$)", rest) if part not in (None, "0") else []
            if any(not re.fullmatch(r"[-+]?[0.,]+", v) for v in values if v[-1].isdigit()) or (number == 8 and values):
                block.refuse(f"{_FRAMES[number]} (cycle {number})", _FRAME)
            return []
        if number not in _QUIET_CYCLES:
            self._refuse(block, f"CYCL DEF {number}")
        return []

    def _path(self, block: Block, head: str, text: str) -> list[Word]:
        """Words of a line, an arc, a stop, or of M functions alone."""
        axes: dict[str, tuple[str, bool]] = {}
        feed, functions, at = "", ["0"] if head == "STOP" else [], 0
        rapid, turn, radius = False, "", ""
        while at < len(text):
            token = _TOKEN.match(text, at)
            end = token.end() if token else 0
            if token is None or (end < len(text) and text[end] not in " IXYZABCUVWRFMD"):
                self._refuse_rest(block, text[at:])
            at = re.compile(r" *").match(text, end).end()  # type: ignore[union-attr]
            if token["axis"]:
                if token["axis"] in axes:
                    block.refuse(f"{token['axis']} twice", "Write one")
                axes[token["axis"]] = token["value"].replace(",", "."), bool(token["step"])
            elif token["m"]:
                functions.append(token["m"].strip())
            rapid = rapid or bool(token["rapid"])
            feed, turn, radius = token["feed"] or feed, token["turn"] or turn, token["radius"] or radius
        machine = "91" in functions
        if "128" in functions:
            self._refuse(block, "M128")
        self.shorter = (self.shorter or "126" in functions) and "127" not in functions
        if self.shorter:
            self.ways |= {(block.number, a): 0 for a, (_, step) in axes.items() if a in "ABC" and not step}
        said = [Word("M", m) for m in functions if int(m) not in _QUIET_M and m != "91"]
        steps = {step for _, step in axes.values()}
        if len(steps) > 1 or (machine and True in steps):
            block.refuse("positions and increments in one block", "Write all of them as positions")
        if head in ("C", "CR"):
            motion = self._arc(block, head, turn, radius)
        elif turn or radius:
            block.refuse("a radius or a sense in a line", "Write L, C or CR")
        else:
            motion = [Word("G", "0" if rapid or machine else "1")]
        speed = [Word("F", feed.replace(",", "."))] if feed and not rapid and not self.inch else []
        if not axes:
            return [*speed, *said]
        if not machine:
            self.zero.check(block)
        units = Word("G", "20" if self.inch else "21")
        mode = [Word("G", "53")] if machine else []
        values = [Word(name, value) for name, (value, _) in axes.items()]
        return [units, Word("G", "91" if True in steps else "90"), *mode, *motion, *values, *speed, *said]

    def _arc(self, block: Block, head: str, turn: str, radius: str) -> list[Word]:
        """Motion and centre of an arc; `turn` is + counterclockwise."""
        if not turn or (head == "CR") != bool(radius) or (head == "C" and self.centre is None) or not self.upright:
            block.refuse("an arc whose plane, centre or sense is not certain", "Write CC X Y, then C X Y DR+")
        way = Word("G", "3" if turn == "+" else "2")
        if head == "CR":
            return [way, Word("R", radius.replace(",", "."))]
        assert self.centre is not None
        return [Word("G", "90.1"), way, Word("I", self.centre[0]), Word("J", self.centre[1])]

    def _refuse_rest(self, block: Block, text: str) -> NoReturn:
        if re.match(r"I?[A-Z] *[-+]?Q[LRS]?\d", text):
            block.refuse(f"a Q parameter ({text.split(maxsplit=1)[0]})", _PLAIN)
        if re.match(r"R[LR+-](?= |$)", text):
            block.refuse("radius compensation", "Write the path of the tool's centre, with R0")
        block.refuse(f"'{text.split(maxsplit=1)[0]}', which is not followed here", _PLAIN)
