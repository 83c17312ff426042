"""Steps of the correction of rotary axes that were measured over a part of their turn.

Beyond the measured part tables hold the correction of its edge. An axis that counts modulo 360 comes from one edge's
value to the other's where it begins a new turn, in a single step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Mask
from errormodel.controllers.setup import FULL_TURN, Axis, Setup
from identification.compensation.assessment import Correct, fresh_rows
from identification.compensation.volume import TURN_SLACK, Volume

LEAST_STEP_MM = 0.001  # where no increment of the control is given: the usual one of a linear axis


@dataclass(frozen=True)
class Seam:
    """Largest step of the tip (um) where a rotary joint begins a new turn, and its measured part and travel, deg."""

    joint: str
    step_um: float
    measured: tuple[float, float]
    travel: tuple[float, float]

    @property
    def where(self) -> str:
        """The angles between which the step lies, with what was measured."""
        (a, b), (low, high) = self.measured, self.travel
        turn = f"{high:g} to {low:g} deg" if abs(high - low - FULL_TURN) < 1e-2 else "the end of a turn to its start"
        return f"{self.joint} goes from {turn} (measured from {a:.1f} to {b:.1f}, beyond it the edge's value is held)"

    def line(self, removed_um: float = np.inf) -> str:
        """What comes first; `removed_um`: rms error that tables take away, of which a larger step is harm."""
        cure = f"Measure {self.joint} all round, or use this only where {self.joint} never passes there"
        step = f"the correction steps by up to {self.step_um:.1f} um where {self.where}"
        if self.step_um > removed_um:
            return f"{step}, more than the {removed_um:.1f} um rms that it takes away. {cure}"
        return f"FIRST: {step}. {cure}"


def seams(volume: Volume, setup: Setup, correct: Correct, seed: int, passed: Mask | None = None) -> tuple[Seam, ...]:
    """Steps above the control's increment of each rotary joint whose travel is a turn, of which a part was measured.

    Parameters
    ----------
    passed : (joints,) which commands pass the step of; None: any may.
    """
    parts = [(k, axis) for k, axis in enumerate(setup.axes) if _part_of_a_turn(axis) and (passed is None or passed[k])]
    if not parts:
        return ()
    rows, field, (low, high) = fresh_rows(volume, seed), volume.field, volume.ends
    out = []
    for k, axis in parts:
        start, end = rows.q.copy(), rows.q.copy()
        start[:, k], end[:, k] = low[k], high[k]
        held = correct(end, rows.direction, None) - end
        here = field.actual(correct(start, rows.direction, None), rows.direction)
        step = 1e3 * float(np.linalg.norm(field.actual(start + held, rows.direction) - here, axis=1).max())
        if step > 1e3 * (setup.resolution or LEAST_STEP_MM):
            out.append(Seam(axis.joint, step, axis.measured, axis.travel))
    return tuple(out)


def _part_of_a_turn(axis: Axis) -> bool:
    span, measured = (b - a for a, b in (axis.travel, axis.measured))
    slack = float(np.degrees(TURN_SLACK))
    return axis.rotary and span > FULL_TURN - slack and 0 < measured < FULL_TURN - slack
