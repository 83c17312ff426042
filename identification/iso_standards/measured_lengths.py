"""Lengths along a line, as an interferometer reads them: displacements of one linear axis, or along a diagonal.

A reading is taken as the displacement along the line on which its poses lie: the beam of the test is aligned with it.
A set-up has one unknown zero (dead path, offset), so that deviations count from its first reading.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.machine import Machine
from errormodel.survey import Survey
from errormodel.surveys.observations import Group, groups
from identification.iso_standards.series import sides_of
from identification.results.axis_lines import SAME_POSITION

FEWEST_TARGETS = 3
OFF_LINE_SHARE = 1e-6  # of a line's length: commanded points closer to it lie on it
# of the travel, by which lengths along a line may differ from it: more is a beam that lies across; 1.8 degrees
ALIGNED_SHARE = 5e-4
ZERO_NOTE = "of lengths between two poses the first pose is the zero, and no target"
BEAM_NOTE = "a length is taken as the displacement along its line: the beam is held to lie along it"


@dataclass(frozen=True)
class Lengths:
    """Readings of a length along one line of commands.

    Attributes
    ----------
    label : of the observation, with its run where that has an own set-up.
    moving : columns of the joints that move.
    q : (n, joints) commands, mm and rad.
    position : (n,) mm along the line, in the direction in which the last of these joints moves up.
    deviation : (n,) mm, actual minus commanded displacement in that direction, from the first reading on.
    direction : (n,) +-1, side of arrival.
    sigma : (n,) standard uncertainty of a reading, mm; None where none is declared.
    from_pose : whether each counts from a pose of its own.
    """

    label: str
    moving: tuple[int, ...]
    q: Array
    position: Array
    deviation: Array
    direction: Array
    sigma: Array | None
    from_pose: bool = False


def lengths_of(survey: Survey, machine: Machine) -> Iterator[Lengths]:
    """The lengths of a survey that lie along lines of its linear joints."""
    if not survey.observations:
        return
    chain = Chain(machine)
    joints = machine.joints
    q = survey.commands([j.name for j in joints])
    for group in groups(survey.table, survey.observations):
        if group.observation.reading != "length" or not group.observation.anywhere:
            continue
        for own in _set_ups(group, chain, survey):
            found = _along(survey, machine, chain, group, own, q)
            if found is not None:
                yield found


def _set_ups(group: Group, chain: Chain, survey: Survey) -> Iterator[Index]:
    """Rows of a group, as places in it, that count from one zero: of lengths between two poses, with one first pose."""
    if group.observation.poses == 1:
        yield np.arange(len(group.index))
        return
    channels = group.channels(chain, survey.table)
    start = np.round(np.array(channels[: len(channels) // 2]).T / SAME_POSITION)
    kept = np.array([k for k in range(start.shape[1]) if np.isfinite(start[:, k]).all()])
    _, code = np.unique(start[:, kept], axis=0, return_inverse=True)
    for k in dict.fromkeys(code.ravel().tolist()):
        yield np.flatnonzero(code.ravel() == k)


def _along(survey: Survey, machine: Machine, chain: Chain, group: Group, own: Index, q: Array) -> Lengths | None:
    """The readings at places `own` of a group as displacements; None where they do not lie along one line."""
    rows = group.index[own]
    at = q[rows]
    moved = np.flatnonzero(np.ptp(at, axis=0) > SAME_POSITION)
    if not len(moved) or any(machine.joints[k].type != "prismatic" for k in moved):
        return None
    channels = [c[own] for c in group.channels(chain, survey.table)]
    size = len(channels) // group.observation.poses
    points = chain.kernel("nominal", outputs=(0, 1, 2))(channels[-size:]).T
    low, high = (int(pick(at[:, moved[-1]])) for pick in (np.argmin, np.argmax))
    along = points[high] - points[low]
    travel = float(np.linalg.norm(along))
    along = along / travel
    position = (points - points[low]) @ along
    across = points - points[low] - np.outer(position, along)
    if np.linalg.norm(across, axis=1).max() > OFF_LINE_SHARE * travel + SAME_POSITION:
        return None
    if len(np.unique(np.round(position / SAME_POSITION))) < FEWEST_TARGETS:
        return None
    readings = group.readings[own]
    sign = 1.0 if np.polyfit(position, readings, 1)[0] > 0 else -1.0
    deviation = sign * readings - position
    deviation -= deviation[0]
    if np.abs(deviation).max() > ALIGNED_SHARE * travel:
        return None
    sides = sides_of(survey, machine.joints[moved[-1]], rows, position)
    label = f"{group.label}, run {group.run}" if group.run else group.label
    sigma = None if group.sigma is None else group.sigma[own]
    moving = tuple(int(k) for k in moved)
    return Lengths(label, moving, at, position, deviation, sides, sigma, group.observation.poses > 1)
