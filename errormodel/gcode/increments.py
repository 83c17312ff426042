"""Numbers without a decimal point as FANUC-like controls count them: in least input increments (IS-B).

Source: FANUC B-64484EN, "Decimal point programming" and "Increment system": 0.001 mm, 0.001 degrees, 0.0001 inches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from decimal import Decimal

from errormodel.gcode.cycles import CYCLES
from errormodel.gcode.words import Block, Word

ENDS_CYCLE = {"G0", "G1", "G2", "G3", "G80"}  # until then K counts repeats
LENGTHS, ANGLES = "XYZUVWIJKRQ", "ABC"
MILLIMETRES, INCHES = 3, 4  # decimal places that a whole number has


def in_plain_numbers(blocks: Sequence[Block]) -> list[Block]:
    """The blocks with their positions in mm, inches and degrees; G20 and G21 hold from their own block on."""
    inch, cycle, out = False, False, []
    for block in blocks:
        codes = block.codes("G")
        inch = "G20" in codes or (inch and "G21" not in codes)
        cycle = any(c in CYCLES for c in codes) or (cycle and not ENDS_CYCLE & {*codes})
        counts = f"K{'XP' * ('G4' in codes)}" if cycle or "G4" in codes else ""
        places = INCHES if inch else MILLIMETRES
        words = tuple(w if w.letter in counts else _plain(w, places) for w in block.words)
        out.append(block if words == block.words else replace(block, words=words))
    return out


def _plain(word: Word, places: int) -> Word:
    if word.letter not in LENGTHS + ANGLES or "." in word.text or not word.text:
        return word
    places = MILLIMETRES if word.letter in ANGLES else places
    return replace(word, text=f"{Decimal(word.text).scaleb(-places):f}")
