"""Finite kinematics of a chain in plain NumPy: exact positions for any motion of any element. mm and rad.

Conventions are the contract's (section 1): a shape is ``Trans(offset + d) Rot(e) Rot(rotation)``, a prismatic joint
``Trans(q axis + d) Rot(e)``, a rotary one ``Trans(d) Rot(e) Rot(axis, q)``; rotations are Rx Ry Rz; the measuring frame
stands left of the chain.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
MOTIONS = ("dx", "dy", "dz", "ea", "eb", "ec")
Motions = Mapping[str, Array]  # of an element, (n, 6)


@dataclass(frozen=True)
class Element:
    """A shape, or a prismatic or rotary joint with its model of errors ``(kind, order)``."""

    name: str
    kind: str  # shape | prismatic | rotary
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rad
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    travel: tuple[float, float] = (0.0, 0.0)  # mm or rad
    model: tuple[str, int] = ("polynomial", 2)

    @property
    def length(self) -> float:
        return self.travel[1] - self.travel[0]

    def share(self, q: Array) -> Array:
        """Position along the travel, 0 to 1."""
        return (q - self.travel[0]) / self.length


@dataclass(frozen=True)
class Chain:
    """Elements from the workpiece side to the tool side."""

    elements: tuple[Element, ...]
    tools: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),)
    roles: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Element:
        return next(e for e in self.elements if e.name == name)

    @property
    def joints(self) -> tuple[Element, ...]:
        return tuple(e for e in self.elements if e.kind != "shape")

    @property
    def prismatic(self) -> tuple[Element, ...]:
        return tuple(e for e in self.elements if e.kind == "prismatic")

    @property
    def rotary(self) -> tuple[Element, ...]:
        return tuple(e for e in self.elements if e.kind == "rotary")


def rotations(angles: Array) -> Array:
    """``Rx Ry Rz`` of (n, 3) angles, (n, 3, 3)."""
    (a, b, c), n = angles.T, len(angles)
    ca, cb, cc, sa, sb, sc = np.cos(a), np.cos(b), np.cos(c), np.sin(a), np.sin(b), np.sin(c)
    out = np.empty((n, 3, 3))
    out[:, 0] = np.column_stack([cb * cc, -cb * sc, sb])
    out[:, 1] = np.column_stack([ca * sc + sa * sb * cc, ca * cc - sa * sb * sc, -sa * cb])
    out[:, 2] = np.column_stack([sa * sc - ca * sb * cc, sa * cc + ca * sb * sc, ca * cb])
    return out


def about(axis: tuple[float, float, float], angle: Array) -> Array:
    """Rotation about a unit axis, (n, 3, 3)."""
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    out: Array = np.eye(3) + s * k + (1 - c) * (k @ k)
    return out


def position(chain: Chain, q: Mapping[str, Array], tool: Array, motions: Motions) -> Array:
    """Position (n, 3) of the functional point `tool` (n, 3) in the reference's axes, after the frame's own motion."""
    n = len(tool)
    zero = np.zeros((n, 6))
    point, turn = np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3))
    for e in chain.elements:
        own = motions.get(e.name, zero)
        d, small = own[:, :3], rotations(own[:, 3:]) if own.any() else None
        if e.kind == "prismatic":
            d = d + q[e.name][:, None] * np.array(e.axis)
        elif e.kind == "shape":
            d = d + np.array(e.offset)
        point = point + np.einsum("nij,nj->ni", turn, d)
        if small is not None:
            turn = turn @ small
        if e.kind == "rotary":
            turn = turn @ about(e.axis, q[e.name])
        elif e.kind == "shape" and any(e.rotation):
            turn = turn @ rotations(np.array([e.rotation]))[0]
    tip = motions.get("tool", zero)
    point = point + np.einsum("nij,nj->ni", turn, tool + tip[:, :3])
    frame = motions.get("frame", zero)
    out: Array = np.einsum("nij,nj->ni", rotations(frame[:, 3:]), point) + frame[:, :3]
    return out


def origins(chain: Chain, q: Mapping[str, Array], tool: Array) -> tuple[dict[str, Array], dict[str, Array], Array]:
    """Nominal origins (n, 3) and orientations (n, 3, 3) of the elements' own axes, and the tool's position (n, 3)."""
    n = len(tool)
    point, turn = np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3)).copy()
    places, turns = {}, {}
    for e in chain.elements:
        step = q[e.name][:, None] * np.array(e.axis) if e.kind == "prismatic" else np.tile(e.offset, (n, 1))
        if e.kind != "rotary":
            point = point + np.einsum("nij,nj->ni", turn, step)
        places[e.name], turns[e.name] = point, turn
        if e.kind == "rotary":
            turn = turn @ about(e.axis, q[e.name])
        elif e.kind == "shape" and any(e.rotation):
            turn = turn @ rotations(np.array([e.rotation]))[0]
    return places, turns, point + np.einsum("nij,nj->ni", turn, tool)


def terms(e: Element, q: Array) -> dict[str, Array]:
    """Six-motions (n, 6) per unit of each error parameter of an element, by id."""
    n, out = len(q), {}
    if e.kind == "shape":
        return {f"{e.name}.{m}": np.tile(np.eye(6)[k], (n, 1)) for k, m in enumerate(MOTIONS)}
    kind, order = e.model
    if kind == "first-order" and e.kind == "prismatic":
        axis = np.array(e.axis)
        scale = np.zeros((n, 6))
        scale[:, :3] = q[:, None] * axis
        out[f"{e.name}.{MOTIONS[int(np.argmax(np.abs(axis)))]}.1"] = scale
        for k in range(3):
            rate = np.zeros((n, 6))
            rate[:, 3 + k] = q
            rate[:, :3] = (q**2 / 2)[:, None] * np.cross(np.eye(3)[k], axis)
            out[f"{e.name}.{MOTIONS[3 + k]}.1"] = rate
        return out
    functions = {"1": np.sin(q / 2)}
    if kind == "polynomial":
        functions = {str(k): (q / max(abs(t) for t in e.travel)) ** k for k in range(1, order + 1)}
    elif kind == "harmonic":
        functions = {}
        for k in range(1, order + 1):
            functions |= {f"sin{k}": np.sin(k * q), f"cos{k}": np.cos(k * q) - 1}
    for k, m in enumerate(MOTIONS):
        for label, value in functions.items():
            out[f"{e.name}.{m}.{label}"] = value[:, None] * np.eye(6)[k]
    return out


def geometry(chain: Chain, q: Mapping[str, Array], values: Mapping[str, float], n: int) -> dict[str, Array]:
    """The motions (n, 6) of all elements that parameter values make."""
    out = {}
    for e in chain.elements:
        own = np.zeros((n, 6))
        for name, term in terms(e, q.get(e.name, np.zeros(n))).items():
            own = own + values.get(name, 0.0) * term
        out[e.name] = own
    return out


def added(one: Motions, other: Motions, factor: float = 1.0) -> dict[str, Array]:
    """Sum of two sets of motions."""
    out = dict(one)
    for name, motion in other.items():
        out[name] = out[name] + factor * motion if name in out else factor * motion
    return out


def levers(chain: Chain, q: Mapping[str, Array], tool: Array) -> dict[str, Array]:
    """What a unit of each motion of each element does to the tool's position, (n, 3, 6); frame and tool included."""
    n, out = len(tool), {}
    for name in ("frame", *(e.name for e in chain.elements), "tool"):
        own = np.zeros((n, 3, 6))
        for k in range(6):
            step = 1.0 if k < 3 else 1e-4
            motion = np.zeros((n, 6))
            motion[:, k] = step
            ahead = position(chain, q, tool, {name: motion})
            own[:, :, k] = (ahead - position(chain, q, tool, {name: -motion})) / (2 * step)
        out[name] = own
    return out


def design(chain: Chain, q: Mapping[str, Array], tool: Array, own: Mapping[str, Array]) -> Array:
    """Columns (n, 3, p) of the frame and of all error parameters: the model of geometry that the engineer believes."""
    columns = [own["frame"]]
    for e in chain.elements:
        parts = terms(e, q.get(e.name, np.zeros(len(tool)))).values()
        columns += [np.einsum("nij,nj->ni", own[e.name], part)[:, :, None] for part in parts]
    return np.concatenate(columns, axis=2)
