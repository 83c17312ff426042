"""Point lists without a header: names and three coordinates, as FARO CAM2, API and most tracker software export them.

Neither names nor units stand in such files: coordinates are in mm unless the user says otherwise.
"""

from __future__ import annotations

from dataclasses import replace

from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording
from errormodel.raw_formats.layout import Layout
from errormodel.raw_formats.positioning_runs import runs_in
from errormodel.raw_formats.table_columns import columns_of, renamed, table_of_text

HEADS = ("collection", "group", "point")
LARGEST_NUMBER = 1e6  # of a point that is numbered


class TrackerPoints(RawFormat):
    """Up to three names (collection, group, point; text or whole numbers), then three columns of coordinates."""

    name = "tracker-points"
    title = "a list of points: name, x, y, z"
    source = "lists as found in public recordings; fields in the order of the export dialogs"
    seen = True
    bare = True

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        table = raw.clear_layout
        if table is None or table.named or "spatialanalyzer" in " ".join(raw.lines[:20]).lower():
            return False
        width = len(table.names)
        if width not in range(3, 4 + len(HEADS)) or not all(table.numeric(k) for k in range(width - 3, width)):
            return False
        return all(_is_label(table, k) for k in range(width - 3)) and runs_in(table) is None

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        table = table_of_text(raw)
        heads = HEADS[len(HEADS) - len(table.names) + 3 :]
        names = dict(zip(table.names, (*heads, "mx", "my", "mz"), strict=True))
        recording = renamed(columns_of(raw, asked, by_rows=True), names)
        for place, name in enumerate(heads):
            recording.frame[name] = table.column(place)
        notes = () if recording.length_unit else ("no units in the file: coordinates taken as mm",)
        frame = recording.frame.drop(columns=["collection"], errors="ignore")
        return replace(recording, frame=frame, notes=(*recording.notes, *notes))


def _is_label(table: Layout, place: int) -> bool:
    """Whether a column names points or their groups: text, or whole numbers."""
    cells = table.column(place)
    return not table.numeric(place) or all(c.strip().isdecimal() and int(c) < LARGEST_NUMBER for c in cells)
