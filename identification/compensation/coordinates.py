"""What a compensation does to the machine's coordinates as a whole: a small turn and shift, which no figure contains.

Figures are after the rigid frame that fits best. Whoever keeps the frame of the machine without tables, since fixtures
and bed were aligned before, has that motion in every workpiece.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from errormodel.arrays import Array
from errormodel.machine import Vector
from identification.compensation.assessment import Correct, fresh_rows, nothing
from identification.compensation.sample import framed
from identification.compensation.volume import Volume, best_frame
from identification.observation.pose import IDENTITY

# of the residual RMS, and of that without tables, by which it grows without a step that is then asked for; by judgement
REPORTED_SHARE, REPORTED_OF_BEFORE = 0.05, 0.01
NOT_PLACED = (
    ", where the bed and zero had been aligned with the machine as it was: where it stands in axes of its own (an arm "
    "in its base) the survey does not show, as its frame is free, and that is in none of these figures"
)


@dataclass(frozen=True)
class Coordinates:
    """Rigid motion of the places that commands lead to, over the measured volume, and residual RMS errors in um.

    Attributes
    ----------
    turn_urad : about x, y, z of the reference of ``machine.yaml``, right-handed.
    shift_mm : of the middle of the volume, `at_mm`, along x, y, z.
    before_um, left_um : without and with the compensation, each in its best frame.
    unaligned_um : where zero is set anew and the directions stay those of the machine without compensation.
    untouched_um : where zero stays, too.
    kept : whether the tables are those for whoever does not align again (``--keep-alignment``).
    kept_um : what these would leave where zero is set anew; None: not computed.
    reference : place that errors count from and that the tables leave as it is; empty: there is none.
    placed : whether the survey shows where the machine stands (``frame: fixed``); errors are then of that place, too.
    """

    turn_urad: Vector
    shift_mm: Vector
    at_mm: Vector
    before_um: float
    left_um: float
    unaligned_um: float
    untouched_um: float
    kept: bool = False
    kept_um: float | None = None
    reference: str = ""
    placed: bool = True

    @classmethod
    def of(cls, volume: Volume, correct: Correct, seed: int, kept: bool = False) -> Coordinates:
        """Compare the actual positions of commands with and without a compensation."""
        from scipy.spatial.transform import Rotation

        rows, field = fresh_rows(volume, seed), volume.field
        nominal = field.nominal(rows.q, rows.tool)
        plain, moved = (
            field.actual(c(rows.q, rows.direction, rows.tool), rows.direction, rows.tool) for c in (nothing, correct)
        )
        motion, middle = best_frame(moved - plain, nominal, volume.turns), nominal.mean(axis=0)
        free = volume.free and volume.pose is None
        frame = best_frame(plain - nominal, nominal, volume.turns) if free else volume.pose or IDENTITY
        wanted = frame.apply(nominal)
        own = best_frame(moved - nominal, nominal, volume.turns) if free else frame
        shifts = np.tile(np.eye(3), (len(rows), 1, 1)) if free else np.zeros((len(rows), 3, 0))
        return cls(
            _three(1e6 * Rotation.from_matrix(motion.rotation).as_rotvec()),
            _three(motion.apply(middle[None])[0] - middle),
            _three(middle),
            _rms(plain - wanted),
            _rms(moved - own.apply(nominal)),
            _rms(framed(moved - wanted, shifts)),
            _rms(moved - wanted),
            kept,
            reference="" if volume.origin is None else volume.reference,
            placed=not volume.free,
        )

    def line(self, tables: bool = True) -> str:
        """The motion, what is asked for because of it, and what is left without that."""
        what = "tables" if tables else "commands"
        if self.reference:
            return (
                f"single joints are read from zeros of their own: errors count from {self.reference}, and these {what} "
                "leave the machine where it stands there. A zero that was set there stays"
            )
        turn, shift = (
            " ".join(f"{round(v, n) + 0.0:+.{n}f}" for v in vector)
            for vector, n in ((self.turn_urad, 1), (self.shift_mm, 4))
        )
        at = " ".join(f"{axis}={v:.0f}" for axis, v in zip("xyz", self.at_mm, strict=True))
        said = (
            f"these {what} turn the machine's coordinates by {turn} urad about x, y, z "
            f"and move them by {shift} mm (at {at})"
        )
        done, undone = self._steps()
        if not done:
            return f"{said}{undone}"
        harm = ", or do not use them" if not self.kept and self.unaligned_um > self.before_um else ""
        return f"FIRST: {done} once they act{harm}: {said}{undone}"

    def _steps(self) -> tuple[str, str]:
        """What is to be done again once the compensation acts, and what is left without; empty: nothing of effect."""
        before = f"({self.before_um:.1f} without them)"
        untouched = f"{self.untouched_um:.1f} where {{}} {before}"
        placed = "" if self.placed else NOT_PLACED
        if self.must_align:
            undone = f". {self.left_um:.1f} um rms are left then, {self.unaligned_um:.1f} where only zero is set, "
            undone += untouched.format("neither is done") + placed
            if self.kept_um is not None:
                undone += f". --keep-alignment writes tables for whoever only sets zero: they leave {self.kept_um:.1f}"
            return "set zero again and align again (level the bed or table; fixtures, probes)", undone
        left = self.unaligned_um if self.kept else self.left_um
        undone = f". {left:.1f} um rms are left" + (" where nothing is aligned again" if self.kept else "")
        if self.untouched_um > self._most:
            return "set zero again", f"{undone} then, {untouched.format('it is not')}{placed}"
        return "", f"{undone} {before}" if self.kept else ""

    @property
    def must_align(self) -> bool:
        """Whether the turn matters against what is left."""
        return not self.kept and self.unaligned_um > self._most

    @property
    def _most(self) -> float:
        left = self.unaligned_um if self.kept else self.left_um
        return (1 + REPORTED_SHARE) * left + REPORTED_OF_BEFORE * self.before_um

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def _rms(errors: Array) -> float:
    return 1e3 * float(np.sqrt(np.mean(np.sum(np.square(errors), axis=1))))


def _three(v: Array) -> Vector:
    x, y, z = (float(x) for x in v)
    return x, y, z
