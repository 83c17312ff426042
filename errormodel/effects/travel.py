"""Normalised positions on a joint's travel, and directions of deflection, as effects use them.

All functions take arrays and CasADi symbols. Scales come from the joint's travel and not from a survey, so that a
parameter has the same meaning at other poses.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations
from math import hypot
from typing import Literal

from errormodel.conventions import MOTIONS, ROTATIONS, TRANSLATIONS, Motion
from errormodel.effects.ops import Value, fmax
from errormodel.effects.search_space.survey_summary import Scene
from errormodel.effects.shared import across
from errormodel.exceptions import InputError
from errormodel.machine import Joint, Machine, Vector

Translation = Literal["dx", "dy", "dz"]
End = Literal["low", "high"]
TRAVEL_ENDS: tuple[End, End] = ("low", "high")  # the two ends of a travel


def usual_size(motion: Motion) -> float:
    """Usual size (standard deviation) of an error motion without further knowledge: 20 um, 30 urad."""
    return 0.02 if motion in TRANSLATIONS else 3e-5


def length(joint: Joint) -> float:
    """Length of a joint's travel, mm or rad."""
    return joint.travel[1] - joint.travel[0]


def fraction(joint: Joint, q: Value) -> Value:
    """Position on the travel, 0 at its low end and 1 at its high one."""
    return (q - joint.travel[0]) / length(joint)


def scaled(joint: Joint, q: Value) -> Value:
    """Position on the travel, from -1 to 1."""
    return 2 * fraction(joint, q) - 1


def extension(joint: Joint, q: Value, retracted: End) -> Value:
    """Extension of a member from its guide: 0 at the retracted end and beyond, 1 at the other end of travel."""
    f = fraction(joint, q)
    return fmax(f if retracted == "low" else 1 - f, 0.0)


def legendre(degree: int, u: Value) -> Value:
    """Legendre polynomial of degree 1 or higher."""
    before, here = 1.0, u
    for n in range(1, degree):
        before, here = here, ((2 * n + 1) * u * here - n * before) / (n + 1)
    return here


def legendre_slope(degree: int, u: Value) -> Value:
    """Derivative of the Legendre polynomial of degree 1 or higher: the sum of (2k + 1) P_k, k one less, three less."""
    return sum((2 * k + 1) * (legendre(k, u) if k else 1.0) for k in range(degree - 1, -1, -2)) + 0 * u


def polynomials(degree: int, u: Value) -> list[Value]:
    """Legendre polynomials from degree 0 to `degree`."""
    return [1.0, *(legendre(n, u) for n in range(1, degree + 1))]


def cross(a: Vector, b: Vector) -> Vector:
    """Cross product of two plain vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def parallel(one: Vector, other: Vector) -> bool:
    """Whether two axes are parallel or antiparallel, within 8 degrees."""
    return hypot(*cross(one, other)) < 0.14


def direction(motion: Motion) -> Vector:
    """Unit vector along (about) which a motion is positive."""
    k = MOTIONS.index(motion) % 3
    return float(k == 0), float(k == 1), float(k == 2)


def turn(about: Vector, value: Value) -> dict[Motion, Value]:
    """Small rotation of size `value` (rad) about a unit vector."""
    return {name: value * a for name, a in zip(ROTATIONS, about, strict=True) if abs(a) > 1e-9}


def shift(along: Vector, value: Value) -> dict[Motion, Value]:
    """Small displacement of size `value` (mm) along a unit vector."""
    return {name: value * a for name, a in zip(TRANSLATIONS, along, strict=True) if abs(a) > 1e-9}


def tilt_of(joint: Joint, motion: Motion) -> Vector:
    """Axis about which the member along the joint's axis rotates where its deflection along `motion` grows."""
    return cross(joint.axis, direction(motion))


def sag_direction(joint: Joint, motion: Motion | None) -> Motion:
    """Return the given translation across a joint; by default ``dz``, or ``dy`` for a joint along z.

    Raises
    ------
    InputError
        The motion is along the joint.
    """
    sides = across(joint, "d")
    if motion is None:
        return "dz" if "dz" in sides else "dy"
    if motion not in sides:
        raise InputError(
            f"joint {joint.name}", f"{motion} is along it, and sag is across", f"Write {' or '.join(sides)}"
        )
    return motion


def retracted_end(machine: Machine, joint: Joint, given: End | None) -> End:
    """End of travel at which a member is retracted; by default the end from which it moves towards the tool."""
    if given is not None:
        return given
    return "high" if _ahead(joint, _reach(machine, joint)) < 0 else "low"


def member_of(machine: Machine, joint: Joint) -> Literal["ram", "slide", ""]:
    """What a prismatic joint moves: a ram, or a slide; "" where the machine's file does not tell.

    A ram carries the tool out along its own axis. A slide carries a further axis, or the tool beside it, along a beam
    or a column. Where a rotary joint follows, what lies before it and all up to the tool have to say the same: a head
    turns the tool aside at the end of a ram, too.
    """
    later = machine.joints[machine.joints.index(joint) + 1 :]
    if any(j.type == "prismatic" and not parallel(j.axis, joint.axis) for j in later):
        return "slide"
    if len(machine.joints) == 1:
        return ""
    words = {_towards(joint, _reach(machine, joint, to_head)) for to_head in (False, True)} - {""}
    return words.pop() if len(words) == 1 else ""


def _towards(joint: Joint, reach: Vector) -> Literal["ram", "slide", ""]:
    """Whether a reach, mm, is along a joint's axis; "" where it has no length."""
    along, whole = _ahead(joint, reach) ** 2, sum(v**2 for v in reach)
    if not whole:
        return ""
    return "ram" if 2 * along > whole else "slide"


def _reach(machine: Machine, joint: Joint, to_head: bool = False) -> Vector:
    """Offset from a joint to the tool, mm, with all joints at zero; or `to_head`, the next rotary joint, if any."""
    later = machine.elements[machine.elements.index(joint) + 1 :]
    turning = [k for k, e in enumerate(later) if to_head and isinstance(e, Joint) and e.type == "rotary"]
    arms = [e.offset for e in later[: turning[0] if turning else None] if not isinstance(e, Joint)]
    x, y, z = zip(*arms, (0.0, 0.0, 0.0) if turning else machine.tool, strict=True)
    return sum(x), sum(y), sum(z)


def _ahead(joint: Joint, reach: Vector) -> float:
    """How far a reach goes along a joint's axis, mm."""
    return sum(a * v for a, v in zip(joint.axis, reach, strict=True))


def crossing(scene: Scene) -> Iterator[tuple[Joint, Joint]]:
    """Ordered pairs of prismatic joints that both moved and are not parallel."""
    return ((a, b) for a, b in permutations(scene.prismatic, 2) if not parallel(a.axis, b.axis))
