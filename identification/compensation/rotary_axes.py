"""Constant errors of rotary axes: where each axis really lies, for the kinematic description of a controller.

A rotary axis that lies beside its nominal place, or tilted, is no matter of tables: controllers with tool centre point
control describe their rotary axes by vectors, and these take the error away exactly, with any tool. Found by least
squares over the measured volume, after the best frame: shift and tilt of every rotary axis, actual minus nominal, such
that the nominal machine with these axes comes closest to the actual one. What they cannot say is left to tables.

An axis displaced by a small rigid motion d turns the tool by ``d R d^-1``: the tip moves by the lever of ``d - R d``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from textwrap import wrap
from typing import Any

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
from identification.compensation.model_uncertainty import sensitivities_at
from identification.compensation.sample import frame_motion
from identification.compensation.volume import Volume
from identification.observation.stated_tip import tip_is_stated
from identification.results.stored_fit import StoredFit

POSES = 1024  # of the least squares; a power of two, for Sobol points
DESCRIPTION = "kinematics.txt"
TEXT_WIDTH = 110  # characters of a line
INDENT = "    "  # of what is said of one axis
WORTH_SHARE = 0.8  # of the rms error that may be left for the description to be mentioned; by judgement
LEAST_STD = 1e-6  # mm, a hundredth of the last digit that is written: what moves an axis by less is not named
MOST_NAMES = 6  # of parameters in a line
LEAST_OF_TIP = 0.1  # mm of shift a mm that the tip is elsewhere: what moves an axis by less is not named
ANGLE_SCALE = 1000.0  # mm per rad, which makes shifts and tilts alike in size; by judgement


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


@dataclass(frozen=True)
class Kinematics:
    """Rotary axes as they lie, and what that is worth: rms errors over the volume, um, with it and without."""

    lines: tuple[Line, ...]
    before_um: float
    left_um: float
    asked: bool  # whether the tables are for what remains with it
    tilts: bool = True  # whether it says how the axes are tilted
    tables_alone_um: float | None = None  # what such tables leave without it; None: not asked

    @property
    def of_tip(self) -> str:
        """Which values hold only as far as the tip of the probe is where the machine's file has it; or empty."""
        names = [f"{one.axis} ({', '.join(own)})" for one in self.lines if (own := _tip_names(one))]
        if not names:
            return ""
        return (
            f"the shifts of {' and '.join(names)} hold only as far as the tip that was measured with is where tool of "
            "machine.yaml (or of the survey) says: what it is beside that is in them, 1 mm a mm, and in no standard "
            "uncertainty. Readings with the spindle turned by 180 deg tell tool_x and tool_y, a second length tool_z"
        )

    @property
    def apart(self) -> str:
        """What is added where tables are advised against: the description does not depend on them."""
        if not self.asked or not all(x.spread for x in self.lines):
            return ""
        return f". This is said of the tables: for the rotary axes the uncertainties in {DESCRIPTION} count"

    def first(self) -> str:
        """What to do before the tables, or what to ask for."""
        if self.asked:
            tip = f"; {self.of_tip}" if self.of_tip else ""
            without = f", {self.tables_alone_um:.1f} without it" if self.tables_alone_um is not None else ""
            return (
                f"FIRST: put the rotary axes of {DESCRIPTION} into the control's kinematic description (tool centre "
                f"point control on); the tables are for what remains with it{without}{tip}"
            )
        return (
            f"constant errors of the rotary axes are a good part: the control's kinematic description alone leaves "
            f"{self.left_um:.1f} of {self.before_um:.1f} um rms, with any tool; --kinematics writes it, and tables for "
            "what remains"
        )

    def as_json(self) -> dict[str, Any]:
        lines = []
        for one in self.lines:
            std = one.std.tolist() if one.spread else None
            known = {"shift_std": std and std[:3], "tilt_std": std and std[3:]}
            lines.append({k: v for k, v in asdict(one).items() if k != "spread"} | known)
        return asdict(self) | {"lines": lines, "of_tip": self.of_tip or None}

    @property
    def worth(self) -> bool:
        """Whether the description alone takes away a fifth of the error."""
        return self.left_um < WORTH_SHARE * self.before_um


def _tip_names(one: Line) -> list[str]:
    return [name for name in TOOL_COLUMNS if name in one.confounded]


def _uncertainty_lines(one: Line) -> Iterator[str]:
    """How uncertain the place of an axis is, with one digit more than its place has, and what that leaves out."""
    if not one.spread:
        return
    std = one.std
    shift = ", ".join(f"{a} {v:.5f} mm" for a, v in zip("xyz", std[:3], strict=True) if v > 0)
    tilt = ", ".join(f"about {a} {1e6 * v:.2f} urad" for a, v in zip("xyz", std[3:], strict=True) if v > 0)
    if shift or tilt:
        yield f"standard uncertainty: {'; '.join(filter(None, (shift, tilt)))}"
    tip = _tip_names(one)
    if tip:
        yield f"as if the tip were where tool says: by its {', '.join(tip)} it lies elsewhere, 1 mm a mm"
    if others := [name for name in one.confounded if name not in tip]:
        names = ", ".join(others[:MOST_NAMES])
        more = f" and {len(others) - MOST_NAMES} more" if len(others) > MOST_NAMES else ""
        yield f"as if these, which the survey does not tell from it, were zero: {names}{more}"


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
        if found.tilts:
            lines.append(f"{point}; 1000 mm farther")
            lines.append(
                f"    along {way} it is {slope} mm more: where the control's vectors end elsewhere, add that share"
            )
        else:
            lines.append(point)
        lines += [
            part
            for said in _uncertainty_lines(one)
            for part in wrap(said, TEXT_WIDTH, initial_indent=INDENT, subsequent_indent=INDENT)
        ]
    lines += [
        "",
        *(part for part in wrap(found.of_tip, TEXT_WIDTH)),
        *([""] if found.of_tip else []),
        f"error over the volume: {found.before_um:.2f} um rms without, {found.left_um:.2f} with this alone",
        "",
        *(part for step in steps for part in wrap(step, TEXT_WIDTH, subsequent_indent="    ")),
    ]
    return "\n".join(lines) + "\n"


def rotary_axes(
    controller: Target, volume: Volume, setup: Setup, seed: int, asked: bool, fit: StoredFit, allow_large: bool
) -> Kinematics | None:
    """Rotary axes as they lie, and what that is worth; None: there are none, or nothing that describes them.

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
    return Kinematics(lines, before, with_it, asked, tilts)
