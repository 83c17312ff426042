"""Letters and numbers of the machine's joints on a controller.

The letter is the joint's own name if that is a letter of axes, else that of its direction: X Y Z for the first linear
joint along x y z, U V W for a second one parallel to it, A B C for rotary ones (ISO 841). Where this is ambiguous the
joint is *unsure* and the user is asked. Numbers follow the order X Y Z A B C U V W, not the kinematic chain.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array
from errormodel.exceptions import InputError, nearest
from errormodel.machine import Joint, Machine

if TYPE_CHECKING:
    from errormodel.chain import Chain

AXIS_LETTERS = ("X", "Y", "Z", "A", "B", "C", "U", "V", "W")  # letters of ISO 841, in the order of numbering
ALONG_COSINE = 0.9  # cosine between joint and x, y or z, from which on the joint runs along it; by judgement
AXES_FORM = "Write --axes X=1,Y=2,Z=3 (joint=number), or bridge=Y2 (joint=letter and number), every joint once"
AXES_ITEM = re.compile(r"([A-Za-z]?)([-+]?[\d.]*)")  # a letter and a number, both optional


@dataclass(frozen=True)
class Wanted:
    """Letter and number that the user gives a joint: "" and None stand for the usual ones."""

    letter: str
    number: int | None


def wanted_axes(text: str, joints: Sequence[str]) -> dict[str, Wanted]:
    """The option ``--axes``: ``JOINT=[LETTER][NUMBER]``, separated by commas.

    Raises
    ------
    InputError
        A joint is unknown or repeated, a letter or number is repeated, a number is invalid or missing.
    """
    out: dict[str, Wanted] = {}
    for part in filter(None, (p.strip() for p in text.split(","))):
        joint, equal, value = (p.strip() for p in part.partition("="))
        if not equal or not value:
            raise InputError("--axes", f"'{part}'", AXES_FORM)
        if joint not in joints:
            raise InputError("--axes", f"'{joint}', and the machine has no such joint", nearest(joint, joints))
        if joint in out:
            raise InputError("--axes", f"the joint {joint} twice", "Give every joint once")
        match = AXES_ITEM.fullmatch(value)
        if match is None or (match[1] and match[1].upper() not in AXIS_LETTERS):
            found = f"'{value}' for the joint {joint}, which is no number and no letter of {' '.join(AXIS_LETTERS)}"
            raise InputError("--axes", found, AXES_FORM)
        if match[2] and not match[2].isdigit():
            found = f"'{match[2]}' for the joint {joint}, which is no whole number"
            raise InputError("--axes", found, "Write whole numbers, such as X=1")
        out[joint] = Wanted(match[1].upper(), int(match[2]) if match[2] else None)
    if not out:
        raise InputError("--axes", "nothing", AXES_FORM)
    for what in ("letter", "number"):
        taken: dict[object, str] = {}
        for joint, one in out.items():
            value = getattr(one, what)
            if value in taken:
                found = f"the {what} {value} for {taken[value]} and for {joint}"
                raise InputError("--axes", found, f"Give every joint a {what} of its own")
            if value not in ("", None):
                taken[value] = joint
    numbered = [j for j, one in out.items() if one.number is not None]
    missing = [j for j in joints if j not in numbered]
    if numbered and missing:
        found = f"a number for {', '.join(numbered)}, and none for {', '.join(missing)}"
        raise InputError("--axes", found, "Number every joint of the machine, or none")
    return out


def directions_at_zero(machine: Machine, chain: Chain) -> Array:
    """Unit vectors (joints, 3) of the joints' axes in the reference, all joints at zero."""
    frames = chain.frames({})
    return np.array(
        [frames[k][:3, :3] @ np.array(e.axis) for k, e in enumerate(machine.elements) if isinstance(e, Joint)]
    )


def origins_at_zero(machine: Machine, chain: Chain) -> Array:
    """Origins (joints, 3) of the joints' frames from the tool's tip, mm in the reference's axes, all joints at zero."""
    frames = chain.frames({})
    tip = frames[-1][:3, :3] @ np.asarray(machine.tool) + frames[-1][:3, 3]
    return np.array([frames[k][:3, 3] - tip for k, e in enumerate(machine.elements) if isinstance(e, Joint)])


def axis_letters(
    joints: Sequence[Joint], along: Array, wanted: Mapping[str, Wanted]
) -> tuple[list[str], tuple[str, ...]]:
    """Choose a letter for each joint, and list the joints whose letter only the user can know.

    Parameters
    ----------
    along : (joints, 3) unit vectors of the joints in the reference's axes.
    wanted : letters and numbers given by the user, by joint.
    """
    out = [wanted[j.name].letter if j.name in wanted else "" for j in joints]
    for k, joint in enumerate(joints):
        letter = joint.name.upper()
        if not out[k] and letter in AXIS_LETTERS and letter not in out:
            out[k] = letter
    nameless = [k for k, letter in enumerate(out) if not letter]
    usual = {k: _usual(joints[k], along[k]) for k in nameless}
    named, unsure = list(out), list[int]()
    for k in nameless:
        others = [i for i in nameless if usual[i][:1] == usual[k][:1]]
        free = [c for c in usual[k] if c not in named]
        if free and len(others) == 1 and abs(along[k]).max() >= ALONG_COSINE:
            out[k] = free[0]
        else:
            unsure.append(k)
    for k in unsure:  # these get a free letter as well, so that every joint has one
        out[k] = next((c for c in (*usual[k], *reversed(AXIS_LETTERS)) if c not in out), joints[k].name)
    return out, tuple(joints[k].name for k in unsure)


def _usual(joint: Joint, direction: Array) -> str:
    """Letters that a joint of that direction may have, the usual one first."""
    main = int(np.argmax(np.abs(direction)))
    return "ABC"[main] if joint.type == "rotary" else "XYZ"[main] + "UVW"[main]


def in_order(names: Sequence[str]) -> list[str]:
    """Axes in the order in which controllers number them: X Y Z A B C U V W."""
    return sorted(names, key=lambda n: (AXIS_LETTERS.index(n) if n in AXIS_LETTERS else len(AXIS_LETTERS), n))
