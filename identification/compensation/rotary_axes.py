"""Constant errors of rotary axes: where each axis really lies, for the kinematic description of a controller.

A rotary axis that lies beside its nominal place, or tilted, is no matter of tables: controllers with tool centre point
control describe their rotary axes by vectors, and these take the error away exactly, with any tool. Found by least
squares over the measured volume, after the best frame: shift and tilt of every rotary axis, actual minus nominal, such
that the nominal machine with these axes comes closest to the actual one. What they cannot say is left to tables.

An axis displaced by a small rigid motion d turns the tool by ``d R d^-1``: the tip moves by the lever of ``d - R d``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from textwrap import wrap
from typing import Any

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.axes import directions_at_zero
from errormodel.controllers.base import Line
from errormodel.controllers.setup import Setup
from identification.compensation.field import Field
from identification.compensation.sample import frame_motion
from identification.compensation.volume import Volume

POSES = 1024  # of the least squares; a power of two, for Sobol points
DESCRIPTION = "kinematics.txt"
TEXT_WIDTH = 110  # characters of a line
WORTH_SHARE = 0.8  # of the rms error that may be left for the description to be mentioned; by judgement
ANGLE_SCALE = 1000.0  # mm per rad, which makes shifts and tilts alike in size; by judgement


def lines_of(volume: Volume, setup: Setup, tilts: bool = True) -> tuple[Line, ...]:
    """Place and direction of each rotary axis that moved, actual minus nominal, in the reference's axes.

    Without `tilts` the shifts alone come closest to the actual machine: of a control that can be told no others.
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
    found = np.linalg.lstsq(design, errors, rcond=1e-9)[0]
    out = []
    for n, k in enumerate(moved):
        count = bases[k].shape[1]
        motion = bases[k] @ found[count * n : count * (n + 1)]
        shift, tilt = turn[k] @ motion[:3], turn[k] @ motion[3:]
        axis = next(a for a in setup.axes if a.joint == field.joints[k].name)
        moved_by, turned_by, way = (tuple(v.tolist()) for v in (shift, tilt, along[k]))
        out.append(Line(axis.name, moved_by, turned_by, way, _side(field, k), axis.centre))
    return tuple(out)


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


@dataclass(frozen=True)
class Kinematics:
    """Rotary axes as they lie, and what that is worth: rms errors over the volume, um, with it and without."""

    lines: tuple[Line, ...]
    before_um: float
    left_um: float
    asked: bool  # whether the tables are for what remains with it
    tilts: bool = True  # whether it says how the axes are tilted
    tables_alone_um: float | None = None  # what such tables leave without it; None: not asked

    def first(self) -> str:
        """What to do before the tables, or what to ask for."""
        if self.asked:
            without = f", {self.tables_alone_um:.1f} without it" if self.tables_alone_um is not None else ""
            return (
                f"FIRST: put the rotary axes of {DESCRIPTION} into the control's kinematic description (tool centre "
                f"point control on); the tables are for what remains with it{without}"
            )
        return (
            f"constant errors of the rotary axes are a good part: the control's kinematic description alone leaves "
            f"{self.left_um:.1f} of {self.before_um:.1f} um rms, with any tool; --kinematics writes it, and tables for "
            "what remains"
        )

    def as_json(self) -> dict[str, Any]:
        return asdict(self)

    @property
    def worth(self) -> bool:
        """Whether the description alone takes away a fifth of the error."""
        return self.left_um < WORTH_SHARE * self.before_um


def description_text(found: Kinematics, heading: Sequence[str], steps: Sequence[str]) -> str:
    """``kinematics.txt``: what to change in the controller's kinematic description."""
    lines = [
        *(part for line in heading for part in wrap(line, TEXT_WIDTH)),
        "Place and direction of the rotary axes, actual minus nominal of machine.yaml, all axes at zero,",
        "in the axes of the reference (x y z of the machine). About and along itself an axis has neither.",
        "",
    ]
    for one in found.lines:
        shift = ", ".join(f"{a} {v:+.4f} mm" for a, v in zip("xyz", one.shift, strict=True) if abs(v) > 5e-5)
        tilt = ", ".join(
            f"about {a} {1e6 * v:+.1f} urad" for a, v in zip("xyz", one.tilt, strict=True) if abs(v) > 5e-8
        )
        tilt = f"tilt {tilt or 'none'}" if found.tilts else "tilt not described"
        side = {"table": "carries the workpiece", "head": "carries the tool"}.get(one.side, "between linear axes")
        lines.append(f"axis {one.axis} ({side}): shift {shift or 'none'}; {tilt}")
        place = " ".join(f"{v + 0.0:.3f}" for v in one.at)
        slope = " ".join(f"{1000 * v + 0.0:+.4f}" for v in one.slope)
        way = " ".join(f"{v + 0.0:g}" for v in one.along)
        point = f"    the shift is that of its point {place} (mm from the tip, all axes at zero)"
        if not found.tilts:
            lines.append(point)
            continue
        lines += [
            f"{point}; 1000 mm farther",
            f"    along {way} it is {slope} mm more: where the control's vectors end elsewhere, add that share",
        ]
    lines += [
        "",
        f"error over the volume: {found.before_um:.2f} um rms without, {found.left_um:.2f} with this alone",
        "",
        *(part for step in steps for part in wrap(step, TEXT_WIDTH, subsequent_indent="    ")),
    ]
    return "\n".join(lines) + "\n"
