"""Harmonic: sines and cosines of a turn."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

from errormodel.conventions import Motion
from errormodel.effects.ops import Value, cos, sin
from errormodel.joint_models.base import JointModel, JointTerm
from errormodel.machine import Joint


class Harmonic(JointModel):
    """``sin(k q)`` and ``cos(k q) - 1`` for k from 1 to n: zero where q is 0, and the same after a turn."""

    word: ClassVar[str] = "harmonic"
    source: ClassVar[str] = "ISO 230-7 axis of rotation error motions as a Fourier series"
    counts: ClassVar[str] = "harmonics of a turn"
    example: ClassVar[int] = 2
    joints: ClassVar[tuple[Literal["prismatic", "rotary"], ...]] = ("rotary",)

    @classmethod
    def terms(cls, joint: Joint, motion: Motion, n: int, q: Value) -> Iterator[JointTerm]:
        for k in range(1, n + 1):
            yield JointTerm(f"sin{k}", {motion: sin(k * q)})
            yield JointTerm(f"cos{k}", {motion: cos(k * q) - 1})

    @classmethod
    def order(cls, joint: Joint, n: int) -> int:
        return n
