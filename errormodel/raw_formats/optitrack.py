"""Takes of OptiTrack Motive as CSV: a line of keys and values, then types, names, ids, kinds and axes of the columns.

Source: the export as described in GTEC-UDC/linuxcnc_gantry_robot, calibration/src/README.md, and by public readers of
versions 1.2 to 1.23. Empty cells are frames in which a body was not seen. Coordinates are those of Motive.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence

import numpy as np

from errormodel.exceptions import InputError
from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording
from errormodel.raw_formats.orientation import rotation_vectors
from errormodel.raw_formats.unit_words import quantity_of_unit, unit_word

_AXES = ("X", "Y", "Z")


class OptitrackTake(RawFormat):
    """The first rigid body, or the only marker: position, orientation, time; other bodies are further targets."""

    name = "optitrack-take"
    title = "a take of OptiTrack Motive"
    source = "GTEC-UDC/linuxcnc_gantry_robot, calibration/src/README.md, section OptiTrack Data"

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        return raw.text is not None and raw.lines[0].lstrip().lower().startswith("format version,")

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        import pandas as pd

        first = next(csv.reader([raw.lines[0]]))
        keys = {k.strip().lower(): v.strip() for k, v in zip(first[::2], first[1::2], strict=False)}
        unit = unit_word(keys.get("length units", ""))
        if quantity_of_unit(unit) != "length":
            raise InputError(f"{raw.name}, line 1", f"length units '{unit}'", "Export with header information")
        rotation = keys.get("rotation type", "Quaternion").lower()
        heads, rows, lines = _parts(raw)
        bodies = _bodies(heads)
        if not bodies:
            raise InputError(raw.name, "no rigid body and no marker", "Export rigid bodies with their positions")
        frames = []
        time = next((k for k, cell in enumerate(heads[-1]) if cell.lower().startswith("time")), None)
        if time is None:
            raise InputError(raw.name, "no column of time", "Export with the column Time (Seconds)")
        values = np.array([[_value(c) for c in row[: len(heads[-1])]] for row in rows])
        for name, places in bodies.items():
            part = pd.DataFrame(values[:, [places["Position", a] for a in _AXES]], columns=["mx", "my", "mz"])
            part.insert(0, "time", values[:, time])
            turns = [places.get(("Rotation", a)) for a in ("X", "Y", "Z", "W")]
            if None not in turns and "quaternion" in rotation:
                q = values[:, [int(turns[k] or 0) for k in (3, 0, 1, 2)]]
                whole = np.isfinite(q).all(axis=1) & (np.abs(np.linalg.norm(np.nan_to_num(q), axis=1) - 1) < 1e-2)
                part[["mrx", "mry", "mrz"]] = rotation_vectors(q, whole)
            if len(bodies) > 1:
                part["target"] = name
            frames.append(part)
        frame = pd.concat(frames, ignore_index=True) if len(frames) > 1 else frames[0]
        frame = frame.dropna(axis=1, how="all")
        notes = [f"{len(bodies)} bodies ({', '.join(bodies)})" if len(bodies) > 1 else f"body {next(iter(bodies))}"]
        units = dict.fromkeys(("mx", "my", "mz"), unit)
        return Recording(frame, units, tuple(lines * len(frames)), (*raw.notes, *notes))


def _parts(raw: RawFile) -> tuple[list[list[str]], list[list[str]], list[int]]:
    """The lines of heads, the rows, and the lines of the rows."""
    cells = [(k, row) for k, row in enumerate(csv.reader(raw.lines[1:]), start=2) if any(c.strip() for c in row)]
    start = next((i for i, (_, row) in enumerate(cells) if row[0].strip().lower() == "frame"), None)
    if start is None:
        raise InputError(raw.name, "no line that begins with Frame", "Give the CSV as Motive exported it")
    heads = [[c.strip() for c in row] for _, row in cells[: start + 1]]
    width = len(heads[-1])
    rows = [(k, row + [""] * (width - len(row))) for k, row in cells[start + 1 :]]
    if not rows:
        raise InputError(raw.name, "no frames", "Give the CSV as Motive exported it")
    return heads, [row for _, row in rows], [k for k, _ in rows]


def _bodies(heads: Sequence[Sequence[str]]) -> dict[str, dict[tuple[str, str], int]]:
    """Columns of each rigid body by kind and axis; of markers where there is no body."""
    if len(heads) < 4:
        return {}
    types, names, kinds, axes = heads[0], heads[1], heads[-2], heads[-1]
    out: dict[str, dict[str, dict[tuple[str, str], int]]] = {"rigid body": {}, "marker": {}}
    for place in range(2, len(axes)):
        kind = types[place].lower() if place < len(types) else ""
        if kind in out and place < min(len(names), len(kinds)):
            out[kind].setdefault(names[place], {})[kinds[place], axes[place]] = place
    found = out["rigid body"] or out["marker"]
    return {name: places for name, places in found.items() if all(("Position", a) in places for a in _AXES)}


def _value(cell: str) -> float:
    try:
        return float(cell) if cell.strip() else float("nan")
    except ValueError:
        return float("nan")
