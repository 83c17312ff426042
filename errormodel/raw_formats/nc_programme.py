"""NC programmes in G-code as lists of commands; what a pose is: `errormodel.raw_formats.programme_poses`."""

from __future__ import annotations

import re

from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording
from errormodel.raw_formats.programme_poses import MOST_OTHER, Programme, recording_of, setup_and_reading

_BLOCK = re.compile(r"\s*/?\s*(?:[NO]\d+\s*)?(?:[A-Z]=?\s*[-+]?(?:\d+(?:\.\d*)?|\.\d+)\s*)*$", re.IGNORECASE)
_MOTION = re.compile(r"(?<![A-Z])G0*[0-3](?![\d.])", re.IGNORECASE)
_COMMENT = re.compile(r"\([^()]*\)|;.*$")


class NcProgramme(RawFormat):
    """Commands of a programme in mm and degrees of the axes, as the interpreter of ``compensate`` reads it."""

    name = "nc-programme"
    title = "an NC programme"
    source = "NIST IR 6556 (RS274/NGC), and the dialects of errormodel.gcode"
    seen = True
    uses = ("offsets", "at", "dialect")

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        from errormodel.gcode.detect import looks_siemens

        if raw.text is None:
            return False
        lines = [_COMMENT.sub(" ", line).strip() for line in raw.lines]
        lines = [line for line in lines if line and line != "%"]
        blocks = sum(bool(_BLOCK.fullmatch(line)) for line in lines)
        if not lines or blocks < (1 - MOST_OTHER) * len(lines) or not any(map(_MOTION.search, lines)):
            return False
        return not looks_siemens(lines)

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        from errormodel.gcode.programme import Source

        setup, reading = setup_and_reading(raw, asked, asked.dialect)
        return recording_of(raw, Programme(setup, Source.of(raw.name, raw.text or "", reading)))
