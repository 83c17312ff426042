"""Error models of a joint: which motions it makes, per unit of each parameter, as functions of its position.

A term is one parameter and the small motion ``(d, e)`` it stands for, six expressions in the joint's position
``q`` (mm or rad). All terms are linear in their parameter. Sources: first-order, Ferreira & Liu (1986) as used in the
five-axis paper's Eqs. 4 and 5; the others are the contract's definitions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import casadi as ca

from errormodel.conventions import MOTIONS, TRANSLATIONS, Motion, unit_of
from errormodel.effects.ops import cubic
from errormodel.machine import Basis, Joint


@dataclass(frozen=True)
class Term:
    """One parameter of an element: `column` is the element's six-motion (mm, rad) per unit of it."""

    motion: Motion
    label: str  # "" for a constant, "1", "sin2", "s3" ...
    unit: str
    column: ca.SX  # (6, 1): dx dy dz ea eb ec
    prior: float | None = None  # standard deviation about zero that is known beforehand, in the unit
    low: float = -math.inf  # the least that physics allows


def constant_terms(motions: tuple[Motion, ...]) -> list[Term]:
    """Terms of a shape, the frame or the tool: constants."""
    return [Term(motion, "", unit_of(motion), _along(motion, ca.SX(1))) for motion in motions]


def joint_terms(joint: Joint, q: ca.SX) -> list[Term]:
    """All terms of a joint in the order dx dy dz ea eb ec, each motion's terms by rising order."""
    return [term for motion in MOTIONS if motion in joint.models for term in _motion_terms(joint, motion, q)]


def _motion_terms(joint: Joint, motion: Motion, q: ca.SX) -> Iterator[Term]:
    basis = joint.models[motion]
    if basis.kind == "first-order":
        yield _first_order(joint, motion, q)
        return
    for label, value in _FUNCTIONS[basis.kind](joint, basis, q):
        yield Term(motion, label, unit_of(motion), _along(motion, value))


def _first_order(joint: Joint, motion: Motion, q: ca.SX) -> Term:
    if joint.type == "rotary":
        return Term(motion, "1", unit_of(motion), _along(motion, ca.sin(q / 2)))
    if motion in TRANSLATIONS:  # the scale: along the axis, whatever its direction
        return Term(motion, "1", "1", ca.vertcat(q * ca.SX(ca.DM(joint.axis)), ca.SX.zeros(3)))
    # an angle growing as q bends the path: straightness is the integral of (e x axis), q^2/2
    rate = _along(motion, q)
    turn = ca.SX(ca.DM([float(m == motion) for m in MOTIONS[3:]]))
    rate[:3] = q**2 / 2 * ca.cross(turn, ca.SX(ca.DM(joint.axis)))
    return Term(motion, "1", "rad/mm", rate)


def _polynomial(joint: Joint, basis: Basis, q: ca.SX) -> Iterator[tuple[str, ca.SX]]:
    u = q / max(abs(t) for t in joint.travel)
    for k in range(1, basis.n + 1):
        yield str(k), u**k


def _harmonic(joint: Joint, basis: Basis, q: ca.SX) -> Iterator[tuple[str, ca.SX]]:
    for k in range(1, basis.n + 1):
        yield f"sin{k}", ca.sin(k * q)
        yield f"cos{k}", ca.cos(k * q) - 1


def _spline(joint: Joint, basis: Basis, q: ca.SX) -> Iterator[tuple[str, ca.SX]]:
    """Uniform cubic B-splines, zero where q is 0 (or at the travel's end nearest to it): constants belong to shapes.

    The splines sum to one, so that one of them is dependent once each is made zero there; the first is left out.
    Beyond the travel the value at its end is held.
    """
    low, high = joint.travel
    home = min(max(0.0, low), high)
    clamped = ca.fmin(ca.fmax(q, low), high)
    for k in range(basis.n + 2):  # centred on knot k; k = -1 is the one left out
        value, at_home = (cubic((x - low) / (high - low) * basis.n - k) for x in (clamped, ca.SX(home)))
        yield f"s{k + 1}", value - at_home


_FUNCTIONS: dict[str, Callable[[Joint, Basis, ca.SX], Iterator[tuple[str, ca.SX]]]] = {
    "polynomial": _polynomial,
    "harmonic": _harmonic,
    "spline": _spline,
}


def _along(motion: Motion, value: ca.SX) -> ca.SX:
    column = ca.SX.zeros(6)
    column[MOTIONS.index(motion)] = value
    return column
