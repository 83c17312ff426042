"""Circles of commands of two linear axes in a survey, and the radial deviations on them.

They are those of measured points, or what a telescoping bar reads around its ball.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.surveys.observations import groups
from identification.iso_standards.series import DRAWS, measured_points
from identification.results.axis_lines import SAME_POSITION

if TYPE_CHECKING:
    from errormodel.machine import Machine
    from errormodel.survey import Survey

LEAST_ARC = np.radians(300.0)  # of a circle in a survey: less does not determine its centre well; by judgement
FEWEST_POINTS = 8  # of a circle in a survey
ROUND_SHARE = 1e-6  # of the radius: commands closer to the circle lie on it
SPACINGS = (1, 2, 5, 10, 20, 40, 80, 160)  # rows between three commands that a circle is tried through
TRIES = 200  # of three commands with each spacing
MOST_CIRCLES = 20  # at one position of the other axes


@dataclass(frozen=True)
class Circle:
    """Deviations on one circle.

    Attributes
    ----------
    axes : names of the two axes; `radius` in mm.
    angle : (n,) rad from the first axis to the second.
    radial : (1 + draws, n) mm, outward, about the nominal centre; `sense` (n,) +1 counter-clockwise, -1 clockwise.
    sized : whether the radial deviations are from the commanded radius; else from a length that is not known.
    bar : length in mm that the readings of a bar were taken as deviations from; NaN: of measured points.
    label : of the observation of a bar; empty: of measured points.
    """

    axes: tuple[str, str]
    radius: float
    angle: Array
    radial: Array
    sense: Array
    sized: bool = True
    bar: float = float("nan")
    label: str = ""

    @property
    def name(self) -> str:
        return "".join(self.axes)

    def of(self, sense: float) -> tuple[Array, Array]:
        own = self.sense == sense
        return self.angle[own], self.radial[:, own]


def circles_of(survey: Survey, machine: Machine) -> Iterator[Circle]:
    """The circles in a survey, those of measured points first."""
    yield from _of_points(survey, machine)
    yield from _of_bars(survey, machine)


def arcs_of(survey: Survey, found: Sequence[Circle]) -> list[str]:
    """Observations of a bar along a circle that are none of those found: arcs, or too few readings."""
    traced = [g.label for g in groups(survey.table, survey.observations) if g.observation.trace == "circle"]
    return [label for label in dict.fromkeys(traced) if label not in {c.label for c in found}]


def _of_points(survey: Survey, machine: Machine) -> Iterator[Circle]:
    points = measured_points(survey, machine, Chain(machine))
    if points is None:
        return
    joints = machine.joints
    q = survey.commands([j.name for j in joints])[points.index]
    runs = _runs(survey)[points.index]
    rng = np.random.default_rng(0)
    linear = [k for k, j in enumerate(joints) if j.type == "prismatic"]
    for a, b in combinations(linear, 2):
        others = np.round(np.delete(q, [a, b], axis=1) / SAME_POSITION).astype(np.int64)
        _, inverse = np.unique(others, axis=0, return_inverse=True)
        for code in range(int(inverse.max()) + 1):
            own = np.flatnonzero(inverse.ravel() == code)
            for angle, radius, on in _all_circles(q[own][:, [a, b]]):
                rows = own[on]
                u, v = _direction(points.nominal[rows], q[rows, a], q[rows, b])
                outward = np.outer(np.cos(angle), u) + np.outer(np.sin(angle), v)
                used = np.abs(outward).max(axis=0) > 1e-9
                radial = np.sum(points.deviation[rows][:, used] * outward[:, used], axis=1)
                if not np.isfinite(radial).all():
                    continue
                std = None
                if points.sigma is not None:
                    std = np.sqrt(np.sum(np.square(points.sigma[rows][:, used] * outward[:, used]), axis=1))
                drawn = _drawn(radial, std, rng)
                yield Circle((joints[a].name, joints[b].name), radius, angle, drawn, senses(angle, runs[rows]))


def _of_bars(survey: Survey, machine: Machine) -> Iterator[Circle]:
    """Lengths of a bar along a circle: its length less the commanded radius is the radial deviation from its ball."""
    joints = machine.joints
    linear = [k for k, j in enumerate(joints) if j.type == "prismatic"]
    q = survey.commands([j.name for j in joints])
    runs = _runs(survey)
    rng = np.random.default_rng(0)
    for group in groups(survey.table, survey.observations):
        if group.observation.trace != "circle":
            continue
        seen = np.isfinite(group.readings)
        own, readings = group.index[seen], group.readings[seen]
        moved = [k for k in linear if len(own) and np.ptp(q[own, k]) > SAME_POSITION]
        circle = _circle(q[own][:, moved]) if len(moved) == 2 and len(own) >= FEWEST_POINTS else None
        if circle is None:
            continue
        angle, radius = circle
        bar = next((b.value for b in group.observation.quantities() if b.name == "calibrated"), None)
        radial = readings + (-float(readings.mean()) if bar is None else bar - radius)
        drawn = _drawn(radial, None if group.sigma is None else group.sigma[seen], rng)
        a, b = (joints[k].name for k in moved)
        length = float("nan") if bar is None else bar
        yield Circle((a, b), radius, angle, drawn, senses(angle, runs[own]), bar is not None, length, group.label)


def _runs(survey: Survey) -> Index:
    """Number of the run of each row."""
    return np.unique(survey.table["run"].to_numpy(dtype=str), return_inverse=True)[1]


def _drawn(radial: Array, std: Array | None, rng: np.random.Generator) -> Array:
    """Deviations (1 + draws, n): the readings, and with a known uncertainty draws of their noise."""
    if std is None:
        return radial[None]
    return np.vstack([radial, radial + std * rng.standard_normal((DRAWS, len(radial)))])


def _all_circles(q: Array) -> Iterator[tuple[Array, float, Index]]:
    """The circles that commands (n, 2) lie on, among others that lie on none: angles, radius, rows."""
    rest = np.arange(len(q))
    for _ in range(MOST_CIRCLES):
        if len(rest) < FEWEST_POINTS:
            return
        found, own = _circle(q[rest]), rest
        if found is None:
            on = _most_on_one(q[rest])
            if on is None:
                return
            own = rest[on]
            found = _circle(q[own])
        if found is not None:
            yield *found, own
        rest = np.setdiff1d(rest, own)


def _most_on_one(q: Array) -> Index | None:
    """The commands (n, 2) on the circle through three of them that holds most; None where none holds enough."""
    best: Index | None = None
    for spacing in SPACINGS:
        step = max((len(q) - 2 * spacing) // TRIES, 1)
        for k in range(0, len(q) - 2 * spacing, step):
            three = q[[k, k + spacing, k + 2 * spacing]]
            design = np.column_stack([2 * (three - three[0]), np.ones(3)])
            if abs(np.linalg.det(design)) < 1e-6:  # mm^2: on a line
                continue
            x, y, c = np.linalg.solve(design, np.square(three - three[0]).sum(axis=1))
            radius = float(np.sqrt(max(c + x * x + y * y, 0.0)))
            off = np.abs(np.linalg.norm(q - three[0] - [x, y], axis=1) - radius)
            # three that lie close together, each rounded to a micrometre, place the circle roughly only
            near = np.flatnonzero(off < ROUND_SHARE * radius + 1e-3)
            if len(near) >= FEWEST_POINTS and (best is None or len(near) > len(best)) and _circle(q[near]) is not None:
                best = near
    return best


def _circle(q: Array) -> tuple[Array, float] | None:
    """Angles and radius of commands (n, 2) on a circle; None where they lie on none."""
    design = np.column_stack([2 * q, np.ones(len(q))])
    x, y, c = np.linalg.lstsq(design, np.square(q).sum(axis=1), rcond=None)[0]
    radius = float(np.sqrt(max(c + x * x + y * y, 0.0)))
    about = q - [x, y]
    if radius < 1e-3 or np.abs(np.linalg.norm(about, axis=1) - radius).max() > ROUND_SHARE * radius + 1e-3:
        return None
    angle = np.arctan2(about[:, 1], about[:, 0])
    ordered = np.sort(np.mod(angle, 2 * np.pi))
    gap = np.max(np.append(np.diff(ordered), ordered[0] + 2 * np.pi - ordered[-1]))
    return None if 2 * np.pi - gap < LEAST_ARC or len(ordered) < FEWEST_POINTS else (angle, radius)


def senses(angle: Array, runs: Index) -> Array:
    """Sense (n,) in which each point of a path was reached: +1 counter-clockwise, -1 clockwise.

    The first point of a run, and the second of two at one place (the end of one way and the start of the way back),
    have the sense of the way that begins there.

    Parameters
    ----------
    angle : (n,) rad, in the order of the path.
    runs : (n,) number of the run of each.
    """
    turned = np.diff(np.unwrap(angle), prepend=angle[0])
    turned[np.abs(turned) < SAME_POSITION] = 0.0
    begins = np.append(True, np.diff(runs) != 0) | (turned == 0.0)
    out = np.sign(turned)
    later = 0.0  # sense of the next step, from the end on
    for k in range(len(out) - 1, -1, -1):
        step = out[k]
        if begins[k]:
            out[k] = later
        later = step or later
    for k in np.flatnonzero(out == 0.0).tolist():  # nothing follows: as before
        out[k] = out[k - 1] if k else 1.0
    return out


def _direction(nominal: Array, a: Array, b: Array) -> tuple[Array, Array]:
    """Unit vectors (3,) in which the tip moves with either axis."""
    design = np.column_stack([a - a.mean(), b - b.mean()])
    u, v = np.linalg.lstsq(design, nominal - nominal.mean(axis=0), rcond=None)[0]
    return u / np.linalg.norm(u), v / np.linalg.norm(v)
