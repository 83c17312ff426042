"""Common part of controllers with volumetric compensation: error parameters of ISO 230-1 for each axis.

The tip's error is the sum of the six error motions of every axis (functions of its position) times their levers: the
nominal kinematics from that axis to the tool tip. Only the tip's position is corrected, by the linear axes.

The frame of the file has its origin where the tip stands with all axes at zero, so that the levers of linear axes are
the positions of other axes and nothing else: such a file does not depend on where anybody put the machine's frames. The
levers of rotary axes are counted from their centres, which the file states from that origin.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from errormodel import conventions
from errormodel.arrays import Array
from errormodel.controllers import instead
from errormodel.controllers.axes import in_order
from errormodel.controllers.base import Controller
from errormodel.controllers.setup import Setup
from errormodel.controllers.tables import Term
from errormodel.exceptions import InputError

ISO_MOTIONS = ("EX", "EY", "EZ", "EA", "EB", "EC")  # ISO 230-1: translations along and rotations about X, Y, Z
SHIFTS = ISO_MOTIONS[:3]
STRAIGHT_COSINE = 0.999  # cosine between an axis and x, y or z, from which on it counts as running along it


def parameter(letter: str, axis: str) -> str:
    """Error parameter of an axis, such as EXX or EAY."""
    return f"{letter}{axis}"


KINEMATIC = re.compile(r"P0[XYZ]|[PV][XYZ][ABC]")  # names of such constants


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

    def kinematics(self, setup: Setup) -> dict[str, float]:
        """Constants of the file by which the kernel knows the levers, mm in the controller's axes.

        The tip's zero position (P0X ...), the centre of each rotary axis (PXC ...), and its direction (VXC ...) where
        that is not plus x, y or z.
        """
        out = {f"P0{a}": 0.0 for a in "XYZ"}
        sense = self.senses(setup)
        for name in in_order(self.measured(setup)):
            axis = setup.axis(name)
            if not axis.rotary:
                continue
            out |= {f"P{a}{name}": float(s * c) + 0.0 for a, s, c in zip("XYZ", sense, axis.centre, strict=True)}
            along = sense * axis.along
            if along["ABC".index(name)] < STRAIGHT_COSINE:
                out |= {f"V{a}{name}": float(v) + 0.0 for a, v in zip("XYZ", along, strict=True)}
        return out

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
        if not {*setup.linear} <= {*setup.moving}:
            return [m for m in known if m in SHIFTS]
        # what a rotation does about another point than the file's is a displacement
        return ISO_MOTIONS if any(m not in SHIFTS for m in known) else known

    def influence(self, setup: Setup, output: str, q: Array) -> Array:
        if setup.levers is None:
            raise InputError("setup", "no kinematics", "Give the levers of the machine")
        levers, tip = setup.levers(q)
        axis, number = setup.axis(output[2:]), ISO_MOTIONS.index(output[:2])
        first = 6 * setup.place(output[2:])
        moves = levers[:, :, first + number]
        if number >= 3 and not axis.rotary:  # about the file's origin in place of the axis' own
            moves = moves + levers[:, :, first : first + 3] @ np.cross(np.eye(3)[number - 3], axis.centre)
        movers = [setup.place(m) for m in setup.movers]
        sense = self.senses(setup)[
            ISO_MOTIONS.index(output[:2]) % 3
        ]  # shifts and turns alike: the frame is turned by 180 deg
        return np.asarray(-sense * np.linalg.solve(tip[:, :, movers], moves[:, :, None])[:, :, 0], np.float64)
