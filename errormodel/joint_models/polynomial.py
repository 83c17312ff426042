"""Polynomial: powers of the position over the larger end of the travel."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from errormodel.conventions import Motion
from errormodel.effects.ops import Value
from errormodel.joint_models.base import JointModel, JointTerm
from errormodel.machine import Joint

USUAL = 8  # guides need up to five


class Polynomial(JointModel):
    """Powers 1 to n of ``q / max(abs(travel))``: zero where q is 0, since constants belong to the shapes."""

    word: ClassVar[str] = "polynomial"
    source: ClassVar[str] = "ISO 230-1 error motions of a guide as a truncated power series"
    counts: ClassVar[str] = "powers of the position"

    @classmethod
    def terms(cls, joint: Joint, motion: Motion, n: int, q: Value) -> Iterator[JointTerm]:
        u = q / max(abs(t) for t in joint.travel)
        for k in range(1, n + 1):
            yield JointTerm(str(k), {motion: u**k})

    @classmethod
    def order(cls, joint: Joint, n: int) -> int:
        return n if joint.type == "prismatic" else 0

    @classmethod
    def doubt(cls, n: int, motion: Motion) -> str:
        if n <= USUAL:
            return ""
        return (
            f"{cls.word}: {n} for {motion} wants positions at {n + 1} or more places of the travel and swings between "
            "them; guides seldom need more than 5, waves want {spline: n}"
        )
