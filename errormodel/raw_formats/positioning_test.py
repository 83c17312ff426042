"""Tables of positioning tests (ISO 230-2): target, measured position or deviation, cycle or run, direction."""

from __future__ import annotations

import re

import numpy as np

from errormodel.conventions import MOTIONS, unit_of
from errormodel.exceptions import InputError
from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording
from errormodel.raw_formats.direction_words import sides
from errormodel.raw_formats.positioning import joint_for, motion_rows
from errormodel.raw_formats.table_columns import columns_of, numbers
from errormodel.raw_formats.unit_words import unit_word
from errormodel.units import Quantity, is_unit, to_internal

_TARGET = re.compile(r"target(position|pos|no)?|nominal(position)?|setpoint|soll(wert|position)?|ziel(wert|position)?")
_ACTUAL = re.compile(r"(actual|measured|read|ist)?(position|pos)|actual|measured|reading|ist(wert)?|messwert")
_DEVIATION = re.compile(r"(position(s|ier)?)?(deviation|error|dev|abweichung)")
_CYCLE = re.compile(r"cycle|run|pass|series|repeat|lauf|zyklus|serie|messlauf")
_SIDE = re.compile(r"dir(ection)?|approach|side|(anfahr)?richtung")
_UNIT = re.compile(r"_(mm|um|inch|deg|arcsec|urad|rad)$")


def _places(names: list[str]) -> dict[str, str]:
    """Columns of a positioning test by what they hold."""
    out: dict[str, str] = {}
    for name in names:
        bare = re.sub(r"[\s_.]+", "", _UNIT.sub("", name.lower()))
        for what, pattern in (("target", _TARGET), ("cycle", _CYCLE), ("side", _SIDE), ("deviation", _DEVIATION)):
            if what not in out and pattern.fullmatch(bare):
                out[what] = name
                break
        else:
            if "actual" not in out and _ACTUAL.fullmatch(bare):
                out["actual"] = name
    if "target" not in out and "deviation" in out and "actual" in out:  # positions beside their deviations
        out["target"] = out.pop("actual")
    return out


class PositioningTest(RawFormat):
    """One joint's readings at its targets; they become its error motion along its axis."""

    name = "positioning-test"
    title = "a positioning test of one joint"
    source = "ISO 230-2, table of measured deviations; names of columns as laboratories write them"
    seen = True
    uses = ("joint",)
    columns = ("target", "actual", "deviation", "run", "cycle", "direction")

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        table = raw.clear_layout
        if table is None or not table.named:
            return False
        found = _places([*table.names])
        return (
            "target" in found and {*found} & {"actual", "deviation"} != set() and {*found} & {"cycle", "side"} != set()
        )

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        table = columns_of(raw, asked)
        found = _places([str(n) for n in table.frame])
        frame = table.frame
        unit = unit_word(asked.units.get("target", table.units.get(found["target"], "mm")))
        joint = joint_for(raw.name, asked, "", rotary=is_unit(unit, "angle"))
        usual = "deg" if joint.type == "rotary" else "mm"
        quantity: Quantity = "angle" if joint.type == "rotary" else "length"
        target = numbers(table, found["target"], raw.name)
        if "deviation" in found:
            reading = numbers(table, found["deviation"], raw.name)
            own = unit_word(asked.units.get("deviation", table.units.get(found["deviation"], "")))
            if not is_unit(own or "?", quantity):
                what = f"the unit '{own}'" if own else "no unit"
                cure = f"Say it with --units deviation={'arcsec' if joint.type == 'rotary' else 'um'}, or what it is"
                raise InputError(raw.name, f"{what} of the column {found['deviation']}", cure)
        else:
            own = "rad" if joint.type == "rotary" else "mm"
            actual = numbers(table, found["actual"], raw.name)
            stated = unit_word(asked.units.get("actual", table.units.get(found["actual"], unit)))
            reading = to_internal(actual, stated, quantity) - to_internal(target, unit, quantity)
        side = np.full(len(frame), np.nan)
        if "side" in found:
            name = found["side"]
            side = sides(frame[name], lambda row: f"{raw.name}, line {table.lines[row]}, column {name}")
        run = (
            [f"{c:g}" if isinstance(c, float) else str(c) for c in frame[found["cycle"]]]
            if "cycle" in found
            else ["1"] * len(frame)
        )
        position = to_internal(target, unit, quantity)
        rows = motion_rows(joint, np.degrees(position) if usual == "deg" else position, reading, own, run, side)
        units = {joint.name: usual} | {name: unit_of(name) for name in MOTIONS if name in rows}
        return Recording(rows, units, table.lines, (*table.notes, f"readings of {joint.name} along its axis"))
