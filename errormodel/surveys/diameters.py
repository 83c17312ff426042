"""Positions of a lathe's cross slide in diameters, of which a survey has radii: as the slide moves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from errormodel.exceptions import ReadValueError
from errormodel.machine import Joint, Machine
from errormodel.serial_chain import directions

if TYPE_CHECKING:
    import pandas as pd

ACROSS = 0.02  # cosine: squarenesses are far smaller
ONE_SIDED = 0.5  # of a travel's larger end: the other reaches less far beyond the axis of the part; by judgement
BEYOND = 0.1  # of the positions lie beyond the travel: fewer may overrun it; by judgement
FAR = 0.25  # of the travel, how far beyond it the farthest lies: diameters reach up to twice as far


class DiametersError(ReadValueError):
    """A column that was read, and looks like diameters."""


def cross_slides(machine: Machine) -> Iterator[Joint]:
    """Linear joints across the axis of a rotary one that carries the part, which travel to one side of that axis."""
    axes = directions(machine.elements)
    linear = [j for j in machine.joints if j.type == "prismatic"]
    first = machine.joints.index(linear[0]) if linear else 0
    for joint in linear:
        low, high = joint.travel
        near, far = sorted((abs(low), abs(high)))
        across = (abs(float(axes[joint.name] @ axes[j.name])) < ACROSS for j in machine.joints[:first])
        if any(across) and (low >= 0 or high <= 0 or near < ONE_SIDED * far):
            yield joint


def refuse_diameters(table: pd.DataFrame, machine: Machine) -> None:
    """InputError where readings of a cross slide's own motion are at positions that fit its travel as diameters only.

    Of measured points the fit of the nominal machine tells.
    """
    if "joint" not in table:
        return
    for joint in cross_slides(machine):
        own = table[table["joint"] == joint.name]
        q, (low, high) = own[joint.name].to_numpy(dtype=np.float64), joint.travel
        slack, off = 1e-6 * (high - low), np.fmax(low - q, q - high)
        if (
            not len(q)
            or (off > slack).mean() < BEYOND
            or np.nanmax(off) < FAR * (high - low)
            or (np.fmax(low - q / 2, q / 2 - high) > slack).any()
        ):
            continue
        found = f"positions from {np.nanmin(q):.6g} to {np.nanmax(q):.6g} mm, where it travels {low:.6g} to {high:.6g}"
        other = "If they are radii, correct its travel in machine.yaml"
        raise looks_like_diameters(joint.name, str(own["file"].iloc[0]), found, other)


def looks_like_diameters(joint: str, file: str, found: str, other: str) -> DiametersError:
    """The refusal of a column that looks like diameters, with what says it."""
    return DiametersError(
        f"{file}, column {joint}", f"{joint} looks like diameters: {found}", f"{said(joint)}. {other}"
    )


def said(joint: str) -> str:
    """What says that a column is in diameters."""
    return (
        f"If they are diameters, write units: {{{joint}: diameter}} in a survey.yaml, or import with --units "
        f"{joint}=diameter (of --commands, --command-units)"
    )
