"""Grammar of a block: permitted combinations of words, and the modal state after it.

Sources: NIST IR 6556, section 3.3.2 (repeated items), tables 4 and 5; LinuxCNC manual, "G-code overview".
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isfinite
from typing import TYPE_CHECKING

from errormodel.gcode.codes import MOTION, REFUSED, WHOLE_NUMBERS, Dialect
from errormodel.gcode.words import Block

if TYPE_CHECKING:
    from errormodel.gcode.steps import Modes

FIELDS = {
    MOTION: "motion", "plane": "plane", "distance": "distance", "arc distance": "arc", "units": "units",
    "feed mode": "feed", "work offset": "origin", "path": "path",
    "return": "back",
}  # fmt: skip
COORDINATES = "IJKR"


@dataclass(frozen=True)
class Codes:
    """G and M codes of a block by modal group; `event`: the one that moves axes by rules of its own."""

    groups: Mapping[str, str] = field(default_factory=dict)
    event: str = ""

    @cached_property
    def all(self) -> frozenset[str]:
        """Every code."""
        return frozenset(self.groups.values())

    def __contains__(self, code: str) -> bool:
        return code in self.all


def check(block: Block, dialect: Dialect, axes: Sequence[str], stated: Collection[str], also: str = "") -> Codes:
    """Codes of a block whose words are all understood.

    Parameters
    ----------
    axes : letters of the machine's axes.
    stated : commands after which the user stated the positions of the axes; they are permitted as well.
    also : further letters, those of a canned cycle.

    Raises
    ------
    InputError
        A word is not understood, repeated, or misplaced.
    """
    if block.extended:
        return _extended(block, dialect, stated)
    if dialect.printer:
        _one_command(block)
    groups: dict[str, str] = {}
    event = ""
    for word in block.words:
        if word.letter not in "GM":
            continue
        code = word.code
        if code in REFUSED and code not in dialect.groups:
            block.refuse(*REFUSED[code])
        group = dialect.groups.get(code, code if code in stated and code[0] == "M" else "")
        if not group:
            cure = (
                f"Take it out, or say with --at {code}=stay that it moves no axis" if code[0] == "M" else "Take it out"
            )
            block.refuse(f"{word} is not understood ({dialect.title})", cure)
        if group in groups:
            block.refuse(f"{groups[group]} and {code} in one block", "Write one of them")
        groups[group] = code
        if code in dialect.moving or (code in stated and code[0] == "M"):
            if event:
                block.refuse(f"{event} and {code} in one block", "Write a block for each")
            event = code
    if dialect.printer and block.has("T") and block.words[0].letter == "T":
        event = next((t for t in (block.words[0].code, "T") if t in stated), "T")
    codes = Codes(groups, event)
    _letters(block, dialect, axes, codes, also)
    _belong(block, dialect, axes, codes)
    return codes


def _extended(block: Block, dialect: Dialect, stated: Collection[str]) -> Codes:
    if block.extended in dialect.groups:
        return Codes({dialect.groups[block.extended]: block.extended})
    if block.extended not in stated:
        found = f"{block.extended} is not understood ({dialect.title})"
        block.refuse(found, f"Say with --at {block.extended}=stay, =unknown or =X..,Y..,Z.. where it leaves the axes")
    return Codes({}, block.extended)


def _one_command(block: Block) -> None:
    """Refuse a second command in a line, since Marlin and Klipper read one per line."""
    first, *others = block.words
    if first.letter not in "GMT" or not first.text:
        block.refuse(
            f"{first} where a command belongs", "Write G, M or T first: printers keep no motion for the next line"
        )
    if block.label:
        block.refuse(f"a line number ({block.label})", "Write the programme without line numbers")
    if any(w.letter in "GM" for w in others):
        block.refuse("two commands in one line", "Write a line for each")


def _letters(block: Block, dialect: Dialect, axes: Sequence[str], codes: Codes, also: str) -> None:
    free = dialect.printer and (block.words[0].letter == "M" or bool(codes.event))
    extras = "".join(v for k, v in dialect.extras.items() if k in codes) + also
    seen = set()
    for word in block.words:
        letter = word.letter
        if letter in "GM":
            continue
        if letter in seen:
            block.refuse(f"{letter} twice", "Write one")
        seen.add(letter)
        if word.text and not isfinite(word.value):
            block.refuse(f"{letter} with too large a number", "Write a position that the machine reaches")
        if letter == "F" and word.text and word.value < 0:
            block.refuse(f"{word}, a negative feed", "Write a positive one")
        if free:
            continue
        if not word.text:
            block.refuse(f"{letter} without a number", "Write a number behind every letter")
        if letter in axes:
            zero = not word.value or "." in word.text
            if dialect.points and not zero and "G4" not in codes:
                _pointless(block, str(word))
        elif letter not in dialect.letters + extras:
            known = letter in "XYZABCUVW"
            found = f"{word}, and the machine has no axis {letter}" if known else f"{word} is not understood here"
            block.refuse(found, "Take it out" if known else f"Take it out, or give --dialect (this is {dialect.title})")
        elif (
            dialect.points
            and letter in COORDINATES
            and (letter == "R" or not also)
            and word.value
            and "." not in word.text
        ):
            _pointless(block, str(word))


def _pointless(block: Block, word: str) -> None:
    found = f"{word} without a decimal point, which some of these controls count in least increments"
    block.refuse(found, f"Say {WHOLE_NUMBERS}; or write {word}.")


def _belong(block: Block, dialect: Dialect, axes: Sequence[str], codes: Codes) -> None:
    moving = [a for a in axes if block.has(a)]
    single = codes.groups.get("one line", "")
    motion = codes.groups.get(MOTION, "")
    if single not in ("", "G9", "G53") and motion:
        block.refuse(f"{single} and {motion} in one block", "Write a block for each")
    if codes.event and codes.event not in ("G28", "G29", "G30") and not dialect.printer and (moving or motion):
        block.refuse(f"{codes.event} in a block that moves", f"Write {codes.event} in a block of its own")
    if "tool length" in codes.groups and (codes.event or single):
        block.refuse(
            f"{codes.groups['tool length']} and {codes.event or single} in one block", "Write a block for each"
        )
    if "G4" in codes and any(a not in dialect.extras.get("G4", "") for a in moving):
        block.refuse(f"G4 with {', '.join(moving)}", "Write the dwell with P")
    if "G80" in codes and moving:
        block.refuse("G80 with positions", "Write G80 in a block of its own")
    if dialect.printer and {"G92", "G10", "G11"} & codes.all:
        allowed = ["E"] if "G92" in codes else []
        if [w.letter for w in block.words[1:]] != allowed:
            block.refuse(
                f"{block.words[0]} with other words than {allowed or 'none'}", "Write G92 E0, G10 or G11 alone"
            )


def no_path_words(block: Block) -> None:
    """Raise InputError where a block that is no arc has words of one."""
    for letter in COORDINATES:
        if block.has(letter):
            block.refuse(f"{letter} without an arc (G2, G3)", "Take it out, or write G2 or G3 with it")


def modes_behind(modes: Modes, codes: Codes) -> Modes:
    """Modal state after the codes of a block."""
    if not codes.groups:
        return modes
    return replace(modes, **{FIELDS[g]: code for g, code in codes.groups.items() if g in FIELDS})
