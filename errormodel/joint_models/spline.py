"""Spline: a curve of uniform cubic B-splines over the travel."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from errormodel.conventions import Motion
from errormodel.effects.ops import Value, cubics, fmax, fmin
from errormodel.joint_models.base import JointModel, JointTerm
from errormodel.machine import Joint


class Spline(JointModel):
    """Cubic B-splines of n intervals, zero where q is 0 (or at the travel's end nearest to it).

    The splines sum to one, so that one of them is dependent once each is made zero there; the first is left out.
    Beyond the travel the value at its end is held.
    """

    word: ClassVar[str] = "spline"
    source: ClassVar[str] = "de Boor (1978), A Practical Guide to Splines: uniform cubic B-splines"
    counts: ClassVar[str] = "intervals of the travel"
    example: ClassVar[int] = 8

    @classmethod
    def terms(cls, joint: Joint, motion: Motion, n: int, q: Value) -> Iterator[JointTerm]:
        low, high = joint.travel
        home = min(max(0.0, low), high)
        clamped = fmin(fmax(q, low), high)
        # centred on knot k; k = -1 is the one left out
        values, at_home = (cubics((x - low) / (high - low) * n, 0, n + 2) for x in (clamped, home))
        for k, (value, zero) in enumerate(zip(values, at_home, strict=True)):
            yield JointTerm(f"s{k + 1}", {motion: value - zero})

    @classmethod
    def order(cls, joint: Joint, n: int) -> int:
        """A curve of n intervals has as many parameters as a polynomial of degree n + 2; only what is finer is new."""
        return n + 3 if joint.type == "prismatic" else 0
