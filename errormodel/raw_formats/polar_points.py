"""Points in polar coordinates, as total stations and trackers read them: horizontal angle, zenith or elevation, range.

Angles need a unit (deg, gon, rad ...), in the file or by ``--units``. A horizontal direction (Hz) counts clockwise seen
from above, as a theodolite's does; an azimuth (Az, theta) counterclockwise, as in the frames of trackers. A file that
means it otherwise gives the mirror image, which an import refuses: turn it with ``--columns my=-my``.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from errormodel.arrays import Array
from errormodel.exceptions import InputError
from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording
from errormodel.raw_formats.layout import Layout
from errormodel.raw_formats.table_columns import columns_of, numbers
from errormodel.raw_formats.unit_words import quantity_of_unit, unit_word
from errormodel.units import is_unit, to_internal

_WORDS = {
    "direction": r"hz|ha|horizontal(angle|direction)?|hrichtung|hwinkel|horizontalwinkel",
    "azimuth": r"az|azi|azimuth?(angle)?|theta",
    "zenith": r"v|z[ad]|zen|zenith?(angle|distance)?|vertical(angle)?|vwinkel|vertikalwinkel|polar(angle)?",
    "elevation": r"el|elev|elevation(angle)?",
    "range": r"d|r|s|sd|rho|range|dist|distance|slope(dist(ance)?)?|strecke|schr(ae|\u00e4)gstrecke|radius",
}


class PolarPoints(RawFormat):
    """A table with one column of each kind and no coordinates; ranges become mm, angles cartesian coordinates."""

    name = "polar-points"
    title = "points in polar coordinates"
    source = "conventions of theodolites (ISO 17123-3) and of trackers (ASME B89.4.19); no public recording"
    columns = ("direction", "azimuth", "zenith", "elevation", "range")

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        table = raw.clear_layout
        if table is None or not table.named or {"x", "y", "z"} & {*table.keys}:
            return False
        own = _places(table)
        return len({"direction", "azimuth"} & {*own}) == len({"zenith", "elevation"} & {*own}) == 1 and "range" in own

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        recording = columns_of(raw, asked, by_rows=True)
        table = raw.layout
        own = {word: table.names[k] for word, k in _places(table).items()} if table is not None else {}
        turned = "direction" if "direction" in own else "azimuth"
        upright = "zenith" if "zenith" in own else "elevation"
        about = _radians(recording, own[turned], turned, raw.name, asked)
        tilt = _radians(recording, own[upright], upright, raw.name, asked)
        zenith = tilt if upright == "zenith" else np.pi / 2 - tilt
        span = numbers(recording, own["range"], raw.name)
        flat = span * np.sin(zenith)
        frame = recording.frame.drop(columns=[*own.values()])
        across, along = flat * np.sin(about), flat * np.cos(about)
        frame["mx"], frame["my"] = (across, along) if turned == "direction" else (along, across)
        frame["mz"] = span * np.cos(zenith)
        unit = asked.units.get("range", "") or recording.units.get(own["range"], "") or recording.length_unit
        units = {n: u for n, u in recording.units.items() if n in frame}
        units |= dict.fromkeys(("mx", "my", "mz"), unit or "mm")
        sense = "clockwise from above" if turned == "direction" else "counterclockwise from above"
        height = "from the zenith" if upright == "zenith" else "above the horizon"
        notes = [f"{own[turned]} read {sense}, {own[upright]} {height}"]
        if not unit:
            notes.append("no unit of the ranges in the file: taken as mm")
        return replace(recording, frame=frame, units=units, notes=(*recording.notes, *notes), length_unit="")


def _places(table: Layout) -> dict[str, int]:
    """The first column of numbers of each kind."""
    out: dict[str, int] = {}
    for key, place in table.keys.items():
        word = next((w for w, p in _WORDS.items() if key == w or re.fullmatch(p, key)), "")
        if word and table.numeric(place):
            out.setdefault(word, place)
    return out


def _radians(recording: Recording, name: str, word: str, file: str, asked: Asked) -> Array:
    unit = unit_word(asked.units.get(word, "") or recording.units.get(name, ""))
    if quantity_of_unit(unit) != "angle" and not (unit and is_unit(unit, "angle")):
        found = f"the unit '{unit}'" if unit else "angles without a unit"
        raise InputError(f"{file}, column {name}", found, f"Say it with --units {word}=deg, gon, rad, or what it is")
    return np.asarray(to_internal(numbers(recording, name, file), unit, "angle"))
