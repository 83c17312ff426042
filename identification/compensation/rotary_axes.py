"""Constant errors of rotary axes: where each axis really lies, for the kinematic description of a controller.

A rotary axis that lies beside its nominal place, or tilted, is no matter of tables: controllers with tool centre point
control describe their rotary axes by vectors, and these take the error away exactly, with any tool. Found by least
squares over the measured volume, after the best frame: shift and tilt of every rotary axis, actual minus nominal, such
that the nominal machine with these axes comes closest to the actual one. What they cannot say is left to tables.

An axis displaced by a small rigid motion d turns the tool by ``d R d^-1``: the tip moves by the lever of ``d - R d``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.axes import directions_at_zero
from errormodel.controllers.base import Controller, Target
from errormodel.controllers.rotary_lines import Line
from errormodel.controllers.setup import Setup
from errormodel.exceptions import InputError
from errormodel.surveys.columns import TOOL_COLUMNS
from identification.compensation.assessment import left, nothing
from identification.compensation.conditions import PLAUSIBLE_MM
from identification.compensation.field import Field
from identification.compensation.kinematic_description import ANGLE_SCALE, Elsewhere, Kinematics
from identification.compensation.model_uncertainty import sensitivities_at
from identification.compensation.sample import frame_motion
from identification.compensation.volume import Volume
from identification.observation.stated_tip import tip_is_stated
from identification.results.stored_fit import StoredFit

POSES = 1024  # of the least squares; a power of two, for Sobol points
LEAST_STD = 1e-6  # mm, a hundredth of the last digit that is written: what moves an axis by less is not named
LEAST_OF_TIP = 0.1  # mm of shift a mm that the tip is elsewhere: what moves an axis by less is not named


def lines_of(volume: Volume, setup: Setup, tilts: bool = True, fit: StoredFit | None = None) -> tuple[Line, ...]:
    """Place and direction of each rotary axis that moved, actual minus nominal, in the reference's axes.

    Without `tilts` the shifts alone come closest to the actual machine: of a control that can be told no others. How
    uncertain they are follows from the covariance of `fit`, by the same least squares; None: it is not said.
    """
    field = volume.field
    moved = [k for k in range(len(field.joints)) if field.rotary[k] and volume.high[k] > volume.low[k]]
    if not moved:
        return ()
    along, turn = directions_at_zero(field.chain.machine, field.chain), field.turns_at_zero
    q, came = volume.poses(POSES, 21)
    nominal = field.nominal(q)
    errors = (field.actual(q, came) - nominal).ravel()
    bases = {k: _across(turn[k].T @ along[k])[:, : 4 if tilts else 2] for k in moved}
    columns = [field.displaced(q, k) @ bases[k] for k in moved]
    frame = frame_motion(nominal, volume.free and volume.pose is None, volume.turns)
    design = np.concatenate([*columns, frame], axis=2).reshape(len(errors), -1)

    def solve(changes: Array) -> Array:
        return np.asarray(np.linalg.lstsq(design, changes, rcond=1e-9)[0], np.float64)

    found, causes, unseen, tips = solve(errors), *(np.zeros((design.shape[1], n)) for n in (0, 0, 3))
    names: tuple[str, ...] = ()
    if fit is not None:
        unknown = sensitivities_at(fit, field, q, came, [(1.0, None)])
        base, unseen, names = solve(unknown.base), solve(unknown.unseen), unknown.names
        tips = solve(_of_tip(field, q)) if tip_is_stated(fit.chain.machine) else tips
        values, vectors = np.linalg.eigh(base @ unknown.covariance @ base.T)
        causes = vectors * np.sqrt(np.maximum(values, 0.0))  # round-off of zero may be negative
    out = []
    for n, k in enumerate(moved):
        count = bases[k].shape[1]
        own = slice(count * n, count * (n + 1))
        ways = np.vstack([turn[k] @ bases[k][:3], turn[k] @ bases[k][3:]])
        motion, spread = ways @ found[own], ways @ causes[own]
        std = np.linalg.norm(causes[own], axis=1)[:, None]
        share = np.max(np.abs(unseen[own]) / np.maximum(std, LEAST_STD), axis=0)
        of_tip = np.linalg.norm((ways @ tips[own])[:3], axis=0) > LEAST_OF_TIP
        confounded = (
            *(name for name, seen in zip(TOOL_COLUMNS, of_tip, strict=True) if seen),
            *(names[m] for m in np.argsort(-share, kind="stable") if share[m] > 1),
        )
        axis = next(a for a in setup.axes if a.joint == field.joints[k].name)
        moved_by, turned_by, way = (tuple(v.tolist()) for v in (motion[:3], motion[3:], along[k]))
        each = tuple(map(tuple, spread.T.tolist()))
        out.append(Line(axis.name, moved_by, turned_by, way, _side(field, k), axis.centre, each, confounded))
    return tuple(out)


def _of_tip(field: Field, q: Array) -> Array:
    """Displacements (3 n, 3) of the tip at poses (n, joints), mm a mm that it is elsewhere along x, y, z."""
    tool = np.tile(field.chain.machine.tool, (len(q), 1))
    return np.stack([(field.nominal(q, tool + e) - field.nominal(q, tool)).ravel() for e in np.eye(3)], axis=1)


def refuse_large(lines: Sequence[Line], allowed: bool) -> None:
    """InputError where an axis lies further beside its nominal place than machines are built, unless it is allowed."""
    far = max(lines, key=lambda one: float(np.linalg.norm(one.shift)))
    size = float(np.linalg.norm(far.shift))
    if size > PLAUSIBLE_MM and not allowed:
        raise InputError(
            f"compensate, --kinematics, axis {far.axis}",
            f"a shift of {size:.3g} mm beside its nominal place",
            "Look for a tip of the probe that is not where tool says (tool_x tool_y tool_z), and for wrong offsets in "
            f"machine.yaml; --allow-large writes shifts beyond {PLAUSIBLE_MM:g} mm, too",
        )


def described(field: Field, setup: Setup, lines: Sequence[Line]) -> Field:
    """The field whose nominal machine has its rotary axes where they really lie."""
    turn = field.turns_at_zero
    motions = np.zeros((len(field.joints), 6))
    for line in lines:
        k = setup.place(line.axis)
        motions[k] = np.concatenate([turn[k].T @ np.array(line.shift), turn[k].T @ np.array(line.tilt)])
    return replace(field, description=tuple(map(tuple, motions.tolist())))


def _across(axis: Array) -> Array:
    """(6, 4): shifts (mm) and tilts (rad, scaled) across an axis; along and about it nothing is seen."""
    across = np.linalg.svd(axis[None])[2][1:]
    out = np.zeros((6, 4))
    out[:3, :2], out[3:, 2:] = across.T, across.T / ANGLE_SCALE
    return out


def _side(field: Field, k: int) -> str:
    """Whether a rotary joint carries the workpiece, or the tool: by its place among the linear joints of the chain."""
    linear = [i for i in range(len(field.joints)) if not field.rotary[i]]
    return "table" if not linear or k < min(linear) else "head" if k > max(linear) else ""


def rotary_axes(
    controller: Target,
    volume: Volume,
    setup: Setup,
    seed: int,
    asked: bool,
    fit: StoredFit,
    allow_large: bool,
    state: Mapping[str, float],
    others: Sequence[Mapping[str, float]],
) -> Kinematics | None:
    """Rotary axes as they lie, and what that is worth; None: there are none, or nothing that describes them.

    Parameters
    ----------
    state : the channels that errors change with, as they are where the axes are described (`volume` is in it).
    others : other states of the machine, for which it is said how far the axes lie elsewhere, and what is left.

    Raises
    ------
    InputError
        They are asked for where there are none, or of a target that has no kinematic description.
    """
    if not isinstance(controller, Controller):
        if asked:
            raise InputError("--kinematics", f"{controller.title} corrects the commands themselves", "Leave it out")
        return None
    if not controller.describes:
        if asked:
            found = f"{controller.title} has no kinematic description of rotary axes"
            raise InputError("--kinematics", found, "Leave it out: tables then hold what they can of their errors")
        return None
    lines = lines_of(volume, setup, tilts := controller.describes_tilt, fit)
    if not lines:
        if asked:
            raise InputError("--kinematics", "no rotary joint moved in the survey", "Leave it out")
        return None
    refuse_large(lines, allow_large or not asked)
    known = replace(volume, field=described(volume.field, setup, lines))
    before, with_it = (left(v, nothing, seed).rms_um for v in (volume, known))
    elsewhere = []
    for other in others:
        # the workpiece stays where it was set up: what the state moves is an error
        there = (replace(v, pose=v.frame if v.free else v.pose).at(other) for v in (volume, known))
        errors = (left(v, nothing, seed).rms_um for v in there)
        elsewhere.append(Elsewhere(other, lines_of(volume.at(other), setup, tilts), *errors))
    return Kinematics(lines, before, with_it, asked, tilts, None, state, tuple(elsewhere))
