"""Information that a programme does not state: dialect, work offsets, positions of the axes after commands.

Positions are those of the axes (machine coordinates) in mm and degrees, whatever units the programme has.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from errormodel.exceptions import InputError
from errormodel.gcode.detect import AUTO

Place = Mapping[str, float]  # position by axis letter
START, STAY, UNKNOWN = "START", "stay", "unknown"
AXIS = re.compile(r"([A-Z])=?([-+]?(?:\d+\.?\d*|\.\d+))")
OFFSET_NAME = re.compile(r"G5[4-9](\.[123])?|H\d+")
OFFSET_COMMENT = re.compile(r"\(\s*ERRORMODEL OFFSET([^()]*)\)", re.IGNORECASE)
EXAMPLE = "X100,Y-20.5,Z310"


@dataclass(frozen=True)
class Reading:
    """Settings for reading a programme.

    Attributes
    ----------
    dialect : `auto`, or a name of `codes.DIALECTS`.
    offsets : offsets from programme positions to those of the axes (mm, deg), by ``G54`` to ``G59.3`` and ``H1`` (tool
        length); the empty name stands for the active work offset if the programme names none, or only one.
    after : positions of the axes after a command (``M6``, ``G28``), and at ``START``; `STAY`, `UNKNOWN` or positions.
        Axes that are not named are unknown.
    """

    dialect: str = AUTO
    offsets: Mapping[str, Place] = field(default_factory=dict)
    after: Mapping[str, Place | str] = field(default_factory=dict)

    @classmethod
    def of(cls, dialect: str = AUTO, offsets: Sequence[str] = (), after: Sequence[str] = ()) -> Reading:
        """Parse options of the command line, ``G54=X100,Y-20`` or ``X100,Y-20``; ``M6=stay``, ``start=X0,Y0,Z0``.

        Raises
        ------
        InputError
            One cannot be read, or stands twice.
        """
        places: dict[str, Place] = {}
        for text in offsets:
            shown = text.upper()
            name, _, rest = shown.partition("=") if OFFSET_NAME.match(shown) else ("", "", shown)
            if name and not OFFSET_NAME.fullmatch(name):
                raise InputError(
                    f"--offset {text}", f"'{name}' is no work offset", f"Write G54={EXAMPLE}, or H1=Z120.5"
                )
            if name in places:
                raise InputError(f"--offset {text}", "it is given twice", "Give it once")
            places[name] = positions(f"--offset {text}", rest)
        stands: dict[str, Place | str] = {}
        for text in after:
            name, sign, rest = text.upper().partition("=")
            name = re.sub(r"(?<=[A-Z])0+(?=\d)", "", name)
            if not sign or not re.fullmatch(r"START|[MT]\d+(\.\d+)?|T|G(28|29|30|34|80)|[A-Z_][A-Z_0-9]{2,}", name):
                cure = f"Write start={EXAMPLE}, M6=stay, G28=Z0 or M19=stay"
                raise InputError(f"--at {text}", "it names no start and no command", cure)
            if name in stands:
                raise InputError(f"--at {text}", "it is given twice", "Give it once")
            stands[name] = rest.lower() if rest.lower() in (STAY, UNKNOWN) else positions(f"--at {text}", rest)
        return cls(dialect, places, stands)

    def with_comment(self, file: str, text: str) -> Reading:
        """Add the offset stated in a comment of the programme, ``(ERRORMODEL OFFSET X100 Y-20 Z310)``.

        Raises
        ------
        InputError
            It cannot be read, or an option or another comment states an offset, too.
        """
        stated = OFFSET_COMMENT.findall(text)
        if not stated:
            return self
        if len(stated) > 1 or self.offsets.get("") is not None:
            raise InputError(file, "its offset is stated twice (ERRORMODEL OFFSET, --offset)", "State it once")
        place = positions(f"{file}, ERRORMODEL OFFSET{stated[0]}", ",".join(stated[0].upper().split()))
        return Reading(self.dialect, {**self.offsets, "": place}, self.after)


def positions(where: str, text: str) -> Place:
    """Positions by axis letter of ``X100,Y-20``.

    Raises
    ------
    InputError
        One cannot be read, or stands twice.
    """
    out: dict[str, float] = {}
    for part in text.replace(" ", "").split(","):
        match = AXIS.fullmatch(part)
        if not match or match[1] in out:
            found = f"'{part}' is {'there twice' if match else 'no letter with a number'}"
            raise InputError(where, found, f"Write positions as {EXAMPLE}")
        out[match[1]] = float(match[2])
    return out
