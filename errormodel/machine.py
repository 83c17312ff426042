"""Immutable machine model: the kinematic chain with its error models and effects, in mm and rad.

`errormodel.machine_file` reads and writes its file form (``machine.yaml``, any units and short forms).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from errormodel.conventions import Motion
from errormodel.exceptions import InputError, nearest

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Basis:
    """Functional form of one error motion of a joint over its position (``docs/file_formats.md``, section 1)."""

    kind: str  # the word of a model of `errormodel.joint_models`
    n: int = 1


@dataclass(frozen=True)
class Shape:
    """Structural member ``Trans(offset + d) Rot(e) Rot(rotation)`` with constant errors d (mm) and e (rad).

    The errors, like the offset, are in the axes of the workpiece-side frame.
    """

    name: str
    offset: Vector = (0.0, 0.0, 0.0)  # mm
    rotation: Vector = (0.0, 0.0, 0.0)  # rad, about x, then y, then z of the turned frame
    motions: tuple[Motion, ...] = ()  # the error motions that are parameters


@dataclass(frozen=True)
class Joint:
    """Prismatic joint ``Trans(q axis + d(q)) Rot(e(q))``, or rotary joint ``Trans(d) Rot(e) Rot(axis, q)``."""

    name: str
    type: Literal["prismatic", "rotary"]
    axis: Vector  # unit vector in the joint's frame
    travel: tuple[float, float]  # mm or rad
    models: Mapping[Motion, Basis] = field(default_factory=dict)
    drives: tuple[str, ...] = ()  # survey columns of its two drives, if it has two; their mean is its position
    spacing: float | None = None  # mm, between the two drives

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of a survey that may hold the joint's position."""
        return (self.name, *self.drives)

    @property
    def difference(self) -> str:
        """Channel of the difference of the drives, first minus second, mm."""
        return f"w_sync_{self.name}"


@dataclass(frozen=True)
class EffectSpec:
    """One entry of ``effects:`` as written: the effect's name and its other keys."""

    effect: str
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Machine:
    """Kinematic chain from the workpiece (or the reference on the table) to the tool."""

    name: str
    elements: tuple[Shape | Joint, ...]
    tool: Vector = (0.0, 0.0, 0.0)  # functional point in the last frame, mm
    effects: tuple[EffectSpec, ...] = ()
    source: Path | None = None
    notes: str = ""  # origin of the dimensions
    inches: bool = field(default=False, compare=False)  # whether its file counted lengths in inches
    doubts: tuple[str, ...] = field(default=(), compare=False)  # warnings about implausible entries of its file

    @property
    def joints(self) -> tuple[Joint, ...]:
        return tuple(e for e in self.elements if isinstance(e, Joint))

    @property
    def shapes(self) -> tuple[Shape, ...]:
        return tuple(e for e in self.elements if isinstance(e, Shape))


def joint_of(machine: Machine, name: str) -> Joint:
    """Return the joint of that name.

    Raises
    ------
    InputError
        The machine has no such joint.
    """
    for joint in machine.joints:
        if joint.name == name:
            return joint
    raise InputError(
        f"joint {name}", "the machine has no joint of this name", nearest(name, [j.name for j in machine.joints])
    )
