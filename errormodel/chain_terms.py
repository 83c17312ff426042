"""Parameters of a chain's elements as symbols: each with the small motion ``(d, e)`` that it stands for.

Constants of a shape, of the frame and of the tool, and what the error models of a joint make of its position. All
terms are linear in their parameter.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import casadi as ca

from errormodel.conventions import MOTIONS, Motion, unit_of
from errormodel.effects.ops import Value
from errormodel.joint_models import registry
from errormodel.machine import Joint


@dataclass(frozen=True)
class Term:
    """One parameter of an element: `column` is the element's six-motion (mm, rad) per unit of it."""

    motion: Motion
    label: str  # "" for a constant, "1", "sin2", "s3" ...
    unit: str
    column: ca.SX  # (6, 1): dx dy dz ea eb ec
    prior: float | None = None  # standard deviation about zero that is known beforehand, in the unit
    low: float = -math.inf  # the least that physics allows
    size: float = math.inf  # how large it physically is (one standard deviation)


def constant_terms(motions: tuple[Motion, ...]) -> list[Term]:
    """Terms of a shape, the frame or the tool: constants."""
    return [Term(motion, "", unit_of(motion), column_of({motion: 1.0})) for motion in motions]


def joint_terms(joint: Joint, q: ca.SX) -> list[Term]:
    """All terms of a joint in the order dx dy dz ea eb ec, each motion's terms by rising order."""
    return [term for motion in MOTIONS if motion in joint.models for term in _motion_terms(joint, motion, q)]


def _motion_terms(joint: Joint, motion: Motion, q: ca.SX) -> Iterator[Term]:
    basis = joint.models[motion]
    for term in registry()[basis.kind].terms(joint, motion, basis.n, q):
        yield Term(motion, term.label, term.unit or unit_of(motion), column_of(term.motion))


def column_of(motions: Mapping[Motion, Value]) -> ca.SX:
    """Motions of an element as one column (6, 1)."""
    column = ca.SX.zeros(6)
    for motion, value in motions.items():
        column[MOTIONS.index(motion)] = value
    return column
