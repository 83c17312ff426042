"""Point lists without a header: a name and three coordinates, as FARO CAM2, API and most tracker software export them.

Neither names nor units stand in such files: coordinates are in mm unless the user says otherwise.
"""

from __future__ import annotations

from dataclasses import replace

from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording
from errormodel.raw_formats.layout import Layout
from errormodel.raw_formats.table_columns import columns_of, renamed, table_of_text

LARGEST_NUMBER = 1e6  # of a point that is numbered


class TrackerPoints(RawFormat):
    """Four columns, the first a name or a whole number; three columns of coordinates alone are read too."""

    name = "tracker-points"
    title = "a list of points: name, x, y, z"
    source = "lists as found in public recordings; fields in the order of the export dialogs"
    seen = True

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        table = raw.clear_layout
        if table is None or table.named or "spatialanalyzer" in " ".join(raw.lines[:20]).lower():
            return False
        width = len(table.names)
        if width not in (3, 4) or not all(table.numeric(k) for k in range(width - 3, width)):
            return False
        return width == 3 or _is_label(table)

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        table = table_of_text(raw)
        names = ("point", "mx", "my", "mz")[4 - len(table.names) :]
        recording = renamed(columns_of(raw, asked), dict(zip(table.names, names, strict=True)))
        if "point" in names:
            recording.frame["point"] = table.column(0)
        return replace(recording, notes=(*recording.notes, "no units in the file: coordinates taken as mm"))


def _is_label(table: Layout) -> bool:
    """Whether the first column names points: text, or whole numbers."""
    cells = table.column(0)
    return not table.numeric(0) or all(c.strip().isdecimal() and int(c) < LARGEST_NUMBER for c in cells)
