"""ISO 10791-6: machining centres with rotary axes: the tool follows a point while a rotary axis turns.

The rotary axis turns over its measured travel, and the linear axes keep the nominal tip at one point of the workpiece
(the tests of the standard for one rotary axis: AK with two axes in the head, BK with two in the table, CK with one in
each; a ballbar, or a sphere and a nest of displacement sensors, carries them out). Recorded are the
deviations of the tip along the rotary axis, radially and tangentially to it; figures are their ranges, which do not
depend on where the sphere is exactly.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from identification.iso_standards.base import Chart, Evaluation, Quantity, Standard, spread
from identification.iso_standards.fitted import FittedMachine
from identification.iso_standards.series import DRAWS, measured_points
from identification.results.axis_lines import SAME_POSITION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from errormodel.machine import Joint, Machine
    from errormodel.survey import Survey

MODEL_POINTS = 73  # of a turn of a fitted model: every five degrees of a full one
SMALLEST_TURN = np.radians(10.0)  # of a test: less shows nothing of a rotary axis; by judgement
CLOSED_MM = 1e-6  # mm: distance from the wanted point that counts as reached, far below any instrument
MOST_STEPS = 20  # of Newton's method: the linear axes act linearly, so that two suffice where they can reach the point
STANDING_MM = 0.01  # mm: how far the nominal tip of a survey may be from one point of the workpiece
FEWEST_POINTS = 8
DIRECTIONS = {"axial": "along the axis", "radial": "radial to the axis", "tangential": "tangential to the axis"}


class Turn(NamedTuple):
    """Deviations while one rotary axis turns: positions (n,) rad, deviations (1 + draws, n, 3) mm by `DIRECTIONS`."""

    joint: str
    q: Array
    values: Array
    radius: float


class RotaryAxes(Standard):
    """Simultaneous motion of a rotary axis and the linear axes."""

    number = "10791-6"
    title = "ISO 10791-6:2014, accuracy of interpolation with rotary axes"
    needs = (
        f"measured points (all components) while one rotary joint turns by 10° or more in {FEWEST_POINTS} rows and the "
        "linear joints keep the tip at one point of the workpiece"
    )

    def of_survey(self, survey: Survey, machine: Machine) -> Evaluation:
        found = list(_turns(survey, machine))
        if not found:
            raise self.lacking(survey, "no rows in which a rotary joint turns while the tip stays at one point")
        known = len(found[0].values) > 1
        basis = "noise of the instrument as declared" if known else "the survey declares no noise of its instrument"
        return _evaluation(self, f"survey {survey.source.name}", found, basis, ())

    def of_fit(self, model: FittedMachine) -> Evaluation:
        rotary = [j for j in model.joints if j.type == "rotary" and np.ptp(model.covered[j.name]) >= SMALLEST_TURN]
        if not rotary:
            found = "no rotary joint turned by 10° or more in its survey"
            raise InputError(str(model.folder), found, "Measure the rotary axes, or take another standard")
        turns = [t for j in rotary if (t := _of_model(model, j)) is not None]
        unreached = [j.name for j in rotary if j.name not in {t.joint for t in turns}]
        if not turns:
            found = "the linear axes cannot keep the tip at one point while a rotary axis turns"
            raise InputError(str(model.folder), found, "Take a machine with three linear axes")
        notes = ["positions that stand still: errors of the drives at feed are not in the model"]
        notes += [f"{name}: the linear axes cannot follow over the measured travels" for name in unreached]
        return _evaluation(self, model.source, turns, "covariance of the fit", tuple(notes))


def _of_model(model: FittedMachine, joint: Joint) -> Turn | None:
    """The path on which the tip stays at its point in the middle of the volume; None where it cannot."""
    k = model.joints.index(joint)
    low, high = model.range(joint)
    q = np.tile(model.middle(), (MODEL_POINTS, 1))
    q[:, k] = np.linspace(low, high, MODEL_POINTS)
    linear = [i for i, j in enumerate(model.joints) if j.type == "prismatic"]
    if not linear:
        return None
    target = model.nominal(model.middle()[None])[0]
    for _ in range(MOST_STEPS):
        gap = target - model.nominal(q)
        if np.linalg.norm(gap, axis=1).max() < CLOSED_MM:
            break
        steps = np.stack([_step(model, q, i) for i in linear], axis=2)  # (n, 3, linear)
        q[:, linear] += np.einsum("nij,nj->ni", np.linalg.pinv(steps), gap)
    else:
        return None
    travel = np.array([model.joints[i].travel for i in linear])
    inside = ((q[:, linear] >= travel[:, 0] - 1e-6) & (q[:, linear] <= travel[:, 1] + 1e-6)).all(axis=1)
    if inside.sum() < FEWEST_POINTS or np.ptp(q[inside, k]) < SMALLEST_TURN:
        return None
    q = q[inside]
    axis, centre = _axis(model.chain, joint, q)
    return _turn(joint.name, q[:, k], model.errors(q), model.nominal(q), axis, centre)


def _step(model: FittedMachine, q: Array, joint: int) -> Array:
    """Motion of the nominal tip (n, 3) per mm of a linear joint."""
    moved = q.copy()
    moved[:, joint] += 1.0
    return model.nominal(moved) - model.nominal(q)


def _axis(chain: Chain, joint: Joint, q: Array) -> tuple[Array, Array]:
    """Direction (n, 3) of a rotary axis and a point (n, 3) on it, in the axes of the workpiece."""
    names = [j.name for j in chain.machine.joints]
    place = [e.name for e in chain.machine.elements].index(joint.name)
    frames = [chain.frames(dict(zip(names, row.tolist(), strict=True)))[place] for row in q]
    return np.array([f[:3, :3] @ np.array(joint.axis) for f in frames]), np.array([f[:3, 3] for f in frames])


def _turn(joint: str, q: Array, errors: Array, nominal: Array, axis: Array, centre: Array) -> Turn:
    """Deviations (1 + draws, n, 3) split along, radially and tangentially to the axis."""
    arm = nominal - centre
    arm -= np.sum(arm * axis, axis=1)[:, None] * axis
    radius = np.linalg.norm(arm, axis=1)
    # on the axis itself any direction across it is radial
    other = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis[0]))])
    radial = np.where(radius[:, None] > 1e-3, arm / np.maximum(radius, 1e-12)[:, None], other)
    radial /= np.linalg.norm(radial, axis=1)[:, None]
    directions = np.stack([axis, radial, np.cross(axis, radial)], axis=2)
    free = errors - errors.mean(axis=1, keepdims=True)  # where the sphere stands exactly is not known
    return Turn(joint, q, np.einsum("kni,nij->knj", free, directions), float(np.median(radius)))


def _turns(survey: Survey, machine: Machine) -> Iterator[Turn]:
    chain = Chain(machine)
    points = measured_points(survey, machine, chain)
    if points is None:
        return
    joints = machine.joints
    q = survey.commands([j.name for j in joints])[points.index]
    rotary = [k for k, j in enumerate(joints) if j.type == "rotary"]
    rng = np.random.default_rng(0)
    for k in rotary:
        others = [r for r in rotary if r != k]
        key = np.hstack([np.round(q[:, others] / SAME_POSITION), np.round(points.nominal / STANDING_MM)]).astype(
            np.int64
        )
        _, inverse = np.unique(key, axis=0, return_inverse=True)
        for code in range(int(inverse.max()) + 1):
            own = np.flatnonzero((inverse.ravel() == code) & np.isfinite(points.deviation).all(axis=1))
            if len(own) < FEWEST_POINTS or np.ptp(q[own, k]) < SMALLEST_TURN:
                continue
            errors = points.deviation[own][None]
            if points.sigma is not None:
                noise = points.sigma[own] * rng.standard_normal((DRAWS, len(own), 3))
                errors = np.concatenate([errors, errors + noise])
            axis, centre = _axis(chain, joints[k], q[own])
            yield _turn(joints[k].name, q[own, k], errors, points.nominal[own], axis, centre)


def _evaluation(kind: RotaryAxes, source: str, found: list[Turn], basis: str, notes: tuple[str, ...]) -> Evaluation:
    quantities = []
    for turn in found:
        for n, (symbol, words) in enumerate(DIRECTIONS.items()):
            value, expanded = spread(np.ptp(turn.values[:, :, n], axis=-1))
            text = f"range of the deviation {words} while {turn.joint} turns (radius {turn.radius:.4g} mm)"
            quantities.append(Quantity(symbol, turn.joint, text, value, "mm", expanded, basis))
    charts = tuple(
        Chart(
            f"turning {t.joint}",
            f"{t.joint} turns and the linear axes follow: deviations of the tip at radius {t.radius:.4g} mm, with "
            "bands of ± 2 standard uncertainties.",
            f"Deviations along, radially and tangentially to the axis of {t.joint} over its position",
            partial(_draw, t),
        )
        for t in found
    )
    data = {
        t.joint: {"q": np.degrees(t.q).tolist(), "radius": t.radius, "deviations": t.values[0].tolist()} for t in found
    }
    return Evaluation(kind.number, kind.title, source, tuple(quantities), (), charts, notes, data)


def _draw(turn: Turn) -> Figure:
    from matplotlib.figure import Figure

    from identification.plots import style

    figure = Figure(figsize=(style.REPORT_WIDTH_IN, 3.2), facecolor="white")
    axes = style.panel(figure, 0.75, 0.55, 5.7, 2.4)
    order = np.argsort(turn.q, kind="stable")
    place = np.degrees(turn.q)[order]
    for n, (name, colour) in enumerate(zip(DIRECTIONS, style.AXIS_COLOURS, strict=True)):
        values = 1e3 * turn.values[:, order, n]
        axes.plot(place, values[0], lw=1.3, marker=".", ms=3, color=colour, label=name)
        if len(values) > 1:
            band = 2 * np.sqrt(np.mean(np.square(values[1:] - values[0]), axis=0))
            axes.fill_between(place, values[0] - band, values[0] + band, color=colour, alpha=0.15, lw=0)
    style.dress(axes, f"{style.plain(turn.joint, 16)} / °", "deviation / µm")
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=style.SMALL_TEXT, frameon=False)
    return figure
