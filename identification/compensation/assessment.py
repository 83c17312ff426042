"""Residual error of a compensation over the volume and on held-out poses, by exact kinematics.

Commands in mm and rad, errors in mm (figures in um). Where the survey's frame is free, errors are taken after the
best-fit rigid motion of the frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.base import Controller
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Tables
from identification.compensation.field import Field
from identification.compensation.rows import FEWEST_HELD_OUT, Rows
from identification.compensation.volume import Volume, best_frame

SAME_TOOL_MM = 0.5  # mm between tool tips: closer tips count as the same tool; by judgement
OTHER_TOOLS = "other tools"  # ending of the description of rows with other tools
JOINT_ROWS = ", about "  # in the description of rows that read one joint
FRESH_POSES = 1024  # poses for the assessment, other than those of the reduction; a power of two, for Sobol points

Correct = Callable[[Array, Array, Array | None], Array]
"""Commands (n, joints), mm, rad, from nominal commands, directions of approach (`Field.rows`) and tool tips (n, 3)."""


@dataclass(frozen=True)
class Error:
    """Volumetric error over n poses, um, after the best-fit frame where frames are free."""

    rms_um: float
    worst_um: float
    where: tuple[float, ...]  # command at the pose of the largest error, mm and deg
    n: int

    @classmethod
    def of(cls, errors: Array, q: Array) -> Error:
        """Summarise errors (n, 3) in mm at commands (n, joints) in mm and deg."""
        length = 1e3 * np.linalg.norm(errors, axis=1)
        k = int(np.argmax(length))
        return cls(float(np.sqrt(np.mean(length**2))), float(length[k]), tuple(q[k].tolist()), len(q))


@dataclass(frozen=True)
class Figures:
    """Errors on one set of poses: uncompensated, with exact inverse commands, and with the controller's tables.

    Attributes
    ----------
    model_um : standard uncertainty (k = 1) of the model itself there, root mean square; None: not known.
    in_state : error after the tables, had the rows been measured in the state that the tables are for; None: they
        were, as far as the model knows.
    """

    poses: str
    before: Error
    ideal: Error
    after: Error
    model_um: float | None = None
    in_state: Error | None = None

    def removed(self) -> float:
        """Reduction of the RMS error as a share of the reduction by the ideal compensation."""
        gain = self.before.rms_um - self.ideal.rms_um
        return (self.before.rms_um - self.after.rms_um) / gain if gain > 0 else 1.0


def emulated(controller: Controller, tables: Tables, setup: Setup, volume: Volume) -> Correct:
    """Commands as the controller computes them from its tables."""
    field, movers = volume.field, list(volume.field.movers)
    unit = np.where(field.rotary, np.pi / 180, 1.0)[movers]

    def correct(q: Array, direction: Array, tool: Array | None) -> Array:
        out = q.copy()
        longer = None if tool is None else (tool - np.asarray(setup.tool)) @ np.asarray(setup.along_tool)
        came = direction[:, : len(field.joints)]  # no table knows the path before
        out[:, movers] += controller.emulate(tables, setup, field.outward(q), came, longer) * unit
        return out

    return correct


def ideal(volume: Volume) -> Correct:
    """Commands by the exact inverse kinematics."""
    return volume.ideal


def nothing(q: Array, direction: Array, tool: Array | None) -> Array:
    """Uncompensated commands."""
    return q


def assess(volume: Volume, correct: Correct, held: Rows | None, seed: int) -> list[Figures]:
    """Errors on new poses of the volume, and on held-out rows if there are any."""
    return [
        _figures(volume, correct, rows)
        for rows in (fresh_rows(volume, seed), *_by_joint(held), *_by_tool(volume, held))
    ]


def left(volume: Volume, correct: Correct, seed: int) -> Error:
    """Residual error of corrected commands on new poses of the volume."""
    rows = fresh_rows(volume, seed)
    return Error.of(remaining(volume, correct, rows), volume.field.outward(rows.q))


def fresh_rows(volume: Volume, seed: int) -> Rows:
    """Poses of the volume that the reduction did not use, and the corners of the volume."""
    q, came = volume.poses(FRESH_POSES, seed + 11)
    corners = volume.corners()
    q, came = np.vstack([q, corners[0]]), np.vstack([came, corners[1]])
    n = len(q)
    tool = np.tile(volume.field.chain.machine.tool, (n, 1)).astype(np.float64)
    return Rows(
        q,
        came,
        tool,
        np.zeros((n, 3)),
        np.full(n, "", dtype=object),
        f"{n} poses over the measured volume, by the model",
    )


def _by_joint(held: Rows | None) -> list[Rows]:
    """Held-out error motions, joint by joint, since readings of one joint do not contain the errors of another."""
    about = None if held is None else held.about
    if held is None or about is None:
        return []
    return [held.part(about == joint, f"{JOINT_ROWS[2:]}{joint}") for joint in dict.fromkeys(about)]


def _by_tool(volume: Volume, held: Rows | None) -> list[Rows]:
    """Held-out rows split into those with the tool of the tables and those with other tools.

    Tables do not depend on the tool's orientation, so other tools are assessed apart, each after its own best-fit
    frame: the constant offset of a tool is removed when the tool is measured.
    """
    if held is None or held.about is not None:
        return []
    own = np.linalg.norm(held.tool - np.asarray(volume.field.chain.machine.tool), axis=1) < SAME_TOOL_MM
    if not own.any():
        return [held.part(~own, OTHER_TOOLS)]
    if own.all() or min(own.sum(), (~own).sum()) < FEWEST_HELD_OUT:
        return [held]
    return [held.part(own, "this tool"), held.part(~own, OTHER_TOOLS)]


def _figures(volume: Volume, correct: Correct, rows: Rows) -> Figures:
    if rows.about is not None:
        volume = replace(volume, field=volume.field.of_joints(rows.about[:1]), pose=None)  # each run has a zero
    # exact commands would follow what tables hold at one value, too
    cases = (nothing, rows.measured), (volume.ideal, rows.in_state), (correct, rows), (correct, rows.in_state)
    found = (Error.of(remaining(volume, c, r), volume.field.outward(r.q)) for c, r in cases[: 4 if rows.own else 3])
    before, best, after, *held = found
    return Figures(rows.what, before, best, after, in_state=held[0] if held else None)


def remaining(volume: Volume, correct: Correct, rows: Rows) -> Array:
    """Residual errors (n, 3), mm, after the best-fit motion of each measuring frame, or with the given frame.

    Rows of a survey have the times, temperatures and records of their own, which the tables did not know.
    """
    field = volume.field
    nominal = field.nominal(rows.q, rows.tool)
    actual = field.actual(correct(rows.q, rows.direction, rows.tool), rows.direction, rows.tool, rows.own)
    errors = actual - (nominal if volume.pose is None else volume.pose.apply(nominal)) + rows.left
    if not volume.free or volume.pose is not None:
        return errors
    labels, counts = np.unique(rows.frames.astype(str), return_counts=True)
    fewest = 2 * FEWEST_HELD_OUT if volume.turns else 2
    small = np.isin(rows.frames.astype(str), labels[counts < fewest])
    out = errors.copy()
    for label in [*labels[counts >= fewest], None]:
        part = small if label is None else (rows.frames.astype(str) == label)
        if part.sum() > (2 if volume.turns else 1):
            frame = best_frame(errors[part], nominal[part], volume.turns)
            out[part] = errors[part] - (frame.apply(nominal[part]) - nominal[part])
    return out


def in_state(volume: Volume, field: Field) -> Volume:
    """The same volume with the machine in another state."""
    return replace(volume, field=field)
