"""Location errors of axes (squareness, parallelism) as linear combinations of the error parameters.

Between two axes along principal directions, at the zero of all joints; rad. The line of a linear joint is the path of
the functional point, which the joint's own straightness and rotations tilt by their slopes. Symbols as in ISO
230-1:2012 and ISO 230-7:2015, with the reference axis in brackets: EC(0X)Y is the rotation about +z of the line of Y
relative to X. A rotary axis has also the older symbol of ISO 230-7:2006, such as AOC. Positions of rotary axes
(XOC ...) need a reference that a chain does not define, and are omitted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import permutations

import casadi as ca
import numpy as np

from errormodel.arrays import Array, rotation_matrix
from errormodel.chain_terms import joint_terms
from errormodel.conventions import ROTATIONS, TRANSLATIONS
from errormodel.machine import Joint, Machine, Shape

# least cosine of the angle between an axis and its principal direction; axes farther off have no location errors
ALIGNED_COSINE = 0.999
SMALLEST_COEFFICIENT = 1e-12  # coefficients below this are rounding errors
COEFFICIENT_TOLERANCE = 1e-5  # relative tolerance of two equal coefficients, because printed groups have six digits
ROTATION_LETTERS = "ABC"  # rotations about x, y and z in ISO 230-1 symbols


@dataclass(frozen=True)
class LocationError:
    """A location error of two axes.

    Attributes
    ----------
    symbol, words : symbol and name, such as ``EC(0X)Y`` and ``squareness of Y against X``.
    members : rad per unit of each parameter, at the zero of the joints.
    free : parameters whose coefficient depends on the point whose path is taken.
    """

    symbol: str
    words: str
    members: Mapping[str, float]
    free: frozenset[str]

    def is_group(self, members: Mapping[str, float]) -> bool:
        """Whether a group ``{id: coefficient}`` is this location error."""
        ids = (self.members.keys() | members.keys()) - self.free
        pairs = [(self.members.get(i, 0.0), members.get(i, 0.0)) for i in ids]
        return any(a for a, _ in pairs) and all(
            abs(a - b) <= COEFFICIENT_TOLERANCE * max(abs(a), abs(b)) for a, b in pairs
        )


@dataclass(frozen=True)
class _Line:
    """An axis at the zero of the joints: principal direction `k`, and tilt (3,) in rad per unit of each parameter."""

    joint: Joint
    k: int
    tilts: Mapping[str, Array]
    free: frozenset[str]


def location_of(machine: Machine) -> list[LocationError]:
    """All squareness and parallelism errors of a machine with prismatic joints, each pair of axes in both orders."""
    lines = list(_lines(machine)) if any(j.type == "prismatic" for j in machine.joints) else []
    return [error for a, b in permutations(lines, 2) for error in _between(a, b)]


def named(errors: list[LocationError], members: Mapping[str, float]) -> LocationError | None:
    """Location error that a group ``{id: coefficient}`` represents, or None."""
    return next((e for e in errors if e.is_group(members)), None)


def _between(reference: _Line, line: _Line) -> Iterator[LocationError]:
    """Rotations of a line relative to a reference line, about each principal direction perpendicular to both."""
    about = [k for k in range(3) if k not in (reference.k, line.k)]
    kind = "parallelism" if reference.k == line.k else "squareness"
    first, second = reference.joint, line.joint
    ids = dict.fromkeys([*line.tilts, *reference.tilts])
    zero = np.zeros(3)
    for k in about:
        members = {i: float(line.tilts.get(i, zero)[k] - reference.tilts.get(i, zero)[k]) for i in ids}
        members = {i: v for i, v in members.items() if abs(v) > SMALLEST_COEFFICIENT}
        if kind == "parallelism":
            words = f"parallelism of {_spoken(second)} to {_spoken(first)} about {'xyz'[k]}"
        else:
            words = squareness(_spoken(second), _spoken(first))
        if second.type == "rotary" and first.type == "prismatic":
            words += f" ({ROTATION_LETTERS[k]}O{second.name})"
        if first.type == "rotary" and second.type == "prismatic":
            words += f" (-{ROTATION_LETTERS[k]}O{first.name})"
        yield LocationError(
            f"E{ROTATION_LETTERS[k]}(0{first.name}){second.name}", words, members, reference.free | line.free
        )


def squareness(one: str, other: str) -> str:
    """Name of the squareness of two axes."""
    return f"squareness of {one} against {other}"


def _spoken(joint: Joint) -> str:
    return f"the axis of {joint.name}" if joint.type == "rotary" else joint.name


def _lines(machine: Machine) -> Iterator[_Line]:
    """Each joint's axis, in the order of the chain."""
    turn = np.eye(3)  # rotation from the element's axes to those of the workpiece
    before: dict[str, Array] = {}
    for element in machine.elements:
        if isinstance(element, Shape):
            for motion in element.motions:
                if motion in ROTATIONS:
                    before[f"{element.name}.{motion}"] = turn[:, ROTATIONS.index(motion)]
            turn = turn @ rotation_matrix(element.rotation)
            continue
        axis = turn @ np.array(element.axis)
        k = int(np.argmax(np.abs(axis)))
        if abs(axis[k]) < ALIGNED_COSINE:
            continue
        slopes, free = _own(element) if element.type == "prismatic" else ({}, frozenset())
        # a displacement d per unit of travel along u rotates the line by u x d
        own = {i: np.cross(axis, turn @ slope) for i, slope in slopes.items()}
        yield _Line(element, k, before | own, free)


def _own(joint: Joint) -> tuple[dict[str, Array], frozenset[str]]:
    """Slopes (3,) at home of a linear joint's straightness terms, and ids of its rotations (undefined lever)."""
    q = ca.SX.sym("q")
    home = min(max(0.0, joint.travel[0]), joint.travel[1])
    terms = joint_terms(joint, q)
    if not terms:
        return {}, frozenset()
    columns = ca.horzcat(*(ca.jacobian(t.column, q) for t in terms))
    rates = np.array(ca.Function("slopes", [q], [columns])(home))
    slopes: dict[str, Array] = {}
    free = []
    for term, rate in zip(terms, rates.T, strict=True):
        identity = f"{joint.name}.{term.motion}.{term.label}"
        if term.motion in TRANSLATIONS:
            slopes[identity] = rate[:3]
        else:
            free.append(identity)
    return slopes, frozenset(free)
