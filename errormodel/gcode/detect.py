"""Detection of a programme's dialect by words that only one dialect has; contradictory words are refused.

A programme without such words is plain RS274/NGC, which all of these dialects read alike, except whole numbers: some
FANUC-like controls count ``X10`` in least increments, and ``X10.`` in mm.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from errormodel.exceptions import InputError, nearest
from errormodel.gcode.codes import DIALECTS, UNREAD, WHOLE_NUMBERS, Dialect
from errormodel.gcode.words import Block

AUTO = "auto"
ASK = "Say which it is with --dialect iso, fanuc or printer"
COMMENT_TEXT = re.compile(r"\([^)]*\)?|;.*$")
_WORD = r"(?<![A-Z]){}(?![\d.])"
DIALECT_MARKS = {
    "heidenhain": re.compile(
        r"BEGIN +PGM|END +PGM|TOOL +(CALL|DEF)|CYCL +DEF|^\s*\d+\s+[A-Z]"
        r"|^\s*(L|CC|CR|CT|LP|CP)\s+[IXYZCP][-+XYZ]?[-+\d]"
    ),
    "siemens": re.compile(
        r"TRAORI|TRAFOOF|\bSUPA\b|CYCLE\d|MCALL|\bMSG\b|^\s*(DEF|PROC|REPEAT|WHILE|FOR|EXTERN)\b|%_N_"
        r"|\bCIP\b|\bA?TRANS\b|\bA?ROT\b|\b[A-Z]+\d*\s*=|G(153|500|505|60[1-3]|64[0-9])\b"
        r"|(?<![A-Z])G0*4 *F|^(?!.*G4[12]).*(?<![A-Z])D\d"
    ),
    "printer": re.compile(
        _WORD.format(r"M(73|8[2-4]|10[4-9]|11[0-8]|140|141|190|191|20[0-9]|22[01]|30[02]|400|420|486|5\d\d|600|86\d(\.\d)?|900)")
        + r"|" + _WORD.format("G29") + r"|G0*[0123] .*\bE[-+.\d]|G92 +E"
    ),
    "mill": re.compile(
        r"^\s*%\s*$|^\s*[O:]\d+|" + _WORD.format(r"G0*(4[0-9]|5[3-9]|6[14]|73|76|8[1-9]|9[3-9])(\.\d)?") + r"|"
        + _WORD.format(r"M0*(6|19|30|98|99)")
    ),
    "iso": re.compile(_WORD.format(r"G(8|61\.1|64|59\.[1-3]|90\.1|91\.1)") + r"|^\s*/?\s*O\s*(<|\d+\s*[A-Z])|#<"),
    "fanuc": re.compile(r"^\s*O\d+\s*$|" + _WORD.format(r"G0*(9|15|67)")),
}  # fmt: skip
SIEMENS_UNITS = re.compile(_WORD.format("G(70|71|700|710)"))  # on lathes of others, cycles
TRAILING_POINT = re.compile(r"[XYZABCUVWIJKR][-+]?\d+\.(?!\d)")
WHOLE_NUMBER = re.compile(r"[XYZABCUVWIJKR][-+]?0*[1-9]\d*(?![\d.])")


def dialect_of(asked: str, blocks: Sequence[Block]) -> Dialect:
    """Dialect requested by the user, or detected from the words.

    Raises
    ------
    InputError
        The dialect is not supported, unknown, or ambiguous.
    """
    if asked != AUTO and asked not in DIALECTS:
        if asked in UNREAD:
            raise InputError(f"--dialect {asked}", UNREAD[asked], "Write it as RS274/NGC (ISO), or use tables")
        raise InputError(f"--dialect {asked}", "there is no such dialect", nearest(asked, [AUTO, *DIALECTS, *UNREAD]))
    plain = [(b, COMMENT_TEXT.sub(" ", b.text).upper()) for b in blocks]
    found = {name: next((b for b, t in plain if mark.search(t)), None) for name, mark in DIALECT_MARKS.items()}
    if asked != AUTO:
        return DIALECTS[asked]
    for foreign, title in UNREAD.items():
        block = found[foreign]
        if block and not (foreign == "siemens" and found["printer"]):
            what = "tool centre point control (TRAORI), " if "TRAORI" in block.text.upper() else ""
            block.refuse(f"{what}{title}", "Write plain positions of the axes in mm as RS274/NGC (ISO)")
    for one, other in (("printer", "mill"), ("iso", "fanuc"), ("printer", "iso"), ("printer", "fanuc")):
        a, b = found[one], found[other]
        if a and b:
            a.refuse(f"words of {_title(one)}, and in line {b.number} of {_title(other)}", ASK)
    name = next((n for n in ("printer", "fanuc") if found[n]), "iso")
    if name == "iso" and not found["iso"]:
        points = next((b for b, t in plain if TRAILING_POINT.search(t)), None)
        whole = next((b for b, t in plain if WHOLE_NUMBER.search(t)), None)
        if points and whole:
            found_text = f"a number without a decimal point, and one as '10.' in line {points.number}"
            whole.refuse(
                f"{found_text}: on some controls the former counts in least increments", f"Say {WHOLE_NUMBERS}"
            )
    return DIALECTS[name]


def looks_siemens(lines: Sequence[str]) -> bool:
    """Whether lines, in capitals and without comments, have words of Siemens' controls and none of a printer's."""
    own = any(DIALECT_MARKS["siemens"].search(line) or SIEMENS_UNITS.search(line) for line in lines)
    return own and not any(map(DIALECT_MARKS["printer"].search, lines))


def _title(mark: str) -> str:
    return DIALECTS[mark].title if mark in DIALECTS else "a milling machine"
