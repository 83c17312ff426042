"""The lines between which location errors of a model are, and what each parameter adds to these.

As an instrument measures them at the functional point (ISO 230-1): while one linear joint runs through equal targets
of its measured travel, the others stand still, in the middle of what was measured; the errors of both directions are
averaged. The axis average line of a rotary joint (ISO 230-7) is the mean of its tilts over the measured turn. Angular
error motions of the joints make both depend on where the others stand. mm and rad.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.location_errors import LINE_TARGETS, Axis, LocationError
from errormodel.machine import Joint
from identification.compensation.field import Field

if TYPE_CHECKING:
    import pandas as pd

ROUNDING = 1e-10  # of the sum of absolute values that a coefficient is made of
COEFFICIENT_TOLERANCE = 1e-5  # relative tolerance of two equal coefficients, because printed groups have six digits
SAME_POSITION = 1e-6  # mm or rad: commands closer than this are one target
LEAST_MOVED = 1e-3  # mm or rad: less is no motion
PLACE_STEPS = 1000  # of a travel, to at least one of which its middle is rounded
FEWEST_TARGETS = 3  # of a line of a survey
TURN = 2 * np.pi

Covered = Mapping[str, list[float]]  # the same as files have them, mm and deg: see `measured_range.covered`
Ranges = Mapping[str, tuple[float, float]]  # lowest and highest command of each joint, mm and rad


@dataclass(frozen=True)
class LocationAt:
    """A location error between two lines.

    Attributes
    ----------
    members : rad per unit of each parameter of the machine.
    value : rad, by exact kinematics at the field's parameters.
    paths : commands (targets, joints) along the reference, and along the line.
    """

    error: LocationError
    members: Mapping[str, float]
    value: float
    paths: tuple[Array, Array]

    def is_group(self, group: Mapping[str, float], of: Collection[str] | None = None) -> bool:
        """Whether a group ``{id: coefficient}`` is this location error, or is so at the parameters `of`."""
        ids = self.members.keys() | group.keys() if of is None else of
        pairs = [(self.members.get(i, 0.0), group.get(i, 0.0)) for i in ids]
        return any(a for a, _ in pairs) and all(
            abs(a - b) <= COEFFICIENT_TOLERANCE * max(abs(a), abs(b)) for a, b in pairs
        )


class Turned(NamedTuple):
    """Rotation vector of an axis.

    Attributes
    ----------
    by_parameters : (p, 3) rad per unit of each parameter; `size` : (p,) sum of absolute values that this is made of.
    values : (3,) rad, at the field's parameters.
    """

    by_parameters: Array
    size: Array
    values: Array


@dataclass(frozen=True)
class AxisLines:
    """Lines of the joints of a machine through one place.

    Attributes
    ----------
    field : errors at commands.
    ranges : what was measured of each joint.
    place : (joints,) where the joints stand that do not run.
    """

    field: Field
    ranges: Ranges
    place: Array

    @classmethod
    def of(cls, field: Field, covered: Covered) -> AxisLines:
        """Lines through the middle of what was measured, of a joint of which that is not known of its travel."""
        ranges = _ranges(field.joints, covered)
        return cls(field, ranges, middle(field.joints, ranges))

    @property
    def chain(self) -> Chain:
        return self.field.chain

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Parameters of the machine itself."""
        return tuple(i for i in self.chain.machine_ids if i not in self.chain.instrument_ids)

    def moved(self, joint: Joint) -> bool:
        """Whether a joint was moved."""
        return bool(np.ptp(self.ranges[joint.name]) > LEAST_MOVED)

    def path(self, joint: Joint) -> Array:
        """Commands (targets, joints) while a joint runs."""
        q = np.tile(self.place, (LINE_TARGETS, 1))
        q[:, self.field.joints.index(joint)] = np.linspace(*self.ranges[joint.name], LINE_TARGETS)
        return q

    def locations(self) -> list[LocationAt]:
        """The location errors between joints that were moved."""
        return [found for error in self.chain.location_errors if (found := self.location(error))]

    def location(self, error: LocationError, paths: tuple[Array, Array] | None = None) -> LocationAt | None:
        """A location error between the lines of two paths, None: through the place.

        None where a joint was not moved, or a rotary joint between the axes stands so far from zero that they do not
        have the directions of the symbol.
        """
        axes = (error.reference, error.line)
        if not all(self.moved(axis.joint) for axis in axes):
            return None
        own = paths or (self.path(axes[0].joint), self.path(axes[1].joint))
        frames = [self._frame(axis.joint, q[0]) for axis, q in zip(axes, own, strict=True)]
        if np.abs(frames[0] - frames[1]).max() > ROUNDING:
            return None
        about = frames[0][:, error.about]
        seen = [
            self._turned(a, q) if paths else self._through_place[a.joint.name] for a, q in zip(axes, own, strict=True)
        ]
        coefficients = (seen[1].by_parameters - seen[0].by_parameters) @ about
        real = np.abs(coefficients) > ROUNDING * (seen[1].size + seen[0].size)
        members = {i: float(c) for i, c, kept in zip(self.names, coefficients, real, strict=True) if kept}
        return LocationAt(error, members, float((seen[1].values - seen[0].values) @ about), own)

    def elsewhere(self, error: LocationError) -> tuple[float, float]:
        """Lowest and highest value of a location error between lines through the corners of what was measured, rad."""
        values = [at.value for lines in self._corners if (at := lines.location(error))]
        return min(values), max(values)

    @cached_property
    def _corners(self) -> list[AxisLines]:
        ends = [
            set(self.ranges[j.name]) if j.type == "prismatic" else {self.place[k]}
            for k, j in enumerate(self.field.joints)
        ]
        return [replace(self, place=np.array(corner)) for corner in product(*map(sorted, ends))]

    @cached_property
    def _through_place(self) -> dict[str, Turned]:
        axes = {a.joint.name: a for e in self.chain.location_errors for a in (e.reference, e.line)}
        return {name: self._turned(a, self.path(a.joint)) for name, a in axes.items() if self.moved(a.joint)}

    def _frame(self, joint: Joint, q: Array) -> Array:
        """Rotation (3, 3) that a joint's axes have from where they are with all joints at zero."""
        before = [e.name for e in self.chain.machine.elements].index(joint.name)
        position = {j.name: float(v) for j, v in zip(self.field.joints, q, strict=True)}
        here, zero = (self.chain.frames(at)[before, :3, :3] for at in (position, {}))
        return np.asarray(here @ zero.T, np.float64)

    def _turned(self, axis: Axis, q: Array) -> Turned:
        """How an axis lies along a path."""
        field, elements = self.field, self.chain.machine.elements
        linear = axis.joint.type == "prismatic"
        sides = [np.ones_like(q), -np.ones_like(q)][: 2 if field.reversing else 1]
        kernel = self.chain.kernel("design", self.names, outputs=(0, 1, 2) if linear else (3, 4, 5))
        design = np.mean([kernel(field.rows(q, s)) for s in sides], axis=0).reshape(len(self.names), 3, len(q))
        if linear:
            x = q[:, field.joints.index(axis.joint)]
            weights = (x - x.mean()) / np.sum(np.square(x - x.mean()))
            direction = self._frame(axis.joint, q[0]) @ np.array(axis.direction)
            errors = np.mean([field.actual(q, s) for s in sides], axis=0) - field.nominal(q)
            turned = np.cross(direction, design @ weights)
            values = np.cross(direction, weights @ errors)
        else:  # ends count half, since a turn ends where it began
            weights = np.r_[0.5, np.ones(len(q) - 2), 0.5] / (len(q) - 1)
            before = {e.name for e in elements[: elements.index(axis.joint) + 1]}
            own = [self.chain.parameters[self.chain.index[i]].element in before for i in self.names]
            turned = design @ weights * np.array(own)[:, None]
            values = field.values[[self.chain.index[i] for i in self.names]] @ turned
        return Turned(turned, np.einsum("pin,n->p", np.abs(design), np.abs(weights)), values)


