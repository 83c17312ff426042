"""Traces of a telescoping ballbar as text: angle and radius, or radial deviation, with the nominal radius above.

The makers' own files are not described in public. Read is what their programs export as a table: a line of keys such as
``Radius: 150`` above columns of angle and deviation. A trace has no coordinates: its rows are lengths.
"""

from __future__ import annotations

import re

import numpy as np

from errormodel.arrays import Array
from errormodel.exceptions import InputError
from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording
from errormodel.raw_formats.commanded_circle import senses_of
from errormodel.raw_formats.direction_words import turning
from errormodel.raw_formats.table_columns import columns_of, numbers
from errormodel.raw_formats.unit_words import unit_word
from errormodel.units import factor, is_unit, to_internal

_ANGLE = re.compile(r"angle|theta|phi|winkel|position\(deg\)", re.IGNORECASE)
_DEVIATION = re.compile(r"(radial|radius)?\s*(deviation|error|abweichung)|delta\s*r(adius)?|dr", re.IGNORECASE)
_RADIUS = re.compile(r"(measured\s*)?(radius|length|r)|l\u00e4nge", re.IGNORECASE)
_VALUE = r"\s*[:=,;\t]?\s*(\d+(?:[.,]\d+)?)\s*(mm|inch|in)?"
_CALIBRATED = re.compile(
    r"(?:calibrated\s*(?:ballbar\s*)?(?:radius|length)|kalibrierte[rs]?\s*(?:radius|l\u00e4nge))" + _VALUE,
    re.IGNORECASE,
)
_NOMINAL = re.compile(
    r"(?<!calibrated )(?<!calibrated ballbar )(?:nominal\s*|nenn)?(?:test\s*)?(?:ballbar\s*)?(?:radius|length)"
    + _VALUE,
    re.IGNORECASE,
)
_PLANE = re.compile(r"(?:(?:test\s*)?plane|ebene)\s*[:=,;\t]?\s*(XY|YZ|ZX|XZ|ZY|YX)\b", re.IGNORECASE)
CYCLIC = ("XY", "YZ", "ZX")  # planes in which counter-clockwise is from the first axis to the second (ISO 841)
TURN = 2  # rows beside a change of the sense
_FEED = re.compile(r"(?:feed(?:\s*rate)?|vorschub)\s*[:=,;\t]?\s*(\d+(?:\.\d*)?)", re.IGNORECASE)


class BallbarTrace(RawFormat):
    """Angle of the bar and its length; ``side`` is 1 where the angle grows (counter-clockwise), else -1."""

    name = "ballbar-trace"
    title = "a trace of a ballbar"
    source = "tables as laboratories export them; the makers' own files are not public (ISO 230-4 for the quantities)"

    columns = ("angle", "deviation", "length")

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        table = raw.clear_layout
        if table is None or not table.named or not 2 <= len(table.names) <= 5:
            return False
        names = [n.strip() for n in table.names]
        angle = any(_ANGLE.fullmatch(n) for n in names)
        return angle and any(_DEVIATION.fullmatch(n) or _RADIUS.fullmatch(n) for n in names)

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        import pandas as pd

        recording = columns_of(raw, asked)
        frame = recording.frame
        names = [str(n) for n in frame]
        angle = next(n for n in names if _ANGLE.fullmatch(n))
        head = "\n".join((*(raw.layout.preamble if raw.layout else ()), *(raw.layout.comments if raw.layout else ())))
        unit = unit_word(asked.units.get("angle", recording.units.get(angle, "deg")))
        if not is_unit(unit, "angle"):
            raise InputError(
                f"{raw.name}, column {angle}", f"the unit '{unit}'", "Say it with --units angle=deg, or rad"
            )
        turned: Array = np.unwrap(to_internal(numbers(recording, angle, raw.name), unit, "angle"))
        reading = next((n for n in names if _DEVIATION.fullmatch(n)), None)
        reach, calibrated = _size(_NOMINAL.search(head)), float("nan")
        radius = asked.circle.radius if asked.circle is not None and asked.circle.radius else reach
        if reading is not None:
            own = unit_word(asked.units.get("deviation", recording.units.get(reading, "")))
            if not is_unit(own or "?", "length"):
                what = f"the unit '{own}'" if own else "no unit"
                raise InputError(raw.name, f"{what} of the column {reading}", "Say it with --units deviation=um, or mm")
            calibrated = _size(_CALIBRATED.search(head))
            reach = calibrated if np.isfinite(calibrated) else float(radius)
            if not np.isfinite(reach):
                raise InputError(raw.name, "deviations without the nominal length", "Say it with --radius, in mm")
            length = reach + to_internal(numbers(recording, reading, raw.name), own, "length")
        else:
            reading = next(n for n in names if _RADIUS.fullmatch(n))
            own = unit_word(asked.units.get("length", recording.units.get(reading, "mm")))
            if not is_unit(own, "length"):
                raise InputError(raw.name, f"the unit '{own}' of the column {reading}", "Say it with --units length=mm")
            length = to_internal(numbers(recording, reading, raw.name), own, "length")
        side, listed = _stated_senses(raw, recording, senses_of(turned), asked, head)
        stated = {
            name: match[1].upper() for name, p in (("plane", _PLANE), ("feed", _FEED)) if (match := p.search(head))
        }
        notes = (*recording.notes, *listed, f"{len(length)} lengths from {length.min():.4f} to {length.max():.4f} mm")
        if asked.circle is None or asked.machine is None:
            table = pd.DataFrame({"angle": np.degrees(turned), "length": length, "side": side})
            if "plane" in stated:
                table["plane"] = stated["plane"]
        else:
            circle = asked.circle
            table = circle.commands(asked.machine, turned, side, stated.get("plane", ""), float(radius), raw.name)
            reach = reach if np.isfinite(reach) else float(radius)
            table["length"] = length - reach
        if "feed" in stated:
            table["feed"] = float(stated["feed"])
        if "time" in frame:
            table["time"] = frame["time"]
        units = {"angle": "deg", "length": "mm"}
        return Recording(
            table, {k: u for k, u in units.items() if k in table}, recording.lines, notes, recording.dated,
            trace="circle", reach=reach, calibrated=bool(np.isfinite(calibrated)),
        )  # fmt: skip


