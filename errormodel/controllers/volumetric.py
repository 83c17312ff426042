"""Common part of controllers with volumetric compensation: error parameters of ISO 230-1 for each axis.

The tip's error is the sum of the six error motions of every axis (functions of its position) times their levers: the
nominal kinematics from that axis to the tool tip. Only the tip's position is corrected, by the linear axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from errormodel import conventions
from errormodel.arrays import Array
from errormodel.controllers import instead
from errormodel.controllers.base import Controller
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Term
from errormodel.exceptions import InputError

ISO_MOTIONS = ("EX", "EY", "EZ", "EA", "EB", "EC")  # ISO 230-1: translations along and rotations about X, Y, Z
STRAIGHT_COSINE = 0.999  # cosine between an axis and x, y or z, from which on it counts as running along it


def parameter(letter: str, axis: str) -> str:
    """Error parameter of an axis, such as EXX or EAY."""
    return f"{letter}{axis}"


class Volumetric(Controller):
    """Error parameters in place of corrections."""

    bidirectional: ClassVar[bool] = False

    def suits(self, setup: Setup) -> None:
        super().suits(setup)
        linear = [setup.axis(m) for m in setup.movers if not setup.axis(m).rotary]
        if [a.name for a in sorted(linear, key=lambda a: a.name)] != ["X", "Y", "Z"]:
            raise InputError(
                f"--controller {self.name}",
                f"corrections by {', '.join(setup.movers)}; the kernel wants three linear axes X, Y and Z",
                f"Use --controller {instead()}",
            )
        self.senses(setup)

    def senses(self, setup: Setup) -> Array:
        """Directions of X, Y and Z of the controller along x, y, z of the reference, +-1 (3,)."""
        along = np.array([setup.axis(name).along[k] for k, name in enumerate("XYZ")])
        if np.abs(along).min() < STRAIGHT_COSINE:
            name = "XYZ"[int(np.argmin(np.abs(along)))]
            found = f"{name} runs along {', '.join(f'{v:.3g}' for v in setup.axis(name).along)}"
            raise InputError(f"--controller {self.name}", found, "The kernel wants X, Y, Z along x, y, z")
        if np.prod(np.sign(along)) < 0:
            found = "X, Y and Z form a left-handed frame, and errors are counted in a right-handed one"
            raise InputError(
                f"--controller {self.name}", found, "Turn the sign of one of them in machine.yaml and survey"
            )
        return np.asarray(np.sign(along), np.float64)

    def measured(self, setup: Setup) -> tuple[str, ...]:
        """Axes with error parameters in the file; of two parallel ones the kernel has one."""
        return tuple(a for a in setup.moving if a in "XYZABC")

    def terms(self, setup: Setup) -> list[Term]:
        return [
            Term(parameter(m, a), (a,), (setup.grid(a, self.most_points),))
            for a in self.measured(setup)
            for m in self.motions(setup, a)
        ]

    def moved(self, output: str) -> str:
        return output[1] if output[1] in "XYZ" else ""

    def motions(self, setup: Setup, axis: str) -> Sequence[str]:
        """Error parameters of an axis; of single-joint error motions, the measured ones.

        Unless all linear axes moved, the levers are constant and a rotation cannot be separated from the displacement
        that it causes: as a parameter of its own it would act with other levers elsewhere.
        """
        if setup.read is None:
            return ISO_MOTIONS
        known = [
            m for m, name in zip(ISO_MOTIONS, conventions.MOTIONS, strict=True) if name in setup.read.get(axis, ())
        ]
        return known if {*setup.linear} <= {*setup.moving} else [m for m in known if m in ISO_MOTIONS[:3]]

    def influence(self, setup: Setup, output: str, q: Array) -> Array:
        if setup.levers is None:
            raise InputError("setup", "no kinematics", "Give the levers of the machine")
        levers, tip = setup.levers(q)
        column = 6 * setup.place(output[2:]) + ISO_MOTIONS.index(output[:2])
        movers = [setup.place(m) for m in setup.movers]
        sense = self.senses(setup)[
            ISO_MOTIONS.index(output[:2]) % 3
        ]  # shifts and turns alike: the frame is turned by 180 deg
        return np.asarray(
            -sense * np.linalg.solve(tip[:, :, movers], levers[:, :, column : column + 1])[:, :, 0], np.float64
        )
