"""Programmes of Siemens' controls as lists of commands.

Each block is said in words of RS274/NGC and executed by the interpreter of `errormodel.gcode`, which knows arcs,
offsets, inches and travels. What that would not be certain of is refused: variables, loops, calls, cycles, frames.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import NoReturn

from errormodel.gcode.words import Block, Word
from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording
from errormodel.raw_formats.programme_poses import MOST_OTHER, ProgrammeZero, recording_of_blocks, setup_and_reading

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)"
_TEXT = re.compile(r'"[^"]*"')
_HEAD = re.compile(r"\s*(?P<skip>/\d?)?\s*(?:[N:]\d+)?\s*(?:[A-Z_][A-Z_0-9]+:(?!=))?\s*")
_ADDRESS = (
    rf"(?P<name>[A-Z]+\d*)\s*=\s*(?:(?P<how>AC|IC|DC|ACP|ACN)\s*\(\s*(?P<inside>{_NUMBER})\s*\)|(?P<value>{_NUMBER}|\"\"))"
    r"(?=\s|$|[A-Z])\s*"
)
_LETTER = rf"(?P<letter>[A-Z])(?P<number>{_NUMBER})(?![\d.=(])\s*"
_WORD = r"(?P<word>[A-Z_]{2}[A-Z_0-9]*)\s*(?P<arguments>\([^()]*\))?(?!\s*=)\s*"
_TOKEN = re.compile(f"{_ADDRESS}|{_LETTER}|{_WORD}")
_CODE = re.compile(r"(?<![A-Z])G\d")
_AXIS = re.compile(r"(?<![A-Z])[XYZABCUVW]\d*\s*(?:=|[-+]?[\d.])")
_REFERENCE = re.compile(r"(?<![A-Z])G7[45](?![\d.])")  # to places of the machine's own

_PLAIN = "Write positions as plain numbers (X=100.5), or give a log or a table of the positions as --commands"
_SINGLE = "Write the blocks one after the other as the control executes them, or give a log of the positions"
_AXES = "Write positions of the axes"
_FRAME = "Put it into --offset, and take it out"
_ZERO = "Write one of G54 to G59, and give it as --offset G54=X..,Y..,Z.."
# words that move no axis and displace no zero
_QUIET = re.compile(
    r"STOPRE|MSG|FFWO[NF]|BRISKA?|SOFTA?|DRIVEA?|COMP(ON|OF|CURV|CAD)|CYCLE832|TRAFOOF|CFC|CFTCP|CFIN|DIAMOF|FNORM|FGROUP|"
    r"WORKPIECE|GROUP_\w+|ORIMKS|ORIAXES|[US]PATH|FIFOCTRL|STARTFIFO|STOPFIFO|WALIMO[NF]|DYN(NORM|POS|ROUGH|SEMIFIN|FINISH)|CUT2D|CUT3DC|"
    r"CYCLE800\(\)"  # takes a turned plane back
)
_RESET = frozenset(("TRANS", "ROT", "SCALE", "MIRROR"))  # alone in a block: the frame is taken back
_REFUSED = (
    (r"(END)?(FOR|WHILE|LOOP|IF)|REPEATB?|UNTIL|GOTO[BFCS]?|ELSE|CASE", "a loop or jump", _SINGLE),
    (r"CYCLE\w*|MCALL|POCKET\w*|HOLES\w*|SLOT\w*|LONGHOLE|(EXT|P|ISO)?CALL", "a cycle or call", _SINGLE),
    (r"TRAORI|TRANSMIT|TRACYL|TRAANG|TRACON", "a transformation (tool centre point control)", _AXES),
    (r"A?(TRANS|ROTS?|SCALE|MIRROR)|CROTS?|TOFRAME|TOROT\w*|CFINE|CTRANS", "a frame", _FRAME),
    (r"DEF|SET|EXTERN|DEFINE", "variables", _PLAIN),
    (r"CIP|CT|[ABC]SPLINE|POLY|INVCC?W", "a path that is no line or circle by its ends", "Write G0 to G3"),
    (r"AP|RP|ANG|RNDM?|CHF|CHR", "polar coordinates, a corner or a chamfer", "Write lines and arcs by their ends"),
    (r"DIAMON|DIAM90", "diameters", "Write radii"),
)
_UNITS = {"70": "20", "700": "20", "71": "21", "710": "21"}
_WAYS = {"DC": 0, "ACP": 1, "ACN": -1}  # of a rotary axis, as `Programme.ways`
_PASSED = re.compile(r"9|60[123]?|64[1-5]?")  # exact stops and rounding
_SPINDLE = re.compile(r"S\d*|M\d+|SPOS\d*|LIMS|H\d*|ADIS|ADISPOS")  # addresses that move none of the axes


class SiemensProgramme(RawFormat):
    """Commands of a Sinumerik's programme in mm and degrees of the axes: plain numbers, assigned (``X=100``) or not."""

    name = "siemens-programme"
    title = "a programme of a Siemens control"
    source = "SINUMERIK 840D sl/828D, Programming Manual Fundamentals (A5E40869423, 05/2017)"
    uses = ("offsets", "at")

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        from errormodel.gcode.detect import looks_siemens

        if raw.text is None:
            return False
        lines = [text for line in raw.lines if (text := _plain(line)) and text[0] != "%"]
        if not any(map(_CODE.search, lines)) or not any(map(_AXIS.search, lines)) or not looks_siemens(lines):
            return False
        return sum(map(_is_block, lines)) >= (1 - MOST_OTHER) * len(lines)

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        setup, reading = setup_and_reading(raw, asked, "auto")
        reader = _Reader(setup.names, ProgrammeZero(bool(reading.offsets)))
        blocks = [reader.block(Block(raw.name, k, line)) for k, line in enumerate(raw.lines, start=1)]
        return recording_of_blocks(raw, cls.title, setup, reading, blocks, reader.ways)