def _size(match: re.Match[str] | None) -> float:
    """A length in mm that the head of a file states; NaN where it states none, or something else (300 mM)."""
    if match is None or not is_unit(unit := unit_word(match[2] or "mm"), "length"):
        return float("nan")
    return float(match[1].replace(",", ".")) * factor(unit, "length")


def _stated_senses(
    raw: RawFile, recording: Recording, side: Array, asked: Asked, head: str
) -> tuple[Array, tuple[str, ...]]:
    """Senses (n,) by a column of words where the angles of both are listed in one order, else as they run; notes.

    Raises
    ------
    InputError
        The words contradict the angles.
    """
    for name in map(str, recording.frame):
        column = recording.frame[name]
        said = turning(column) if column.dtype.kind not in "fiu" else None
        if said is None:
            continue
        turns = np.flatnonzero(np.diff(side) != 0) + 1
        near = np.zeros(len(side), dtype=bool)
        for k in turns:  # where the sense changes, a row may count to either
            near[max(k - TURN, 0) : k + TURN] = True
        product = (said * side)[~near]
        if not len(product):
            continue
        differs = np.flatnonzero(~near)[product != np.sign(product.sum() or 1.0)]
        stated = _PLANE.search(head)
        plane = (asked.circle.plane if asked.circle is not None else "") or (stated[1].upper() if stated else "")
        blocks = np.split(np.arange(len(side)), np.flatnonzero(np.diff(said)) + 1)
        if len(differs) and len(blocks) > 1 and all(len({*side[b][~near[b]].tolist()}) < 2 for b in blocks):
            note = f"angles of both directions in one order: the direction of travel is that of the column {name}"
            return (said if plane in CYCLIC else -said), (note,)
        if len(differs):
            row = int(differs[0])
            line = f"line {recording.lines[row]}, " if recording.lines else ""
            found = f"{column.iloc[row]} where the angle {'grows' if side[row] > 0 else 'falls'}, unlike in other rows"
            raise InputError(f"{raw.name}, {line}column {name}", found, "Give the trace as the instrument wrote it")
        if product[0] < 0 and plane in CYCLIC:
            word = column.iloc[int(np.flatnonzero(~near)[0])]
            found = (
                f"{word} where the angle {'grows' if side[~near][0] > 0 else 'falls'} from {plane[0]} to {plane[1]} "
                f"(in {plane} that is {'counter-clockwise' if side[~near][0] > 0 else 'clockwise'})"
            )
            cure = f"If the angle counts clockwise from {plane[0]}, say --plane {plane[::-1]} --start 90"
            raise InputError(f"{raw.name}, column {name}", found, f"{cure}; else say which axes it counts between")
        break
    return side, ()
