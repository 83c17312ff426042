"""Conventions of the toolkit: units, signs, frames and symbols of ISO 230-1.

Lengths are mm and angles rad. Every error is actual minus nominal; rotations are right-handed. A small rotation
``e = (ea, eb, ec)`` is ``Rx(ea) Ry(eb) Rz(ec)``, the same order in which a shape's nominal ``rotation`` is read.
"""

from __future__ import annotations

from typing import Literal

Motion = Literal["dx", "dy", "dz", "ea", "eb", "ec"]

TRANSLATIONS: tuple[Motion, ...] = ("dx", "dy", "dz")  # small displacements along x, y, z, mm
ROTATIONS: tuple[Motion, ...] = ("ea", "eb", "ec")  # small rotations about x, y, z, rad
MOTIONS: tuple[Motion, ...] = TRANSLATIONS + ROTATIONS  # all six error motions

FRAME = "frame"  # the measuring frame, before the first element of the chain
TOOL = "tool"  # the functional point, after the last element of the chain
INSTRUMENT = "instrument"  # location of effects of the instrument

REFERENCE_TEMPERATURE = 20.0  # degC, ISO 1
# standard deviation of an error of a machine that is not known, by the unit of its parameter; by judgement
PLAUSIBLE_SIZES = {"mm": 0.02, "rad": 5e-5, "1": 5e-5, "rad/mm": 5e-8}

_ISO_DIRECTION: dict[Motion, str] = {"dx": "X", "dy": "Y", "dz": "Z", "ea": "A", "eb": "B", "ec": "C"}


def iso_symbol(joint: str, motion: Motion) -> str:
    """ISO 230-1 symbol of a joint's error motion: ``iso_symbol("X", "dx") == "EXX"``."""
    return f"E{_ISO_DIRECTION[motion]}{joint}"


def motion_of_iso(symbol: str, joint: str) -> Motion | None:
    """Motion of an ISO 230-1 symbol, ignoring case; None if `symbol` is no error motion of `joint`."""
    for motion in MOTIONS:
        if symbol.lower() == iso_symbol(joint, motion).lower():
            return motion
    return None


def unit_of(motion: str) -> str:
    """Internal unit of an error motion: ``mm`` for dx dy dz, ``rad`` for ea eb ec."""
    return "mm" if motion in TRANSLATIONS else "rad"
