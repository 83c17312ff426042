"""The constant geometry of a fitted machine: its nominal one with the errors of its members in it, mm and rad.

A description of a chain holds constants. What a fitted machine has beyond them (error motions over a joint's position,
effects such as compliance) is replaced by the constants that come nearest to it over the measured volume, by least
squares of the position of the functional point and of the orientation of the last frame. A rigid motion of all of it is
none of the machine's, where the survey's frame is free.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field

import numpy as np

from errormodel.arrays import Array, as_rows, rotation_matrix
from errormodel.chain import Chain
from errormodel.conventions import MOTIONS, TOOL
from errormodel.machine import Machine, Shape
from errormodel.machine_formats.base import nominal
from errormodel.machine_formats.transforms import rotation_angles, vector
from identification.compensation.field import Field
from identification.compensation.volume import Volume, best_frame
from identification.observation.pose import IDENTITY, Pose

POSES = 1024  # of the least squares and of the figures; a power of two, for Sobol points
ORIENTATION_MM = 100.0  # mm per rad, by which orientations are weighed against positions: a hand's tool; by judgement
PASSES = 4  # of the least squares: errors are small, and the second pass changes nothing that can be seen
SEED, OTHER_SEED = 31, 32  # of the poses of the least squares, and of those that judge it


@dataclass(frozen=True)
class Spread:
    """Root mean square and largest value, um."""

    rms_um: float
    worst_um: float

    @classmethod
    def of(cls, errors: Array) -> Spread:
        """Of errors (n, 3) in mm."""
        length = 1e3 * np.linalg.norm(errors, axis=1)
        return cls(float(np.sqrt(np.mean(length**2))), float(length.max()))


@dataclass(frozen=True)
class Calibrated:
    """A machine whose nominal geometry is the fitted one.

    Attributes
    ----------
    machine : without error motions and effects; in the reference of the fit.
    nominal : the same before the fit.
    before : error of the nominal machine over the measured volume, after the best frame where that is free.
    left : the same of this machine.
    beyond : what no constant is, by name, with the root mean square of its own effect at the functional point, um.
    state : load, temperatures and whatever else the fitted machine changes with, for which the constants hold.
    others : other states, with the error of this machine there, in the frame of that one where it is free.
    """

    machine: Machine
    nominal: Machine
    before: Spread
    left: Spread
    beyond: Mapping[str, float]
    state: Mapping[str, float] = dataclass_field(default_factory=dict)
    others: tuple[tuple[Mapping[str, float], Spread], ...] = ()


def calibrated(
    field: Field, volume: Volume, tool_errors: Mapping[str, float], others: Sequence[Mapping[str, float]] = ()
) -> Calibrated:
    """The constant geometry nearest to a fitted machine in its state.

    `tool_errors` (mm) are those of the functional point; `others` are states in which it is judged as well.
    """
    chain = field.chain
    constant = np.array([isinstance(e, Shape) and not t for e, t in _places(chain)])
    values = dict(zip(chain.ids, np.where(constant, field.values, 0.0).tolist(), strict=True))
    before = nominal(chain.machine)
    machine = _shifted(before, values)
    rest = np.where(constant, 0.0, field.values)
    tool = np.array(before.tool) + [tool_errors.get(f"{TOOL}.{m}", 0.0) for m in MOTIONS[:3]]
    field = replace(field, chain=Chain(replace(chain.machine, tool=vector(tool))))
    machine = replace(machine, tool=vector(tool))
    if rest.any():
        machine = _nearest(field, volume, machine)
    judged = volume.poses(POSES, OTHER_SEED)
    frames = [_frame(field, judged, other) if volume.free else IDENTITY for other in (before, machine)]
    left = [_left(field, judged, other, frame) for other, frame in zip((before, machine), frames, strict=True)]
    elsewhere = tuple((state, _left(field.at(state), judged, machine, frames[1])) for state in others)
    beyond = _contributions(field, judged, rest)
    return Calibrated(machine, before, left[0], left[1], beyond, field.conditions, elsewhere)


def _places(chain: Chain) -> list[tuple[object, str]]:
    """Element and term of each parameter of a chain."""
    elements = {e.name: e for e in chain.machine.elements}
    return [(elements.get(p.element), p.term) for p in chain.parameters]


def _shifted(machine: Machine, values: Mapping[str, float]) -> Machine:
    """The machine whose members have these constant errors in their nominal place: ``Trans(offset + d) Rot(e) Rot``."""
    shifted = (_shifted_member(e, values) if isinstance(e, Shape) else e for e in machine.elements)
    return replace(machine, elements=tuple(shifted))


def _shifted_member(member: Shape, values: Mapping[str, float]) -> Shape:
    six = np.array([values.get(f"{member.name}.{m}", 0.0) for m in MOTIONS])
    if not six.any():
        return member
    turned = rotation_matrix(six[3:].tolist()) @ rotation_matrix(member.rotation)
    return replace(member, offset=vector(np.array(member.offset) + six[:3]), rotation=rotation_angles(turned))


def poses_of(chain: Chain, values: Array, rows: list[Array]) -> tuple[Array, Array]:
    """Positions (n, 3) and orientations (n, 3, 3) of a chain."""
    out = chain.kernel("actual")(rows, values).T
    return out[:, :3], out[:, 3:].reshape(-1, 3, 3).transpose(0, 2, 1)


def nominal_rows(machine: Machine, q: Array) -> list[Array]:
    """Channels of a machine without effects at commands (n, joints), with its own functional point."""
    return as_rows(*q.T, *np.tile(machine.tool, (len(q), 1)).T)


def _nearest(field: Field, volume: Volume, machine: Machine) -> Machine:
    """The constants nearest to a field, from those of `machine` on: Gauss-Newton, the smallest change of all."""
    from scipy.spatial.transform import Rotation

    q, came = volume.poses(POSES, SEED)
    wanted, turned = poses_of(field.chain, field.values, field.rows(q, came))
    scale = np.repeat([1.0, ORIENTATION_MM], 3)
    for _ in range(PASSES):
        free = replace(
            machine,
            elements=tuple(replace(e, motions=MOTIONS) if isinstance(e, Shape) else e for e in machine.elements),
        )
        chain = Chain(free)
        rows = nominal_rows(machine, q)
        point, turn = poses_of(chain, np.zeros(len(chain.ids)), rows)
        ids = (*(chain.frame_ids if volume.free else ()), *(i for i in chain.machine_ids))
        design = chain.kernel("design", ids)(rows).reshape(len(ids), 6, len(q)).transpose(2, 1, 0)
        angle = np.array([1.0 if i.rpartition(".")[2][0] == "d" else 1.0 / ORIENTATION_MM for i in ids])
        errors = np.hstack([wanted - point, Rotation.from_matrix(turned @ turn.transpose(0, 2, 1)).as_rotvec()])
        matrix = (design * scale[:, None] * angle).reshape(-1, len(ids))
        found = np.linalg.lstsq(matrix, (errors * scale).ravel(), rcond=1e-9)[0] * angle
        machine = _shifted(machine, dict(zip(ids, found.tolist(), strict=True)))
        if volume.free:  # the rest of the passes goes on from the frame that was found
            six = found[:6]
            back = rotation_matrix(six[3:].tolist())
            wanted, turned = (wanted - six[:3]) @ back, back.T @ turned
    return machine


def _points(field: Field, judged: tuple[Array, Array], machine: Machine) -> tuple[Array, Array]:
    """Actual functional points (n, 3) of a field, and those of a machine without errors, mm."""
    q, came = judged
    chain = Chain(machine)
    actual = poses_of(field.chain, field.values, field.rows(q, came))[0]
    return actual, poses_of(chain, np.zeros(len(chain.ids)), nominal_rows(machine, q))[0]


def _frame(field: Field, judged: tuple[Array, Array], machine: Machine) -> Pose:
    """The rigid motion of a machine without errors that comes nearest to a field."""
    actual, point = _points(field, judged, machine)
    return best_frame(actual - point, point)


def _left(field: Field, judged: tuple[Array, Array], machine: Machine, frame: Pose) -> Spread:
    """Error of a field (its actual functional point) against a machine without errors, in a frame."""
    actual, point = _points(field, judged, machine)
    return Spread.of(actual - frame.apply(point))


def _contributions(field: Field, judged: tuple[Array, Array], rest: Array) -> dict[str, float]:
    """What is no constant, by name, with the root mean square of its effect alone, um; the largest first."""
    chain, (q, came) = field.chain, judged
    rows = field.rows(q, came)
    groups: dict[str, list[int]] = {}
    for spec, ids in zip(chain.machine.effects, chain.effect_ids, strict=True):
        place = next((str(v) for k, v in spec.options.items() if k in ("joint", "shape", "element")), "")
        groups.setdefault(f"{spec.effect}{f' of {place}' if place else ''}", []).extend(chain.index[i] for i in ids)
    for k, parameter in enumerate(chain.parameters):
        if rest[k] and parameter.id not in chain.of_effects:
            groups.setdefault(f"error motions of {parameter.element} over its position", []).append(k)
    out = {}
    whole = poses_of(chain, field.values, rows)[0]
    for name, own in groups.items():
        if rest[own].any():
            without = field.values.copy()
            without[own] = 0.0
            out[name] = Spread.of(whole - poses_of(chain, without, rows)[0]).rms_um
    return dict(sorted(out.items(), key=lambda item: -item[1]))
