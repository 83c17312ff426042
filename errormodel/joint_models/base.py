"""What a joint error model is: the motions that a joint makes, per unit of each parameter, over its position.

A model is a class without instances: ``machine.yaml`` says which one an error motion has, and for most a number. Its
parameters are linear. The position ``q`` is in mm or rad; the motion of one parameter is ``(d, e)``, six components.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from errormodel.conventions import MOTIONS, Motion
from errormodel.effects.ops import Value
from errormodel.machine import Basis, Joint


@dataclass(frozen=True)
class JointTerm:
    """One linear parameter of a joint error model.

    Attributes
    ----------
    label : distinguishes the parameters of one error motion, such as ``sin2``.
    motion : what the joint does per unit of the parameter, mm and rad.
    unit : of the parameter; empty: that of the error motion, mm or rad.
    """

    label: str
    motion: Mapping[Motion, Value]
    unit: str = ""


class JointModel(ABC):
    """Base of the joint error models. A new one is one class in one file of this package; it is found by itself.

    Attributes
    ----------
    word : its name in ``errors.joints`` of ``machine.yaml``.
    source : where its form comes from.
    counts : what its number n counts, such as "powers of the position"; empty: it has no number.
    example : a usual number, for messages.
    joints : types of joint that may have it.
    """

    word: ClassVar[str]
    source: ClassVar[str]
    counts: ClassVar[str] = ""
    example: ClassVar[int] = 3
    joints: ClassVar[tuple[Literal["prismatic", "rotary"], ...]] = ("prismatic", "rotary")

    @classmethod
    @abstractmethod
    def terms(cls, joint: Joint, motion: Motion, n: int, q: Value) -> Iterator[JointTerm]:
        """Parameters of one error motion, by rising order.

        Parameters
        ----------
        n : the model's number; 1 where it has none, at most 50.
        q : position of the joint, mm or rad: a symbol, or an array of one value a row. Write functions of it with
            :mod:`errormodel.effects.ops`, which takes both.
        """

    @classmethod
    def motions(cls, joint: Joint) -> tuple[Motion, ...]:
        """Error motions of the joint that can have this model."""
        return MOTIONS

    @classmethod
    def refused(cls, joint: Joint, motion: Motion) -> tuple[str, str]:
        """What is wrong with a motion that is none of :meth:`motions`, and what to write in its place."""
        return f"{cls.word} for {motion} of {joint.name}", f"It can have: {', '.join(cls.motions(joint))}"

    @classmethod
    def order(cls, joint: Joint, n: int) -> int:
        """Highest polynomial degree (prismatic) or harmonic (rotary) of the position that the model follows.

        The diagnosis looks for higher-order geometry from the next one on. 0: it follows none.
        """
        return 0

    @classmethod
    def has_slope(cls, joint: Joint, motion: Motion) -> bool:
        """Whether parameters of a motion across a prismatic joint take up a straight line, which is a squareness."""
        return cls.order(joint, 1) > 0

    @classmethod
    def rotation_alone(cls, joint: Joint, n: int) -> Basis:
        """The model of a rotation as an instrument at the joint reads it, without what the rotation makes of the path.

        A model whose rotations move nothing else is its own.
        """
        return Basis(cls.word, n)

    @classmethod
    def doubt(cls, n: int, motion: Motion) -> str:
        """What is hardly meant in a number that is allowed; empty: nothing."""
        return ""