def middle(joints: tuple[Joint, ...], ranges: Ranges) -> Array:
    """Commands (joints,) in the middle of what was measured, in few digits; rotary joints as near to zero as measured.

    The linear axes have their directions with the rotary ones at zero.
    """
    out = []
    for joint in joints:
        low, high = ranges[joint.name]
        if joint.type == "rotary":
            out.append(0.0 if high - low > TURN - LEAST_MOVED else float(np.clip(0.0, low, high)))
        else:
            step = 10.0 ** np.floor(np.log10((high - low) / PLACE_STEPS)) if high - low > LEAST_MOVED else np.inf
            out.append((low + high) / 2 if step == np.inf else float(step * np.round((low + high) / 2 / step)))
    return np.array(out, dtype=np.float64)


def locations_of(chain: Chain, table: pd.DataFrame, covered: Covered) -> list[LocationAt]:
    """The location errors of a machine as functions of its parameters, whatever their values.

    Parameters
    ----------
    table : rows of the survey, of which channels that are no joint have their median.
    """
    if not chain.location_errors:
        return []
    try:
        field = Field.without_errors(chain, table)
    except InputError:  # an effect depends on what was not recorded
        return []
    return AxisLines.of(field, covered).locations()


def _ranges(joints: tuple[Joint, ...], covered: Covered) -> dict[str, tuple[float, float]]:
    out = {}
    for joint in joints:
        low, high = covered.get(joint.name, joint.travel)
        turns = joint.type == "rotary" and joint.name in covered
        out[joint.name] = (float(np.radians(low)), float(np.radians(high))) if turns else (float(low), float(high))
    return out


def measured_paths(joints: tuple[Joint, ...], q: Array) -> dict[str, Array]:
    """The longest line of each linear joint among commands (n, joints): its path (targets, joints)."""
    key = np.round(q / SAME_POSITION).astype(np.int64)
    out: dict[str, Array] = {}
    for k, joint in enumerate(joints):
        if joint.type != "prismatic":
            continue
        _, number = np.unique(np.delete(key, k, axis=1), axis=0, return_inverse=True)
        longest = LEAST_MOVED
        for code in np.flatnonzero(np.bincount(number.ravel()) >= FEWEST_TARGETS):
            own = q[number.ravel() == code]
            if len(np.unique(key[number.ravel() == code, k])) >= FEWEST_TARGETS and np.ptp(own[:, k]) > longest:
                longest = float(np.ptp(own[:, k]))
                out[joint.name] = np.tile(own[0], (LINE_TARGETS, 1))
                out[joint.name][:, k] = np.linspace(own[:, k].min(), own[:, k].max(), LINE_TARGETS)
    return out


def spoken_place(joints: tuple[Joint, ...], q: Array, moving: Joint | None = None) -> str:
    """Where the joints that do not move stand, in words."""
    words = []
    for joint, at in zip(joints, q, strict=True):
        if joint != moving:
            value, unit = (np.degrees(at), "°") if joint.type == "rotary" else (at, "")
            words.append(f"{joint.name} {value + 0.0:.6g}{unit}")
    return ", ".join(words)
