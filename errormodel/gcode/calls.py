"""Calls of subprogrammes written out: the called lines stand where the call stood, as often as it is repeated.

Modal state passes through a call and back unchanged, so that this is what the control executes. Of FANUC-like controls
M98 and M99 within one file, of RS274/NGC ``O100 sub``, ``O100 endsub`` and ``O100 call`` without arguments; all else of
both is refused.

Sources: FANUC B-64484EN, "Subprogram (M98, M99)"; LinuxCNC manual, "O codes".
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from errormodel.gcode.codes import Dialect
from errormodel.gcode.words import Block

COMMENT = re.compile(r"\([^()]*\)|;.*")
NUMBER = re.compile(r"\s*O\s*(\d+)\s*", re.IGNORECASE)
WORD_LINE = re.compile(r"\s*(/?)\s*O\s*(\d+|<[^<>]+>)\s*([A-Z]+)\b(.*)", re.IGNORECASE)
CALL = re.compile(r"(/?)(N\d+)?M0*98(?:P(\d+)|L(\d+)){1,2}", re.IGNORECASE)
RETURN = re.compile(r"(?<![A-Z])M0*99(?![\d.])", re.IGNORECASE)
CALLS = re.compile(r"(?<![A-Z])M0*98(?![\d.])", re.IGNORECASE)
ENDS = re.compile(r"(?<![A-Z])M0*(?:2|30)(?![\d.])", re.IGNORECASE)
MOST_NESTED = 10  # calls within calls: FANUC B-64484EN
MOST_BLOCKS = 200_000  # of a programme written out; by judgement
_CURE = "Write the programme without calls (most CAM systems can)"


@dataclass
class Calls:
    """Subprogrammes by name, and how many calls were written out."""

    bodies: Mapping[str, list[Block]]
    words: bool  # O-words of RS274/NGC
    count: int = 0
    size: int = 0
    stack: list[str] = field(default_factory=list)

    def written(self, blocks: Sequence[Block], optional: bool) -> list[Block]:
        """The blocks with their calls written out; `optional`: the call that leads here is an optional block."""
        out: list[Block] = []
        for block in blocks:
            call = self._call(block)
            if call is None:
                out.append(_optional(block) if optional else block)
            else:
                name, times, switched = call
                out += self._body(block, name, times, optional or switched)
            self.size += 1
            if self.size > MOST_BLOCKS:
                block.refuse(f"calls that make more than {MOST_BLOCKS} blocks", _CURE)
        return out

    def _body(self, block: Block, name: str, times: int, optional: bool) -> list[Block]:
        if name not in self.bodies:
            block.refuse(f"a call of the subprogramme {name}, which is not in this file", "Add it, or write its lines")
        if name in self.stack:
            block.refuse(f"the subprogramme {name} calls itself", _CURE)
        if len(self.stack) >= MOST_NESTED:
            block.refuse(f"more than {MOST_NESTED} calls within calls", _CURE)
        self.stack.append(name)
        self.count += 1
        shown = COMMENT.sub("", block.text).strip().strip("/").replace("<", "").replace(">", "")
        out = [replace(block, text=f"({shown.upper()})")]
        for _ in range(times):
            out += self.written(self.bodies[name], optional)
        self.stack.pop()
        return out

    def _call(self, block: Block) -> tuple[str, int, bool] | None:
        """Name, repeats, and whether the block is optional; None: no call."""
        plain = COMMENT.sub(" ", block.text)
        if self.words:
            found = WORD_LINE.match(plain)
            if not found:
                return None
            if found[3].lower() != "call":
                block.refuse(f"a subprogramme's or a loop's O-word ({found[3]})", _CURE)
            if found[1] or found[4].strip():
                block.refuse("a call with arguments, or an optional one", _CURE)
            return _name(found[2]), 1, False
        if not CALLS.search(plain):
            return None
        text = re.sub(r"\s", "", plain)
        numbers = {letter: re.findall(rf"{letter}(\d+)", text, re.IGNORECASE) for letter in "PL"}
        if not CALL.fullmatch(text) or len(numbers["P"]) != 1 or len(numbers["L"]) > 1:
            block.refuse("M98 with other words than P and L", "Write the call in a block of its own")
        called, times = numbers["P"][0], int((numbers["L"] or ["1"])[0])
        if len(called) > 4:
            if numbers["L"]:
                block.refuse("M98 with repeats in P and in L", "Write L alone")
            called, times = called[-4:], int(called[:-4])
        if not times:
            block.refuse("a call that is repeated 0 times", "Take it out")
        return f"O{int(called)}", times, text.startswith("/")


def written_out(raw: Sequence[Block], dialect: Dialect) -> tuple[list[Block], int]:
    """Lines of the programme with its calls written out, and how many there were.

    Raises
    ------
    InputError
        A subprogramme is missing, without its end, calls itself, or takes arguments.
    """
    if dialect.printer:
        return list(raw), 0
    words = not dialect.header
    main, bodies = _of_words(raw) if words else _of_numbers(raw)
    calls = Calls(bodies, words)
    out = calls.written(main, False) if bodies or any(CALLS.search(b.text) for b in raw) or words else list(main)
    return out, calls.count


def _of_words(raw: Sequence[Block]) -> tuple[list[Block], dict[str, list[Block]]]:
    """The main programme and its subprogrammes between ``O.. sub`` and ``O.. endsub``."""
    main: list[Block] = []
    bodies: dict[str, list[Block]] = {}
    open_at: Block | None = None
    name = ""
    for block in raw:
        found = WORD_LINE.match(COMMENT.sub(" ", block.text))
        word = found[3].lower() if found else ""
        if found and word in ("sub", "endsub"):
            if found[1] or found[4].strip():
                block.refuse("a subprogramme with a value, or an optional one", _CURE)
            if word == "sub" and open_at is None:
                name, open_at = _name(found[2]), block
                if name in bodies:
                    block.refuse(f"the subprogramme {name} a second time", "Write it once")
                bodies[name] = []
                continue
            if word == "endsub" and open_at is not None and name == _name(found[2]):
                open_at = None
                continue
            block.refuse("a subprogramme within another, or an end without its beginning", _CURE)
        if open_at is not None:
            bodies[name].append(block)
            continue
        if word == "call" and found and _name(found[2]) not in bodies:
            shown = _name(found[2])
            block.refuse(f"a call of the subprogramme {shown}, which is not above it in this file", "Write it there")
        main.append(block)
    if open_at is not None:
        open_at.refuse("a subprogramme without its end", "Write O.. endsub behind it")
    return main, bodies


def _of_numbers(raw: Sequence[Block]) -> tuple[list[Block], dict[str, list[Block]]]:
    """The first programme of a tape and the others, each from its number O to M99."""
    main: list[Block] = []
    bodies: dict[str, list[Block]] = {}
    begun, ended, here = False, False, ""
    closed = True
    for block in raw:
        plain = COMMENT.sub(" ", block.text).strip()
        number = NUMBER.fullmatch(plain)
        if number and begun and (ended or bodies):
            if not closed:
                block.refuse(f"a programme's number before the end (M99) of {here}", "Write M99 before it")
            here, closed = f"O{int(number[1])}", False
            if here in bodies:
                block.refuse(f"the subprogramme {here} a second time", "Write it once")
            bodies[here] = []
            continue
        if not bodies:
            if RETURN.search(plain):
                block.refuse("M99 in the main programme, which begins it again", "End it with M30")
            main.append(block)
            begun = begun or plain not in ("", "%")
            ended = ended or bool(ENDS.search(plain))
            continue
        if closed:
            if plain not in ("", "%"):
                block.refuse(
                    f"it is behind the end (M99) of {here}", "Take it out, or write a programme's number first"
                )
            if plain == "%":
                main.append(block)
            continue
        if RETURN.search(plain):
            if not re.fullmatch(r"(N\d+\s*)?M0*99\s*", plain, re.IGNORECASE):
                block.refuse("M99 with other words, or optional", "Write M99 alone")
            closed = True
            continue
        bodies[here].append(block)
    if not closed:
        raw[-1].refuse(f"the subprogramme {here} without its end", "Write M99 behind it")
    return main, bodies


def _name(text: str) -> str:
    """A subprogramme's name: RS274/NGC tells neither cases nor blanks apart."""
    return f"O{int(text)}" if text.isdigit() else "O" + re.sub(r"\s", "", text.lower())


def _optional(block: Block) -> Block:
    """The block as one of a call that is optional."""
    plain = COMMENT.sub(" ", block.text).strip()
    return block if not plain or plain.startswith("/") else replace(block, text=f"/{block.text.lstrip()}")
