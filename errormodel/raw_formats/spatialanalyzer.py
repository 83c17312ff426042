"""Point lists of SpatialAnalyzer: comment lines, then collection, group, point, x, y, z, with or without a date."""

from __future__ import annotations

import re
from dataclasses import replace

from errormodel.exceptions import InputError
from errormodel.raw_formats.base import Asked, DateOrder, RawFile, RawFormat, Recording
from errormodel.raw_formats.delimited_table import DelimitedTable
from errormodel.raw_formats.table_columns import DATES_CURE, renamed, table_of_text
from errormodel.raw_formats.table_columns import columns_of as plain_columns
from errormodel.raw_formats.unit_words import quantity_of_unit, unit_word

_AXES = re.compile(r"AXES\s*=\s*(\w+)\s*:\s*([^()]*)\(([^()]*)\)", re.IGNORECASE)
_UNITS = re.compile(r"\bUnits?\s*[:=]\s*(\w+)", re.IGNORECASE)
_FRAME = re.compile(r"Relative to Coordinate Frame\s*'([^']*)'", re.IGNORECASE)


class SpatialAnalyzerPoints(RawFormat):
    """Lists whose comment lines name SpatialAnalyzer and the unit; several groups are several runs."""

    name = "spatialanalyzer-points"
    title = "a point list of SpatialAnalyzer"
    source = "the comment lines of the files themselves; SpatialAnalyzer users manual, File, Export, ASCII"
    seen = True

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        head = "\n".join(raw.lines[:20]).lower()
        return "spatialanalyzer" in head and "//" in head

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        table = table_of_text(raw)
        width = len(table.names)
        places = [k for k in range(width) if table.numeric(k)]
        # collection, group and point stand before three coordinates; a point's name is often a number
        first = next(
            (k for k in range(1, width - 2) if {k, k + 1, k + 2} <= {*places} and k >= min(3, width - 3)), None
        )
        if first is None:
            found = f"columns {', '.join(table.names)}, of which no three in a row are coordinates"
            raise InputError(
                raw.name, found, "Export collection, group, point, X, Y, Z; or name --format and --columns"
            )
        comments = "\n".join(table.comments)
        axes = _AXES.search(comments)
        if axes and axes[1].upper() != "CARTESIAN":
            raise InputError(raw.name, f"{axes[1].lower()} coordinates", "Export cartesian coordinates")
        unit = unit_word(axes[3].split(",")[0]) if axes else ""
        unit = unit or next((u for u in table.units[first : first + 3] if u), "")  # X,Y,Z (mm) in a line of names
        stated = _UNITS.search(comments)
        unit = unit or (unit_word(stated[1]) if stated else "")
        if quantity_of_unit(unit) != "length":
            found = f"no unit of length above the points{f' but {unit!r}' if unit else ''}"
            raise InputError(
                raw.name, found, f"Export with its comments, or write --format {DelimitedTable.name} --units length=mm"
            )
        order: DateOrder = asked.dates or "month-first"
        recording = plain_columns(raw, Asked(dates=order))
        heads = ("collection", "group", "point")[-min(first, 3) :] if first <= 3 else ("collection", "group", "point")
        names = {table.names[k + first - len(heads)]: name for k, name in enumerate(heads)}
        names |= dict(zip(table.names[first : first + 3], ("mx", "my", "mz"), strict=True))
        recording = renamed(recording, names)
        frame = recording.frame
        for name in heads:
            column = frame[name]
            if column.dtype.kind == "f":
                frame[name] = [f"{v:g}" for v in column]
        if "group" in frame:
            whole = frame["collection"] + "/" + frame["group"] if "collection" in frame else frame["group"]
            if whole.nunique() > 1:
                frame["group"] = whole
            frame = frame.drop(columns=["collection"], errors="ignore")
        notes = list(recording.notes)
        where = _FRAME.search(comments)
        if where:
            notes.append(f"points in the frame {where[1]}")
        if "time" in frame and not asked.dates and any(n.startswith("dates read month") for n in notes):
            notes.append("the dates leave the order open and are read as SpatialAnalyzer writes them. " + DATES_CURE)
        return replace(recording, frame=frame, units=dict.fromkeys(("mx", "my", "mz"), unit), notes=tuple(notes))
