"""Columns of one joint's error motions, by their names: those of ISO 230-1, and pitch, yaw, roll of linear joints."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from errormodel.conventions import MOTIONS, ROTATIONS, Motion, iso_symbol, motion_of_iso
from errormodel.exceptions import InputError
from errormodel.machine import Joint, Machine
from errormodel.raw_formats.base import RawFile, Recording
from errormodel.raw_formats.positioning import ALONG_COSINE, axis_above
from errormodel.surveys.columns import MEASURED
from errormodel.surveys.file import RawEntry
from identification.importing.roles import position_column, roles

_ANGLE = r"(angle|error|deviation|winkel|fehler|abweichung)?"
_TURNS = {
    "pitch": rf"(pitch|pitching|nick|nicken|tangage){_ANGLE}",
    "yaw": rf"(yaw|yawing|gier|gieren|lacet){_ANGLE}",
    "roll": rf"(roll|rolling|rollen|roulis){_ANGLE}",
}
VERTICAL = 2  # z of the reference, as gravity of effects that state none


class _MotionColumns(NamedTuple):
    """The joint that a table is about, its columns under the toolkit's names, and what to say of them."""

    joint: str
    columns: dict[str, str]
    notes: tuple[str, ...]


def with_motions(
    raw: RawFile, plain: RawEntry, recording: Recording, own: dict[str, str], machine: Machine
) -> tuple[RawEntry, Recording, dict[str, str]]:
    """Entry, recording and columns (`own`) of a table of one joint's error motions under their usual names.

    Other tables stay as they are.

    Raises
    ------
    InputError
        Pitch or yaw of a joint of which the word does not say the axis, or angles of which nobody states the unit.
    """
    names = {*map(str, recording.frame)}
    if {*names, *own} & {*MOTIONS, "joint"} or {*MEASURED} & {*names, *roles(recording, machine, "whole", own)}:
        return plain, recording, own
    above = axis_above(raw)
    stated = plain.joint or (above if above in [j.name for j in machine.joints] else "")
    unit = next((u for n, u in plain.units.items() if n in (*ROTATIONS, "angle")), "")
    found = _motion_columns(recording, machine, stated, raw.name, own, unit)
    if found is None:
        return plain, recording, own
    recording = replace(recording, notes=(*recording.notes, *found.notes))
    return plain.model_copy(update={"joint": found.joint}), recording, {**found.columns, **own}


def _motion_columns(
    recording: Recording, machine: Machine, joint: str, name: str, given: Collection[str] = (), unit: str = ""
) -> _MotionColumns | None:
    """The columns of error motions of one joint, where they have the usual names; None where they have not.

    Parameters
    ----------
    joint : that was asked for, or that the file states; empty: the one in the names of ISO 230-1.
    name : of the file, for messages.
    given : of our columns, those that the user named.
    unit : of angles, as the user stated it.
    """
    names = [str(n) for n in recording.frame if recording.frame[n].dtype.kind == "f"]
    joints = [j for j in machine.joints if not joint or j.name == joint]
    found = {j.name: dict(_by_iso(names, j)) for j in joints}
    about = [j for j in joints if found[j.name] or joint]
    if len(about) != 1:
        return None
    own, notes = about[0], tuple[str, ...]()
    columns = found[own.name]
    for theirs, word in _turns(names):
        motion = _motion_of(own, word, theirs, name)
        if motion not in columns:
            columns[motion] = theirs
            notes += (
                f"{theirs}: taken as {motion} ({iso_symbol(own.name, motion)}), {word} of {own.name} about "
                f"{'xyz'[ROTATIONS.index(motion)]} with z upwards, positive by the right hand; if the instrument "
                f"counts the other way, --columns {motion}=-{theirs}",
            )
    there = own.name in recording.frame or own.name in given
    place = "" if there else position_column([str(n) for n in recording.frame])
    if not columns or not (there or place):
        return None
    for motion, theirs in columns.items():
        if motion in ROTATIONS and not unit and not recording.units.get(theirs):
            cure = f"Say it with --units {motion}=arcsec (or um/m, urad ..)"
            raise InputError(f"{name}, column {theirs}", "angles without a unit", cure)
    return _MotionColumns(own.name, columns | ({own.name: place} if place else {}), notes)


def _by_iso(names: Sequence[str], joint: Joint) -> Iterator[tuple[Motion, str]]:
    """Motions of a joint and the columns that have their names of ISO 230-1."""
    for theirs in names:
        motion = motion_of_iso(re.sub(r"[\s_.\-()]+", "", theirs), joint.name)
        if motion is not None:
            yield motion, theirs


def _turns(names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Columns of pitch, yaw and roll, with the word for what they are."""
    for theirs in names:
        bare = re.sub(r"[\s_.\-]+", "", theirs).lower()
        word = next((w for w, pattern in _TURNS.items() if re.fullmatch(pattern, bare)), "")
        if word:
            yield theirs, word


def _motion_of(joint: Joint, word: str, theirs: str, name: str) -> Motion:
    """The rotation that pitch, yaw or roll of a joint is."""
    along = int(np.argmax(np.abs(joint.axis)))
    straight = joint.type == "prismatic" and abs(joint.axis[along]) >= ALONG_COSINE
    if straight and word == "roll":
        return ROTATIONS[along]
    if straight and along != VERTICAL:
        return ROTATIONS[VERTICAL if word == "yaw" else 1 - along]
    why = "travels vertically" if straight else "is rotary" if joint.type == "rotary" else "lies along none of x, y, z"
    motions = " or ".join(f"--columns {m}={theirs}" for m in ROTATIONS if not straight or m != ROTATIONS[along])
    found = f"{word} of {joint.name}, which {why}: the word does not say about which axis"
    raise InputError(f"{name}, column {theirs}", found, f"Say it with {motions}")
