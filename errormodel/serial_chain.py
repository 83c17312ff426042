"""Detection of machines that are no serial chain, by words of their file and by their joints.

Parallel machines are refused before anything is computed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from errormodel.arrays import rotation_matrix
from errormodel.machine import Joint, Shape
from errormodel.yamlfile import Document, Keys, shown

PARALLEL_MACHINES = "a parallel machine (delta, hexapod, Stewart platform, tripod, five-bar or parallel SCARA)"
ONLY_SERIAL = f"errormodel models serial chains, in which each joint carries the next, and {PARALLEL_MACHINES} is none"
PARALLEL_MACHINE_CURE = (
    "Its legs cannot be identified here; to map its errors, give the X, Y and Z of the platform that its control "
    "commands as three prismatic joints"
)
COLLINEAR_SLIDES = 3  # fewest joints along one line that are refused: a quill and a telescope are two

# names of parallel machines, in keys and values
_PARALLEL_WORDS = re.compile(
    r"delta|hexa(pod|glide|pteron)|stewart|gough|parallel|closed.?loop|(five|four|5|4).?bar|tri(pod|cept|glide)|"
    r"bipod|rostock|kossel",
    re.IGNORECASE,
)
# keys of parts that only parallel machines have
_PARALLEL_PARTS = re.compile(r"legs?|struts?|loops?|branch(es)?|platforms?|limbs?|towers?|effector", re.IGNORECASE)
# keys whose value names the kind of machine
_STRUCTURE_KEYS = ("kinematics", "kinematic", "structure", "topology", "architecture", "type", "mechanism", "robot")
# keys of an entry of the chain, except its type
_ENTRY_KEYS = ("joint", "shape", "axis", "travel", "offset", "rotation")
# types of joints that serial chains with commanded joints do not have
_UNSUPPORTED_JOINTS = ("spherical", "universal", "ball", "cardan", "passive", "parallel")


def check_words(document: Document, known: Mapping[str, object]) -> None:
    """Raise InputError where keys or words of a machine's file name a parallel machine; `known` are valid keys."""
    for keys, value in _said(document.data, known):
        key = str(keys[-1])
        sort = key.lower() in _STRUCTURE_KEYS and isinstance(value, str) and _PARALLEL_WORDS.search(value)
        if sort or _PARALLEL_PARTS.fullmatch(key) or _PARALLEL_WORDS.search(key):
            raise document.error(keys, f"{shown(value) if sort else repr(key)}: {ONLY_SERIAL}", PARALLEL_MACHINE_CURE)
        if key == "type" and len(keys) > 1 and str(value).lower() in _UNSUPPORTED_JOINTS:
            raise document.error(keys, f"a joint of type {shown(value)}: {ONLY_SERIAL}", PARALLEL_MACHINE_CURE)


def _said(data: Mapping[str, Any], known: Mapping[str, object]) -> Iterator[tuple[Keys, Any]]:
    """Unknown keys of a machine's file, and the types of its joints, each with its value."""
    yield from (((key,), value) for key, value in data.items() if key not in known)
    chain = data.get("chain")
    for i, entry in enumerate(chain if isinstance(chain, list) else ()):
        if isinstance(entry, dict):
            yield from ((("chain", i, key), value) for key, value in entry.items() if key not in _ENTRY_KEYS)


def check_line(document: Document, elements: Sequence[Joint | Shape]) -> None:
    """Raise InputError where all joints are three or more slides along one line: carriages side by side."""
    joints = [(i, e) for i, e in enumerate(elements) if isinstance(e, Joint)]
    if len(joints) < COLLINEAR_SLIDES or any(joint.type == "rotary" for _, joint in joints):
        return
    axes = directions(elements)
    first = next(iter(axes.values()))
    if all(abs(float(first @ axis)) > 1 - 1e-6 for axis in axes.values()):
        names = ", ".join(joint.name for _, joint in joints)
        found = f"the joints {names} all slide along one line, so that the tool never leaves it; {ONLY_SERIAL}"
        raise document.error(
            ("chain", joints[COLLINEAR_SLIDES - 1][0]),
            found,
            f"{PARALLEL_MACHINE_CURE}. A telescope on one line is one joint",
        )


def directions(elements: Sequence[Joint | Shape]) -> dict[str, np.ndarray[Any, np.dtype[np.float64]]]:
    """Unit vectors of the joints in the reference's axes, by name, with all rotary joints at zero."""
    turn, out = np.eye(3), {}
    for element in elements:
        if isinstance(element, Joint):
            out[element.name] = turn @ np.array(element.axis)
        else:
            turn = turn @ rotation_matrix(element.rotation)
    return out
