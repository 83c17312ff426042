"""Location errors of axes (squareness, parallelism): which there are, their symbols and signs.

Between two axes along principal directions. The line of a linear joint is the least-squares line of the trajectory of
the functional point (ISO 230-1, reference straight line), and so depends on where the other joints stand; that of a
rotary joint is its axis average line (ISO 230-7). Symbols as in ISO 230-1:2012 and ISO 230-7:2015, with the reference
axis in brackets: EC(0X)Y is the rotation about +z of the line of Y relative to X. A rotary axis has also the older
symbol of ISO 230-7:2006, such as AOC. Positions of rotary axes (XOC ...) need a reference that a chain does not define,
and are omitted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from errormodel.arrays import Array, rotation_matrix
from errormodel.machine import Joint, Machine, Shape

# least cosine of the angle between an axis and its principal direction; axes farther off have no location errors
ALIGNED_COSINE = 0.999
LINE_TARGETS = 21  # of a line through a model, in equal steps: enough for curves that polynomials describe
ROTATION_LETTERS = "ABC"  # rotations about x, y and z in ISO 230-1 symbols


@dataclass(frozen=True)
class Axis:
    """A joint along a principal direction, all joints at zero: the direction (3,), with its sign."""

    joint: Joint
    direction: tuple[float, float, float]

    @property
    def k(self) -> int:
        return int(np.argmax(np.abs(self.direction)))


@dataclass(frozen=True)
class LocationError:
    """A location error of two axes.

    Attributes
    ----------
    symbol, words : symbol and name, such as ``EC(0X)Y`` and ``squareness of Y against X``.
    reference, line : the axes, of which the location of `line` is relative to `reference`.
    about : 0 to 2, the principal direction that it is a rotation about.
    """

    symbol: str
    words: str
    reference: Axis
    line: Axis
    about: int


def location_of(machine: Machine) -> list[LocationError]:
    """All squareness and parallelism errors of a machine with prismatic joints, each pair of axes in both orders."""
    axes = list(_axes(machine)) if any(j.type == "prismatic" for j in machine.joints) else []
    return [error for a, b in permutations(axes, 2) for error in _between(a, b)]


def one_of_each_pair(errors: list[LocationError]) -> list[LocationError]:
    """The location errors without those of opposite sign: linear axes are the reference, then the first by name."""

    def order(joint: Joint) -> tuple[bool, str]:
        return joint.type == "rotary", joint.name

    return [e for e in errors if order(e.reference.joint) < order(e.line.joint)]


def rotation_of_line(about: Array, direction: Array, slopes: Array) -> Array:
    """Rotation (...) about a unit vector of a line along `direction` whose deviations have `slopes` (..., 3), rad."""
    return np.asarray(slopes @ np.cross(about, direction))


def squareness(one: str, other: str) -> str:
    """Name of the squareness of two axes."""
    return f"squareness of {one} against {other}"


def _between(reference: Axis, line: Axis) -> Iterator[LocationError]:
    """Rotations of a line relative to a reference line, about each principal direction perpendicular to both."""
    kind = "parallelism" if reference.k == line.k else "squareness"
    first, second = reference.joint, line.joint
    for k in (k for k in range(3) if k not in (reference.k, line.k)):
        if kind == "parallelism":
            words = f"parallelism of {_spoken(second)} to {_spoken(first)} about {'xyz'[k]}"
        else:
            words = squareness(_spoken(second), _spoken(first))
        if second.type == "rotary" and first.type == "prismatic":
            words += f" ({ROTATION_LETTERS[k]}O{second.name})"
        if first.type == "rotary" and second.type == "prismatic":
            words += f" (-{ROTATION_LETTERS[k]}O{first.name})"
        yield LocationError(f"E{ROTATION_LETTERS[k]}(0{first.name}){second.name}", words, reference, line, k)


def _spoken(joint: Joint) -> str:
    return f"the axis of {joint.name}" if joint.type == "rotary" else joint.name


def _axes(machine: Machine) -> Iterator[Axis]:
    """The joints along principal directions, in the order of the chain."""
    turn = np.eye(3)  # rotation from the element's axes to those of the workpiece
    for element in machine.elements:
        if isinstance(element, Shape):
            turn = turn @ rotation_matrix(element.rotation)
            continue
        axis = turn @ np.array(element.axis)
        k = int(np.argmax(np.abs(axis)))
        if abs(axis[k]) >= ALIGNED_COSINE:
            x, y, z = np.sign(axis[k]) * np.eye(3)[k]
            yield Axis(element, (x, y, z))