def _plain(line: str) -> str:
    """A line without its comment, in capitals, its texts empty."""
    return _TEXT.sub('""', line).split(";", 1)[0].strip().upper()


def _is_block(text: str) -> bool:
    head = _HEAD.match(text)
    at = head.end() if head else 0
    while at < len(text) and (token := _TOKEN.match(text, at)):
        at = token.end()
    return at == len(text) or _followed_by_none(text[at:])


def _followed_by_none(rest: str) -> bool:
    """Whether it is language of these controls that is refused with a reason."""
    name = re.match(r"[A-Z_]+", rest)
    return "=" in rest or (name is not None and any(re.fullmatch(p, name[0]) for p, _, _ in _REFUSED))


@dataclass
class _Sentence:
    """What one block says, as far as it is read.

    Attributes
    ----------
    axes : value, and how it counts, by letter.
    machine : whether positions count from the machine's zero.
    """

    block: Block
    words: list[Word] = field(default_factory=list)
    axes: dict[str, tuple[str, str]] = field(default_factory=dict)
    machine: bool = False
    dwell: bool = False
    feed: str = ""


@dataclass
class _Reader:
    """Blocks one after the other, with what each leaves to the next.

    Attributes
    ----------
    unset : no settable offset is active (G500).
    metric_feed : whether feeds are in the units that are said with lengths.
    ways : as `Programme.ways`.
    """

    names: tuple[str, ...]
    zero: ProgrammeZero
    motion: str = "1"
    incremental: bool = False
    unset: bool = False
    metric_feed: bool = True
    tool: str = ""
    ended: bool = False
    ways: dict[tuple[int, str], int] = field(default_factory=dict)

    def block(self, block: Block) -> Block:
        """The block in words of RS274/NGC.

        Raises
        ------
        InputError
            It is not certain what it does.
        """
        text = _plain(block.text)
        head = _HEAD.match(text)
        if head is None or head.end() == len(text) or text.startswith(("%", "PROC ")) or self.ended:
            return block
        if _REFERENCE.search(text):
            return replace(block, words=(Word("G", "28"),))
        said, at = _Sentence(block), head.end()
        while at < len(text):
            token = _TOKEN.match(text, at)
            if token is None:
                self._refuse(block, text[at:])
            at = token.end()
            if token["word"]:
                alone = at == len(text) and not said.words and not said.axes and not token["arguments"]
                empty = "()" if (token["arguments"] or "").replace(" ", "") == "()" else ""
                self._word(said, token["word"] + empty, alone)
            else:
                value = token["number"] or token["value"] or token["inside"]
                self._address(said, token["name"] or token["letter"], value, token["how"] or "")
        words = (*said.words, *self._moves(said))
        self.ended = any(w.code in ("M2", "M30") for w in words)
        return replace(block, words=words, optional=bool(head["skip"]))

    def _refuse(self, block: Block, rest: str) -> NoReturn:
        name = re.match(r"[A-Z_]+", rest)
        for pattern, found, cure in _REFUSED:
            if name and re.fullmatch(pattern, name[0]):
                block.refuse(f"{found} ({name[0]})", cure)
        first = rest.split(maxsplit=1)[0][:20]
        what = f"a variable or an expression ({first})" if "=" in rest else f"'{first}'"
        block.refuse(f"{what}, which is not followed here", _PLAIN)

    def _word(self, said: _Sentence, word: str, alone: bool) -> None:
        if word == "SUPA":
            said.machine = True
        elif not _QUIET.fullmatch(word) and not (word in _RESET and alone):
            self._refuse(said.block, word)

    def _address(self, said: _Sentence, name: str, value: str, how: str) -> None:
        """One address with its value."""
        if name in self.names:
            if name in said.axes:
                said.block.refuse(f"{name} twice", "Write one")
            said.axes[name] = value, how
        elif how:
            found = f"{name}={how}(..)"
            said.block.refuse(found, "Write centres as plain numbers from the start of the arc; take other axes out")
        elif name == "G":
            self._code(said, f"{float(value):g}")
        elif name in ("T", "D"):  # a change of the tool takes its first edge; D0 none
            if name == "T":
                self.tool = value.strip('"') or _tool_by_name(said.block.text)
            none = not (value if name == "D" else self.tool).strip("0")
            self.zero.tool = "" if none else self.tool or f"with D{value}"
        elif name == "F":
            said.feed = value
        elif name in ("I", "J", "K", "CR"):
            said.words.append(Word("R" if name == "CR" else name, value))
        elif name == "M":
            if float(value) in (17, 99):
                said.block.refuse(f"the end of a subprogramme (M{float(value):g})", _SINGLE)
            said.words.append(Word("M", value))
        elif name in ("L", "P"):
            said.block.refuse(f"a call of a subprogramme ({name}{value})", _SINGLE)
        elif not _SPINDLE.fullmatch(name):
            self._refuse(said.block, f"{name}={value}" if len(name) > 1 else f"{name}{value}")

    def _code(self, said: _Sentence, code: str) -> None:
        """A G function: what it leaves to the next blocks, and its word."""
        if code in ("0", "1", "2", "3"):
            self.motion = code
        elif code in ("90", "91"):
            self.incremental = code == "91"
        elif code in _UNITS:
            self.metric_feed = code != "70"  # G70 and G71 are of lengths, G700 and G710 of feeds as well
            said.words.append(Word("G", _UNITS[code]))
        elif code in ("53", "153"):
            said.machine = True
        elif code == "500":
            self.unset = True
        elif code == "4":
            said.dwell = True
        elif re.fullmatch(r"50[5-9]|5[1-9]\d", code):
            said.block.refuse(f"the settable offset G{code}", _ZERO)
        elif not _PASSED.fullmatch(code):
            if re.fullmatch(r"5[4-9]", code):
                self.unset, self.zero.origin = False, f"G{code}="
            said.words.append(Word("G", code))

    def _moves(self, said: _Sentence) -> list[Word]:
        """Words of what the block moves, and of its dwell or feed."""
        if said.dwell:
            if said.axes:
                said.block.refuse("a dwell with positions", "Write G4 in a block of its own")
            return [Word("G", "4")]  # its F is a time
        feed = [Word("F", said.feed)] if said.feed and self.metric_feed else []
        if not said.axes:
            return feed
        counts = {how == "IC" or (self.incremental and not how) for _, how in said.axes.values()}
        if len(counts) > 1:
            said.block.refuse("positions and increments in one block", "Write all of them as positions")
        step = counts.pop()
        self.ways |= {(said.block.number, a): _WAYS[how] for a, (_, how) in said.axes.items() if how in _WAYS}
        machine = said.machine or (self.unset and not step)
        if machine and self.zero.tool:  # its length still counts: where the axes come to is not known
            return [Word("G", "91"), Word("G", "28"), *(Word(name, "0") for name in said.axes), *feed]
        if not machine:
            self.zero.check(said.block)
        out = [Word("G", "91" if step else "90"), *([Word("G", "53")] if machine else [])]
        out.append(Word("G", "0" if machine else self.motion))
        return [*out, *(Word(name, value) for name, (value, _) in said.axes.items()), *feed]


def _tool_by_name(text: str) -> str:
    found = re.search(r'T\s*=\s*"([^"]*)"', text, re.IGNORECASE)
    return found[1] if found else ""
