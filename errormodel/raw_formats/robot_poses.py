"""Lists of robot poses: a name, the position and orientation that were measured, and the joint values.

The layout of Dassault's Auto ID and of most robot programs: name X Y Z W P R J1 ... Jn under a header, angles in
degrees. W P R are read as FANUC has them, turns about fixed x, y, z; orientations under other names are left alone,
since no file says how they turn.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording, joint_names
from errormodel.raw_formats.table_columns import columns_of, numbers, renamed

_JOINT = re.compile(r"(?:j|joint|axis|a|q|theta)_?(\d)", re.IGNORECASE)


def _joints(names: list[str]) -> list[str]:
    """Columns J1 to Jn, if there are at least four of them, in order."""
    own = {int(m[1]): n for n in names if (m := _JOINT.fullmatch(re.sub(r"[\s.]+", "", n)))}
    return [own[k] for k in sorted(own)] if len(own) >= 4 and sorted(own) == [*range(1, len(own) + 1)] else []


class RobotPoses(RawFormat):
    """A header with J1 ... Jn; X Y Z beside them are the measured position."""

    name = "robot-poses"
    title = "a list of robot poses"
    source = "help of 3DEXPERIENCE, robot signature (Auto ID): name X Y Z R P Y J1 ..."

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        table = raw.clear_layout
        return table is not None and table.named and bool(_joints([*table.names]))

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        recording = columns_of(raw, asked)
        names = [str(n) for n in recording.frame]
        given, joints = _joints(names), list(joint_names(asked.machine))
        new: dict[str, str] = {}
        notes: list[str] = []
        if len(given) == len(joints):
            new = dict(zip(given, joints, strict=True))
            if given != joints:
                notes.append(f"{given[0]} to {given[-1]} taken as {', '.join(joints)}")
        plain = {n.lower(): n for n in names}
        if {"x", "y", "z"} <= {*plain}:
            new |= {plain[k]: f"m{k}" for k in "xyz"}
        first = next((plain[k] for k in ("name", "point", "pose", "label") if k in plain), None)
        if first:
            new[first] = "point"
        recording = renamed(recording, new)
        frame = recording.frame
        if {"w", "p", "r"} <= {*plain}:
            from scipy.spatial.transform import Rotation

            angles = np.column_stack([numbers(recording, plain[k], raw.name) for k in "wpr"])
            whole = np.isfinite(angles).all(axis=1)
            vectors = np.full(angles.shape, np.nan)
            vectors[whole] = Rotation.from_euler("xyz", angles[whole], degrees=True).as_rotvec()
            frame[["mrx", "mry", "mrz"]] = vectors
            notes.append("W P R read as turns about fixed x, y, z in degrees, the orientation mrx mry mrz")
        return replace(recording, notes=(*recording.notes, *notes))
