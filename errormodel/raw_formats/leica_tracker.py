"""Exports of Leica laser trackers: units in the header, expanded uncertainties, quaternion, air, target, time."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording
from errormodel.raw_formats.orientation import rotation_vectors
from errormodel.raw_formats.table_columns import columns_of, numbers, renamed

COVERAGE = 2.0  # k of U(95) for a normal distribution, as the instrument states it
_AIR = {"temperature": "T_air", "pressure": "w_pressure_mbar", "humidity": "w_humidity_percent"}


def _key(name: str) -> str:
    return re.sub(r"[\s()_.]+", "", name).lower()


class LeicaTracker(RawFormat):
    """U(95) of each coordinate becomes sigma (half of it), air temperature a channel, the quaternion an orientation."""

    name = "leica-tracker"
    title = "an export of a Leica laser tracker"
    source = "columns as described in the readme of the data set ASTL (HUST); quaternion with its scalar first"
    seen = True

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        table = raw.clear_layout
        if table is None or not table.named:
            return False
        keys = {_key(n) for n in table.names}
        return {"x", "y", "z"} <= keys and ("u95" in keys or "u95x" in keys)

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        recording = columns_of(raw, asked, by_rows=True)
        keys = {_key(n): n for n in map(str, recording.frame)}
        names = {keys[k]: f"m{k}" for k in "xyz"}
        names |= {keys[k]: new for k, new in _AIR.items() if k in keys}
        names |= {
            keys[k]: new for k, new in {"target": "target", "name": "point", "point": "point"}.items() if k in keys
        }
        recording = renamed(recording, names)
        frame, units = recording.frame, dict(recording.units)
        notes = list(recording.notes)
        for k in "xyz":
            own = keys.get(f"u95{k}", keys.get("u95"))
            if own is not None:
                frame[f"sigma_{k}"] = numbers(recording, own, raw.name) / COVERAGE
                units[f"sigma_{k}"] = units.get(own, units.get(f"m{k}", ""))
        notes.append("U(95) halved: sigma is a standard uncertainty (k = 1)")
        quaternion = [keys[q] for q in ("q0", "q1", "q2", "q3") if q in keys]
        if len(quaternion) == 4:
            q = np.column_stack([numbers(recording, n, raw.name) for n in quaternion])
            whole = np.isfinite(q).all(axis=1) & (np.abs(np.linalg.norm(q, axis=1) - 1) < 1e-3)
            if whole.any() and np.ptp(q[whole], axis=0).max() > 0:  # a reflector has the same one in all rows
                frame[["mrx", "mry", "mrz"]] = rotation_vectors(q, whole)
                notes.append("the quaternion (scalar first) is the orientation mrx mry mrz")
                tools = frame["target"].nunique() if "target" in frame else 1
                if tools > 1:
                    notes.append(f"{tools} targets, whose orientations may differ")
        gone = [*quaternion, *(n for k, n in keys.items() if k.startswith("u95"))]
        frame = frame.drop(columns=[n for n in gone if n in frame])
        units = {n: u for n, u in units.items() if n in frame}
        return replace(recording, frame=frame, units=units, notes=tuple(notes))
