"""Rotary axes as they lie, in words: ``kinematics.txt``, and what is said of it before tables are loaded."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from textwrap import wrap
from typing import Any

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.rotary_lines import Line
from errormodel.surveys.columns import TOOL_COLUMNS
from identification.compensation.conditions import state_words

DESCRIPTION = "kinematics.txt"
TEXT_WIDTH = 110  # characters of a line
INDENT = "    "  # of what is said of one axis
WORTH_SHARE = 0.8  # of the rms error that may be left for the description to be mentioned; by judgement
MOST_NAMES, MOST_STATES = 6, 4  # of parameters in a line, and of other states of the machine in a sentence
ANGLE_SCALE = 1000.0  # mm per rad, which makes shifts and tilts alike in size; by judgement


@dataclass(frozen=True)
class Elsewhere:
    """Another state of the machine: errors there, um rms, without the description and with it.

    `lines`: the axes as they lie there.
    """

    state: Mapping[str, float]
    lines: tuple[Line, ...]
    before_um: float
    left_um: float

    @property
    def alone(self) -> str:
        return f"at {state_words(self.state)} {self.before_um:.2f} without, {self.left_um:.2f} with it"


@dataclass(frozen=True)
class Kinematics:
    """Rotary axes as they lie, and what that is worth: rms errors over the volume, um, with it and without."""

    lines: tuple[Line, ...]
    before_um: float
    left_um: float
    asked: bool  # whether the tables are for what remains with it
    tilts: bool = True  # whether it says how the axes are tilted
    tables_alone_um: float | None = None  # what such tables leave without it; None: not asked
    state: Mapping[str, float] = field(default_factory=dict)  # for which all of it holds; empty: for any
    others: tuple[Elsewhere, ...] = ()

    @property
    def when(self) -> str:
        """The state for which it holds, with a space before it; or empty."""
        return f" at {state_words(self.state)}" if self.state else ""

    @property
    def of_state(self) -> str:
        """For which state the place of the axes holds, and how far from it they lie in others; or empty."""
        return self._of_state(self.others)

    def _of_state(self, others: Sequence[Elsewhere]) -> str:
        if not self.state:
            return ""
        moved = "; ".join(f"at {state_words(one.state)} {self._moved(one)}" for one in others)
        steady = " in the steady state" if any(name.startswith("T_") for name in self.state) else ""
        return f"the axes lie as written{steady}{self.when}{f'; {moved}' if moved else ''}"

    def _moved(self, other: Elsewhere) -> str:
        """Which axes lie elsewhere than described in another state, and by how much."""
        words = []
        for axis, shift, tilt in self._changes(other):
            if said := ", ".join(filter(None, (_shift_words(shift), _tilt_words(tilt)))):
                words.append(f"{axis} lies elsewhere by {said}")
        return " and ".join(words) or "likewise"

    def _farthest(self) -> list[Elsewhere]:
        """The other states, in their order; of many those in which the axes lie farthest from their described place."""

        def far(other: Elsewhere) -> float:
            ways = (np.concatenate([shift, ANGLE_SCALE * tilt]) for _, shift, tilt in self._changes(other))
            return float(np.linalg.norm(np.concatenate([*ways])))

        most = sorted(self.others, key=far)[-MOST_STATES:]
        return [one for one in self.others if one in most]

    def _changes(self, other: Elsewhere) -> Iterator[tuple[str, Array, Array]]:
        """Axis, shift (mm) and tilt (rad) by which each axis lies beside its described place in another state."""
        for here, there in zip(self.lines, other.lines, strict=True):
            yield here.axis, np.subtract(there.shift, here.shift), np.subtract(there.tilt, here.tilt)

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
            alone = f", {self.tables_alone_um:.1f} um rms{self.when} without it"
            without = alone if self.tables_alone_um is not None else ""
            state = f"; {self._of_state(self._farthest())}" if self.state else ""
            return (
                f"FIRST: put the rotary axes of {DESCRIPTION} into the control's kinematic description (tool centre "
                f"point control on); the tables are for what remains with it{without}{state}{tip}"
            )
        others = "".join(
            f", {one.left_um:.1f} of {one.before_um:.1f} at {state_words(one.state)}" for one in self.others
        )
        return (
            f"constant errors of the rotary axes are a good part: the control's kinematic description alone leaves "
            f"{self.left_um:.1f} of {self.before_um:.1f} um rms{self.when}{others}, with any tool; --kinematics writes "
            "it, and tables for what remains"
        )

    def as_json(self) -> dict[str, Any]:
        lines = []
        for one in self.lines:
            std = one.std.tolist() if one.spread else None
            known = {"shift_std": std and std[:3], "tilt_std": std and std[3:]}
            lines.append({k: v for k, v in asdict(one).items() if k != "spread"} | known)
        others = [
            {
                "state": dict(one.state),
                "before_um": one.before_um,
                "left_um": one.left_um,
                "moved": {a: {"shift": s.tolist(), "tilt": t.tolist()} for a, s, t in self._changes(one)},
            }
            for one in self.others
        ]
        said = {"of_tip": self.of_tip or None, "of_state": self.of_state or None}
        return asdict(self) | {"lines": lines, "state": dict(self.state), "others": others} | said

    @property
    def worth(self) -> bool:
        """Whether the description alone takes away a fifth of the error."""
        return self.left_um < WORTH_SHARE * self.before_um


def _tip_names(one: Line) -> list[str]:
    return [name for name in TOOL_COLUMNS if name in one.confounded]


def _shift_words(shift: Sequence[float] | Array) -> str:
    return ", ".join(f"{a} {v:+.4f} mm" for a, v in zip("xyz", shift, strict=True) if abs(v) > 5e-5)


def _tilt_words(tilt: Sequence[float] | Array) -> str:
    return ", ".join(f"about {a} {1e6 * v:+.1f} urad" for a, v in zip("xyz", tilt, strict=True) if abs(v) > 5e-8)


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
        *([f"They hold{found.when}."] if found.state else []),
        "",
    ]
    for one in found.lines:
        shift = _shift_words(one.shift)
        tilt = f"tilt {_tilt_words(one.tilt) or 'none'}" if found.tilts else "tilt not described"
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
        *(part for part in wrap(found.of_state, TEXT_WIDTH)),
        *([""] if found.of_state else []),
        f"error over the volume{found.when}: {found.before_um:.2f} um rms without, {found.left_um:.2f} with this alone",
        *(f"    {one.alone}" for one in found.others),
        "",
        *(part for step in steps for part in wrap(step, TEXT_WIDTH, subsequent_indent="    ")),
    ]
    return "\n".join(lines) + "\n"
