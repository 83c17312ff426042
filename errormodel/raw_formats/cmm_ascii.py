"""ASCII results of coordinate measuring machines: one line a feature and axis, with nominal and measured values.

The columns FEATURE, AXIS, NOMINAL, MEAS of Hexagon's NC-Gage (appendix F of its manual); tables of other programs with
such columns are read alike. Only the axes X, Y and Z of a feature become a point; diameters and forms are left out.
"""

from __future__ import annotations

import numpy as np

from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording
from errormodel.raw_formats.table_columns import columns_of, numbers

_FEATURE, _AXIS = ("feature", "name", "element", "characteristic", "id"), ("axis", "ax", "coordinate")
_MEASURED, _NOMINAL = ("meas", "measured", "actual", "act"), ("nominal", "nom")


def _pick(names: dict[str, str], words: tuple[str, ...]) -> str | None:
    return next((names[w] for w in words if w in names), None)


class CmmAscii(RawFormat):
    """Measured coordinates of features; their nominal ones are the columns nx ny nz."""

    name = "cmm-ascii"
    title = "results of a coordinate measuring machine"
    source = "Hexagon, NC-Gage, appendix F, CSV format"

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        table = raw.clear_layout
        if table is None or not table.named:
            return False
        names = {n.lower(): n for n in table.names}
        found = [_pick(names, words) for words in (_FEATURE, _AXIS, _MEASURED)]
        return None not in found and {"X", "Y", "Z"} <= {
            c.upper() for c in table.column(table.names.index(found[1] or ""))
        }

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        import pandas as pd

        recording = columns_of(raw, asked)
        frame = recording.frame
        names = {str(n).lower(): str(n) for n in frame}
        feature, axis, measured = (_pick(names, w) for w in (_FEATURE, _AXIS, _MEASURED))
        nominal = _pick(names, _NOMINAL)
        for column in (measured, nominal):
            if column is not None:
                numbers(recording, column, raw.name)
        label, along = frame[feature].astype(str), frame[axis].astype(str).str.strip().str.upper()
        # a feature that is measured again begins a new point with its first axis
        block = ((label != label.shift()) | (along == "X")).cumsum()
        points: list[dict[str, object]] = []
        lines: list[int] = []
        for _, rows in frame[along.isin(["X", "Y", "Z"])].groupby(block, sort=False):
            own = dict(zip(along[rows.index], rows.index, strict=True))
            point: dict[str, object] = {"point": str(label[rows.index[0]])}
            for a, at in own.items():
                point[f"m{a.lower()}"] = float(frame[measured][at])
                if nominal is not None:
                    point[f"n{a.lower()}"] = float(frame[nominal][at])
            points.append(point)
            lines.append(recording.lines[int(rows.index[0])])
        table = pd.DataFrame(points)
        left = int((~along.isin(["X", "Y", "Z"])).sum())
        notes = [f"{len(table)} points", *([f"{left} lines of other characteristics left out"] if left else [])]
        unit = recording.units.get(str(measured), "")
        units = {n: unit for n in map(str, table) if unit and n[0] in "mn" and n[1:] in "xyz"}
        if not unit:
            notes.append("no units in the file: coordinates taken as mm")
        for name in ("mx", "my", "mz"):
            if name not in table:
                table[name] = np.nan
        return Recording(table, units, tuple(lines), (*recording.notes, *notes))
