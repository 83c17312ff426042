"""Lists of robot poses: a name, the position and orientation that were measured, and the joint values.

The layout of Dassault's Auto ID and of most robot programs: name X Y Z W P R J1 ... Jn under a header, angles in
degrees; those under the names of Universal Robots' RTDE are in rad. W P R are read as FANUC has them, turns about fixed
x, y, z; orientations under other names are left alone, since no file says how they turn.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording, joint_names
from errormodel.raw_formats.table_columns import columns_of, numbers, renamed

_JOINT = re.compile(
    r"(?P<kind>target|cmd|command(?:ed)?|nominal|set|soll|act(?:ual)?|ist|feedback|current)?_?"
    r"(?:j|joint|axis|achse|a|q|theta|\u03b8)_?(?P<number>\d)",
    re.IGNORECASE,
)
# joints as the real-time data exchange of Universal Robots (RTDE guide: target_q, actual_q) names them, always in rad
_RTDE = re.compile(r"(?:target|actual)_q_\d")
_READ = ("act", "actual", "ist", "feedback", "current")


def _joints(names: list[str], read: bool = False) -> list[str]:
    """Columns J1 to Jn as commanded (or as read back), at least four of them, in order; q0 to q3 are a quaternion."""
    own: dict[int, str] = {}
    for name in names:
        match = _JOINT.fullmatch(re.sub(r"[\s.]+", "", name))
        if match and ((match["kind"] or "").lower() in _READ) == read:
            own.setdefault(int(match["number"]), name)
    first = min(own, default=1)
    whole = len(own) >= 4 + (first == 0) and first in (0, 1) and sorted(own) == [*range(first, first + len(own))]
    return [own[k] for k in sorted(own)] if whole else []


class RobotPoses(RawFormat):
    """A header with J1 ... Jn; X Y Z beside them are the measured position."""

    name = "robot-poses"
    title = "a list of robot poses"
    source = "help of 3DEXPERIENCE, robot signature (Auto ID): name X Y Z R P Y J1 ..."

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        table = raw.clear_layout
        return table is not None and table.named and bool(_joints([*table.names]) or _joints([*table.names], read=True))

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        recording = columns_of(raw, asked)
        names = [str(n) for n in recording.frame]
        given, joints = _joints(names) or _joints(names, read=True), list(joint_names(asked.machine))
        new: dict[str, str] = {}
        notes: list[str] = []
        if len(given) == len(joints):
            new = dict(zip(given, joints, strict=True))
            if given != joints:
                notes.append(f"{given[0]} to {given[-1]} taken as {', '.join(joints)}")
            if (back := _joints(names, read=True)) and back != given and len(back) == len(joints):
                new |= {theirs: f"read_{ours}" for theirs, ours in zip(back, joints, strict=True)}
        bare = [n for n in new if _RTDE.fullmatch(n) and n not in recording.units]
        if bare:
            recording = replace(recording, units={**recording.units, **dict.fromkeys(bare, "rad")})
            notes.append(f"{bare[0]} to {bare[-1]} read in rad, as RTDE writes them")
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
