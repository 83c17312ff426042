"""First order: a scale and three angular rates of a prismatic joint, half a turn's sine of a rotary one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from errormodel.conventions import MOTIONS, ROTATIONS, TRANSLATIONS, Motion, iso_symbol
from errormodel.effects.base import along, axis_motion
from errormodel.effects.ops import Value, sin
from errormodel.joint_models.base import JointModel, JointTerm
from errormodel.joint_models.polynomial import Polynomial
from errormodel.machine import Basis, Joint


class FirstOrder(JointModel):
    """Prismatic: ``q`` along the axis, and angles that grow as ``q`` with the straightness ``q²/2`` that they make.

    The scale acts along the axis, whatever its direction; the parameters' units are 1 and rad/mm. Rotary: all six
    motions as ``sin(q/2)``.
    """

    word: ClassVar[str] = "first-order"
    source: ClassVar[str] = "Ferreira & Liu (1986), as in Eqs. 4 and 5 of the five-axis paper"

    @classmethod
    def terms(cls, joint: Joint, motion: Motion, n: int, q: Value) -> Iterator[JointTerm]:
        if joint.type == "rotary":
            yield JointTerm("1", {motion: sin(q / 2)})
        elif motion in TRANSLATIONS:
            yield JointTerm("1", along(joint, q), "1")
        else:  # an angle growing as q bends the path: straightness is the integral of (e x axis), q^2/2
            turn = [float(m == motion) for m in ROTATIONS]
            bend = zip(TRANSLATIONS, np.cross(turn, joint.axis).tolist(), strict=True)
            yield JointTerm("1", {motion: q, **{name: q**2 / 2 * a for name, a in bend if a}}, "rad/mm")

    @classmethod
    def motions(cls, joint: Joint) -> tuple[Motion, ...]:
        """All six of a rotary joint; of a prismatic one the scale and the three angular rates."""
        return MOTIONS if joint.type == "rotary" else (axis_motion(joint), *ROTATIONS)

    @classmethod
    def refused(cls, joint: Joint, motion: Motion) -> tuple[str, str]:
        scale = iso_symbol(joint.name, axis_motion(joint))
        other = f"{{{Polynomial.word}: 2}}"
        cure = f"Remove it: straightness comes with the angular rates; or write {other}. The scale is {scale}"
        return f"{cls.word} for {motion}, a straightness of {joint.name}", cure

    @classmethod
    def order(cls, joint: Joint, n: int) -> int:
        return 1 if joint.type == "prismatic" else 0

    @classmethod
    def has_slope(cls, joint: Joint, motion: Motion) -> bool:
        """Never: the straightness of an angular rate is level where the joint is at zero."""
        return False

    @classmethod
    def rotation_alone(cls, joint: Joint, n: int) -> Basis:
        """Of a prismatic joint a straight line: the rate without its straightness."""
        return Basis(Polynomial.word, 1) if joint.type == "prismatic" else Basis(cls.word)
