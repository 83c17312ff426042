"""Location errors of axes (squareness, parallelism) as linear combinations of the error parameters.

Between two axes along principal directions; rad. The line of a linear joint is the least-squares line over the travel
of the path of the functional point, which the joint's own straightness and rotations tilt by their slopes. Symbols as
in ISO 230-1:2012 and ISO 230-7:2015, with the reference axis in brackets: EC(0X)Y is the rotation about +z of the line
of Y relative to X. A rotary axis has also the older symbol of ISO 230-7:2006, such as AOC. Positions of rotary axes
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
LINE_NODES = 64  # of the quadrature over a travel: exact for polynomials
SMALLEST_COEFFICIENT = 1e-12  # coefficients below this are rounding errors
COEFFICIENT_TOLERANCE = 1e-5  # relative tolerance of two equal coefficients, because printed groups have six digits
ROTATION_LETTERS = "ABC"  # rotations about x, y and z in ISO 230-1 symbols


@dataclass(frozen=True)
class LocationError:
    """A location error of two axes.

    Attributes
    ----------
    symbol, words : symbol and name, such as ``EC(0X)Y`` and ``squareness of Y against X``.
    members : rad per unit of each parameter, the other joints at zero.
    free : parameters whose coefficient depends on the point whose path is taken.
    reference, line : the joints, of which the location of `line` is relative to `reference`.
    """

    symbol: str
    words: str
    members: Mapping[str, float]
    free: frozenset[str]
    reference: Joint
    line: Joint

    def is_group(self, members: Mapping[str, float]) -> bool:
        """Whether a group ``{id: coefficient}`` is this location error."""
        ids = (self.members.keys() | members.keys()) - self.free
        pairs = [(self.members.get(i, 0.0), members.get(i, 0.0)) for i in ids]
        return any(a for a, _ in pairs) and all(
            abs(a - b) <= COEFFICIENT_TOLERANCE * max(abs(a), abs(b)) for a, b in pairs
        )


@dataclass(frozen=True)
class _Line:
    """An axis: principal direction `k`, and tilt (3,) in rad per unit of each parameter."""

    joint: Joint
    k: int
    tilts: Mapping[str, Array]
    free: frozenset[str]


def location_of(machine: Machine) -> list[LocationError]:
    """All squareness and parallelism errors of a machine with prismatic joints, each pair of axes in both orders."""
    lines = list(_lines(machine)) if any(j.type == "prismatic" for j in machine.joints) else []
    return [error for a, b in permutations(lines, 2) for error in _between(a, b)]


def one_of_each_pair(errors: list[LocationError]) -> list[LocationError]:
    """The location errors without those of opposite sign: linear axes are the reference, then the first by name."""

    def order(joint: Joint) -> tuple[bool, str]:
        return joint.type == "rotary", joint.name

    return [e for e in errors if order(e.reference) < order(e.line)]


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
            f"E{ROTATION_LETTERS[k]}(0{first.name}){second.name}", words, members, reference.free | line.free,
            first, second,
        )  # fmt: skip


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
    """Slopes (3,) of a linear joint's straightness terms, and ids of its rotations (undefined lever).

    The slope is that of the least-squares line over the travel (ISO 230-1, reference straight line).
    """
    q = ca.SX.sym("q")
    terms = joint_terms(joint, q)
    if not terms:
        return {}, frozenset()
    nodes, weights = np.polynomial.legendre.leggauss(LINE_NODES)
    low, high = joint.travel
    about = nodes * (high - low) / 2
    shape = ca.Function("terms", [q], [ca.horzcat(*(t.column for t in terms))])
    values = np.array([np.array(shape(x + (low + high) / 2)) for x in about])  # (nodes, 6, terms)
    slopes_of_all = np.einsum("n,nmt->mt", weights * about, values) / float(weights @ about**2)
    slopes: dict[str, Array] = {}
    free = []
    for term, rate in zip(terms, slopes_of_all.T, strict=True):
        identity = f"{joint.name}.{term.motion}.{term.label}"
        if term.motion in TRANSLATIONS:
            slopes[identity] = rate[:3]
        else:
            free.append(identity)
    return slopes, frozenset(free)
