"""Lexer: lines of a programme as words. Every character must belong to a word, a comment or white space.

Sources: NIST IR 6556, section 3.3 (format of a line); LinuxCNC manual, "G-code overview"; Marlin documentation, "G-code
index" (one command a line, its parameters after it); Klipper documentation, "G-Codes" (extended commands).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import NoReturn

from errormodel.exceptions import InputError

NUMBER_WORD = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)")
COMMENTS = {False: re.compile(r"\([^()]*\)|;.*"), True: re.compile(r";.*")}  # of mills, of printers
BLANKS = re.compile(r"[ \t]*")
BLOCK_NUMBER = re.compile(r"[Nn][ \t]*(\d+)(?![\d.])")
EXTENDED = re.compile(r"[A-Za-z_][A-Za-z_0-9]*_[A-Za-z_0-9]*|[A-Za-z]{3,}[A-Za-z0-9]*")  # of Klipper
TEXT_CODES = {"M115", "M117", "M118", "M23", "M32", "M862.3", "M486"}  # of printers: their argument is text
PLAIN_NUMBER_CURE = "Write plain numbers, such as X10.5; a CAM system or the control itself can work them out"
SIGNS = {
    "#": ("a variable (#)", PLAIN_NUMBER_CURE),
    "[": ("an expression ([)", PLAIN_NUMBER_CURE),
    "]": ("an expression (])", PLAIN_NUMBER_CURE),
    "=": ("an assignment (=)", PLAIN_NUMBER_CURE),
    "*": ("a checksum or product (*)", "Write the programme without"),
    ")": ("a bracket that nothing opens", "Close comments where they begin"),
    "/": ("a '/' within the block", "Write '/' at the block's beginning"),
    "%": ("a '%' within the programme", "Write '%' alone, as the first and the last line"),
}


@dataclass(frozen=True)
class Word:
    """A letter with its number; `text` is the number as written, empty for a letter alone (printers)."""

    letter: str
    text: str

    @cached_property
    def value(self) -> float:
        return float(self.text)

    @cached_property
    def code(self) -> str:
        """Normal form of G and M words: ``G1`` for G01."""
        return f"{self.letter}{self.value:g}" if self.text else self.letter

    def __str__(self) -> str:
        return f"{self.letter}{self.text}"


@dataclass(frozen=True)
class Block:
    """A line of a programme.

    Attributes
    ----------
    number : from 1.
    optional : it begins with ``/``.
    label : line number as it stands (``N30``), or empty.
    extended : name of a command with a text of its own (``M117``, Klipper's ``START_PRINT``), or empty.
    """

    file: str
    number: int
    text: str
    words: tuple[Word, ...] = ()
    comments: tuple[str, ...] = ()
    optional: bool = False
    label: str = ""
    extended: str = ""

    def refuse(self, found: str, cure: str) -> NoReturn:
        """Refuse the programme.

        Raises
        ------
        InputError
            Always, with file, line and text.
        """
        shown = self.text.strip()
        raise InputError(f"{self.file}, line {self.number} ('{shown[:60]}')", found, cure)

    @cached_property
    def _values(self) -> dict[str, Word]:
        return {w.letter: w for w in self.words}

    def has(self, letter: str) -> bool:
        return letter in self._values

    def number_of(self, letter: str) -> float | None:
        """Value of the only word with that letter."""
        word = self._values.get(letter)
        return None if word is None else word.value

    def codes(self, letter: str) -> list[str]:
        return [w.code for w in self.words if w.letter == letter]

    @property
    def empty(self) -> bool:
        return not self.words and not self.extended


def lines_of(file: str, text: str) -> list[Block]:
    """Lines without their ends, not yet split into words.

    Raises
    ------
    InputError
        There is a control character, which some controls take for a line's end.
    """
    if text.startswith("\ufeff"):
        raise InputError(f"{file}, line 1", "a byte order mark", "Save the programme as plain ASCII text")
    out = [Block(file, k, line) for k, line in enumerate(text.replace("\r\n", "\n").split("\n"), start=1)]
    if out and not out[-1].text:
        out.pop()
    for block in out:
        for column, sign in enumerate(block.text, start=1):
            if not (sign >= " " or sign == "\t") or sign == "\x7f":
                _refuse_sign(block, column, sign)
    return out


def _refuse_sign(block: Block, column: int, sign: str) -> NoReturn:
    raise InputError(
        f"{block.file}, line {block.number}, column {column}",
        f"{sign!r} is no printable ASCII character",
        "Write all but the comments in plain ASCII, and no control characters in these",
    )


def _plain_outside_comments(block: Block, printer: bool) -> None:
    """Letters of other alphabets stay in comments, as they are; elsewhere some of them pass for letters and digits."""
    if block.text.isascii():
        return
    outside = COMMENTS[printer].sub(lambda found: " " * len(found[0]), block.text)
    for column, sign in enumerate(outside, start=1):
        if sign > "~":
            _refuse_sign(block, column, sign)


def split(block: Block, printer: bool) -> Block:
    """Split a block into its words.

    Raises
    ------
    InputError
        A character belongs to no word.
    """
    _plain_outside_comments(block, printer)
    text, at = block.text, BLANKS.match(block.text).end()  # type: ignore[union-attr]
    optional = text[at : at + 1] == "/"
    if optional:
        if printer:
            block.refuse("a '/', which printers do not know", "Take the line out, or give --dialect")
        at = BLANKS.match(text, at + 1).end()  # type: ignore[union-attr]
        if text[at : at + 1].isdigit():
            block.refuse("a numbered block delete", "Write '/' alone: one switch for all optional blocks")
    label = BLOCK_NUMBER.match(text, at)
    if label:
        at = label.end()
    words: list[Word] = []
    comments: list[str] = []
    extended = ""
    while (at := BLANKS.match(text, at).end()) < len(text):  # type: ignore[union-attr]
        sign = text[at]
        if sign == ";" or (sign == "(" and not printer):
            end = len(text) if sign == ";" else text.find(")", at) + 1
            if not end or ("(" in text[at + 1 : end] and sign == "("):
                block.refuse("a comment within another, or without its end", "Close every ( with ) on its line")
            comments.append(text[at:end].rstrip())  # blanks behind a comment end with its line
            at = end
            continue
        name = EXTENDED.match(text, at) if printer and not words else None
        if name:
            extended, at = name[0].upper(), _argument_end(text, name.end())
            continue
        word, at = _word(block, at, printer)
        if comments and not comments[-1].startswith(";") and word.letter == "N":
            block.refuse("N behind a comment", "Write N first")
        words.append(word)
        if printer and len(words) == 1 and word.code in TEXT_CODES:
            extended, words, at = word.code, [], _argument_end(text, at)
    return Block(
        block.file, block.number, text, tuple(words), tuple(comments), optional,
        text[label.start() : label.end()] if label else "", extended,
    )  # fmt: skip


def _argument_end(text: str, start: int) -> int:
    end = text.find(";", start)
    return len(text) if end < 0 else end


def _word(block: Block, at: int, printer: bool) -> tuple[Word, int]:
    text, letter = block.text, block.text[at].upper()
    if letter == ",":
        corner = re.match(r",[ \t]*([RrCcAa])", text[at:])
        what = f"a corner or chamfer (,{corner[1].upper()})" if corner else "a decimal comma"
        block.refuse(what, "Write a decimal point, and corners as arcs and lines of their own")
    if not "A" <= letter <= "Z":
        block.refuse(*SIGNS.get(text[at], (f"the character '{text[at]}'", "Take it out, or give --dialect")))
    start = BLANKS.match(text, at + 1).end()  # type: ignore[union-attr]
    number = NUMBER_WORD.match(text, start)
    if not number:
        following = text[start : start + 1]
        if printer and (not following or start > at + 1 or following == ";"):
            return Word(letter, ""), start
        if following in ("#", "[", "=", "-", "+") and following:
            found, cure = SIGNS.get(following, ("a sign without a number", PLAIN_NUMBER_CURE))
            block.refuse(f"{letter} with {found}", cure)
        block.refuse(f"{letter} without a number (unknown text)", "Write a number behind every letter")
    end = number.end()
    if text[end : end + 1] == ".":
        block.refuse(f"{letter} with two decimal points", "Write one")
    if text[end : end + 1] in ("E", "e") and letter != "N" and end == len(number[0]) + start:
        block.refuse(f"E directly behind a number ({letter}{number[0]}E)", "Write a space before E")
    return Word(letter, number[0]), end
