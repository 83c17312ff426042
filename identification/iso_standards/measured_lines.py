"""Straightness and angles along a line, as a straightedge, an alignment laser or an autocollimator reads them.

A reading across a reference line becomes a deviation of the joint that moves along it; a stated slope of the reference
line is taken off. Lines of two joints that were read against one reference line, or against lines whose slopes are
stated, show the angle between both joints.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.location_errors import ALIGNED_COSINE
from errormodel.machine import Machine
from errormodel.survey import Survey
from errormodel.surveys.observations import Group, groups
from identification.iso_standards.series import Series, sides_of
from identification.results.axis_lines import LEAST_MOVED, SAME_POSITION

FEWEST_TARGETS = 3  # of which a line leaves something
STATED = "stated slopes"


@dataclass(frozen=True)
class MeasuredLine:
    """Readings of one observation along a joint.

    Attributes
    ----------
    series : with one component of `deviation`, or of `turn`, filled.
    component : 0 to 2, of x, y, z; `turns` : whether it is a rotation about that axis.
    reference : lines of the same one were read against one direction; empty: its slope is unknown to others.
    """

    series: Series
    component: int
    turns: bool
    reference: str


def lines_of(survey: Survey, machine: Machine) -> Iterator[MeasuredLine]:
    """Readings across a line, or of angles along it, while one linear joint moves."""
    if not survey.observations:
        return
    chain = Chain(machine)
    q = survey.commands([j.name for j in machine.joints])
    for group in groups(survey.table, survey.observations):
        if group.observation.along_line and (found := _line(survey, machine, chain, group, q[group.index])):
            yield found


def _line(survey: Survey, machine: Machine, chain: Chain, group: Group, q: Array) -> MeasuredLine | None:
    """The readings of a group; None where they are not of one linear joint along, or about, a principal direction."""
    moved = np.flatnonzero(np.ptp(q, axis=0) > LEAST_MOVED)
    if len(moved) != 1 or machine.joints[moved[0]].type != "prismatic":
        return None
    joint, at = machine.joints[moved[0]], q[:, moved[0]]
    if len(np.unique(np.round(at / SAME_POSITION))) < FEWEST_TARGETS:
        return None
    known = {n.name: n.value for n in group.observation.quantities() if n.value is not None}
    turns = group.observation.reading == "angle"
    line, counted = (np.array([known.get(f"{n}_{a}", 0.0) for a in "xyz"]) for n in "uv")
    points = chain.kernel("nominal", outputs=(0, 1, 2))(group.channels(chain, survey.table)).T
    step = points[np.argmax(at)] - points[np.argmin(at)]
    axis = step / np.linalg.norm(step)
    toward = line if turns else counted
    component = int(np.argmax(np.abs(toward)))
    if abs(toward[component]) < ALIGNED_COSINE or (not turns and abs(axis @ line) < ALIGNED_COSINE):
        return None
    slope = known.get("slope", 0.0)
    values = np.full((len(at), 3), np.nan)
    sigma = None if group.sigma is None else np.full((len(at), 3), np.nan)
    moves = 0.0 if turns else slope * (points @ line) - points @ counted
    values[:, component] = np.sign(toward[component]) * (group.readings + moves)
    if sigma is not None and group.sigma is not None:
        sigma[:, component] = group.sigma
    nothing = np.full_like(values, np.nan)
    deviation, turn = (nothing, values) if turns else (values, nothing)
    series = Series(
        joint, f"{group.label}, run {group.run}" if group.run else group.label, at, axis, deviation, turn,
        None if turns else sigma, sigma if turns else None, sides_of(survey, joint, group.index, at), group.index,
    )  # fmt: skip
    unknown = any(n.name == "slope" for n in group.observation.free)
    shared = "" if turns or group.own("slope") else group.label if unknown else STATED
    return MeasuredLine(series, component, turns, shared)
