"""Readings of one joint at target positions, there and back, as rows of its error motions."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from errormodel.conventions import ROTATIONS, TRANSLATIONS
from errormodel.exceptions import InputError, nearest
from errormodel.machine import Joint
from errormodel.units import is_unit, to_internal

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import NDArray

    from errormodel.raw_formats.base import Asked, RawFile

# of an axis in a line above a table: `Achse: X`, `Axis under test = X`, `X-Achse`
_AXIS_LINE = re.compile(
    r"\b(?:achse|axis|axe|asse|eje)\b(?:\s+under\s+test)?\s*[:=;,\t ]\s*([a-z]\d?)\b|\b([a-z]\d?)[ -](?:achse|axis)\b",
    re.IGNORECASE,
)
DEVIATION = "deviation"  # column of readings whose error motion only the user knows
ALONG_COSINE = 0.9999  # of a joint's axis with x, y or z, from which a reading along it is one error motion


def joint_for(name: str, asked: Asked, hint: str, rotary: bool) -> Joint:
    """The joint that a file is about: the one asked for, the one whose name the file has, or the only one of its kind.

    Raises
    ------
    InputError
        None of these.
    """
    joints = asked.machine.joints if asked.machine is not None else ()
    names = [j.name for j in joints]
    if asked.joint and asked.joint not in names:
        raise InputError(f"--joint {asked.joint}", "the machine has no such joint", nearest(asked.joint, names))
    words = hint.replace(":", " ").split()
    own = [j for j in joints if j.name == asked.joint] or [j for j in joints if j.name in words]
    own = own or [j for j in joints if (j.type == "rotary") == rotary]
    if len(own) != 1:
        found = f"it does not say which joint was measured (axis: '{hint}')" if hint else "it names no joint"
        raise InputError(name, found, f"Say it with --joint, one of {', '.join(names)}")
    return own[0]


def axis_above(raw: RawFile) -> str:
    """The axis that lines above a table state; empty where they state none, or several."""
    table = raw.clear_layout
    lines = () if table is None else (*table.preamble, *table.comments)
    letters = {(m[1] or m[2]).upper() for line in lines for m in _AXIS_LINE.finditer(line)}
    return letters.pop() if len(letters) == 1 else ""


def other_axis(joint: Joint, asked: Asked, hint: str) -> list[str]:
    """A note that a file names another joint of the machine than the one that was asked for."""
    names = [j.name for j in asked.machine.joints] if asked.machine is not None else []
    if hint not in names or hint == joint.name:
        return []
    return [f"the file says axis {hint}, and --joint {joint.name}: taken as {joint.name}"]


def motion_along(joint: Joint) -> tuple[str, int]:
    """The error motion of a joint along (about) its axis, and the sign of a reading in it.

    Raises
    ------
    InputError
        The axis lies along none of x, y and z.
    """
    k = int(np.argmax(np.abs(joint.axis)))
    if abs(joint.axis[k]) < ALONG_COSINE:
        found = f"the axis of {joint.name} lies along none of x, y and z, so that a reading is no one error motion"
        raise InputError(f"joint {joint.name}", found, "Measure components along x, y, z of the joint's frame")
    names = ROTATIONS if joint.type == "rotary" else TRANSLATIONS
    return names[k], int(np.sign(joint.axis[k]))


def motion_rows(
    joint: Joint,
    position: NDArray[np.float64],
    deviation: NDArray[np.float64],
    unit: str,
    run: Sequence[str],
    side: NDArray[np.float64],
    linear: bool = True,
) -> pd.DataFrame:
    """Rows of a survey of one joint's error motions.

    Parameters
    ----------
    joint : Joint
    position : (n,) targets, mm or degrees.
    deviation : (n,) measured minus target, in `unit`.
    run : (n,) labels.
    side : (n,) +-1, from which the joint arrived; NaN: not known.
    linear : whether the deviation is along (about) the joint's axis; else it becomes the column ``deviation``.
    """
    import pandas as pd

    frame = pd.DataFrame({"joint": joint.name, joint.name: position, "run": list(run)})
    if linear:
        motion, sign = motion_along(joint)
        quantity = "angle" if is_unit(unit, "angle") else "length"
        frame[motion] = sign * to_internal(deviation, unit, quantity)  # type: ignore[arg-type]
    else:
        frame[DEVIATION] = deviation
    if np.isfinite(side).all():
        frame[f"dir_{joint.name}"] = side
    return frame
