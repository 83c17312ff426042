"""Plausibility of a machine's file: valid entries that are probably mistakes, such as radians declared as degrees."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence

from errormodel.machine import Joint, Shape
from errormodel.yamlfile import Document

LONGEST_TRAVEL_MM = 1e5  # mm: gantries for ships' hulls and wings end there
FULL_TURN_RAD = 2 * math.pi + 1e-3
TRAVEL_STEP_RAD = math.radians(15)  # travels end at multiples of it


def check_degrees(document: Document, elements: Sequence[Joint | Shape]) -> None:
    """Raise InputError if a rotary travel in degrees is one of usual size in radians, such as [-2.09, 0.52].

    Each end is then zero or a multiple of 15 degrees to the digits it is written with, at least two decimals.
    """
    for i, joint in enumerate(elements):
        if not isinstance(joint, Joint) or joint.type != "rotary":
            continue
        travel = document.value_at(("chain", i, "travel"))
        in_degrees = math.isclose(math.radians(travel[1] - travel[0]), joint.travel[1] - joint.travel[0])
        if in_degrees and all(_radians(value) for value in travel if value):
            low, high = (f"{15 * round(value / TRAVEL_STEP_RAD):d}" for value in travel)
            found = f"[{travel[0]:g}, {travel[1]:g}] degrees, which look like the radians of [{low}, {high}] degrees"
            cure = f"Write units: {{angle: rad}}, or travel: [{low}, {high}]"
            raise document.error(("chain", i, "travel"), found, cure)


def _radians(value: float) -> bool:
    """Whether a number is a multiple of 15 degrees in radians, to its written digits."""
    places = len(repr(float(value)).partition(".")[2])
    turns = round(value / TRAVEL_STEP_RAD)
    return (
        places >= 2
        and turns != 0
        and abs(turns * TRAVEL_STEP_RAD - value) <= 0.51 * 10.0**-places
        and abs(value) < FULL_TURN_RAD
    )


def doubts(document: Document, elements: Sequence[Joint | Shape]) -> Iterator[str]:
    """Notes on what is hardly meant, each with its line."""
    from errormodel.joint_models import registry

    joints = [(i, e) for i, e in enumerate(elements) if isinstance(e, Joint)]
    for i, joint in joints:
        where = f"{document.name}, line {document.line_of(('chain', i))}, joint {joint.name}"
        low, high = joint.travel
        if joint.type == "prismatic" and high - low > LONGEST_TRAVEL_MM:
            yield (
                f"{where}: a travel of {(high - low) / 1e3:.6g} m; if it is in another unit, say so: "
                "units: {length: mm}"
            )
        if joint.type == "rotary" and re.fullmatch(r"[XYZUVW]\d*", joint.name):
            yield (
                f"{where}: a rotary joint with the name of a linear axis (ISO 841), travel {math.degrees(low):g} to "
                f"{math.degrees(high):g} deg; if it slides, write type: prismatic"
            )
        for motion, basis in joint.models.items():
            if doubt := registry()[basis.kind].doubt(basis.n, motion):
                yield f"{where}: {doubt}"
                break
    rotary = [joint for _, joint in joints if joint.type == "rotary"]
    largest = max((math.degrees(abs(q)) for joint in rotary for q in joint.travel), default=math.inf)
    if len(rotary) > 1 and largest < FULL_TURN_RAD:
        names = ", ".join(joint.name for joint in rotary)
        yield (
            f"{document.name}: {names} turn by no more than {largest:.3g} deg each; if the travels are in radians, "
            "write units: {angle: rad}"
        )
