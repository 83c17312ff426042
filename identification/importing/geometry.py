"""Functional points of several targets, from nominal and measured points."""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.machine import Machine
from errormodel.nominal import Nominal
from identification.observation.frames import align
from identification.observation.pose import Pose

ROUNDS = 8  # of alternating frame and targets: each is a closed form
TURNS = 200  # pairs of poses from which the turn of the frame is taken


def turns_tool(machine: Machine) -> bool:
    """Whether a joint turns the last frame, so that its functional point shows in the measured points."""
    return any(j.type == "rotary" for j in machine.joints)


def fitted_targets(nominal: Nominal, measured: Array, label: Index, start: Array) -> tuple[Array, Pose]:
    """Functional points (targets, 3) and the frame that fit measured points best, each in closed form in turn.

    Parameters
    ----------
    nominal : of the command of each row.
    measured : (n, 3) mm.
    label : (n,) number of the target of each row.
    start : (targets, 3) mm, to begin with; the first stays where no joint turns the last frame.
    """
    turns, origins = nominal.flanges()
    held = None if turns_tool(nominal.chain.machine) else start[0]
    tools = start.copy()
    pose = align(nominal.points(tools[label]), measured)
    rotation = _frame_turn(turns, measured, label)
    candidates = [pose.rotation] if rotation is None else [rotation, pose.rotation]
    best: tuple[float, Array, Pose] | None = None
    for turn in candidates:
        own, frame = _by_turn(turns, origins, measured, label, turn, len(start), held)
        for _ in range(ROUNDS):
            points = origins + np.einsum("nij,nj->ni", turns, own[label])
            frame = align(points, measured)
            own, frame = _by_turn(turns, origins, measured, label, frame.rotation, len(start), held)
        points = origins + np.einsum("nij,nj->ni", turns, own[label])
        miss = float(np.median(np.linalg.norm(measured - frame.apply(points), axis=1)))
        if best is None or miss < best[0]:
            best = miss, own, frame
    assert best is not None
    return best[1], best[2]


def _by_turn(
    turns: Array, origins: Array, measured: Array, label: Index, rotation: Array, count: int, held: Array | None
) -> tuple[Array, Pose]:
    """Targets and translation of a frame whose rotation is given: a linear problem."""
    n = len(measured)
    design = np.zeros((n, 3, 3 + 3 * count))
    design[:, :, :3] = np.eye(3)
    for row in range(n):
        at = 3 + 3 * int(label[row])
        design[row, :, at : at + 3] = rotation @ turns[row]
    left = (measured - origins @ rotation.T).ravel()
    if held is not None:  # nothing turns: the frame takes up what all targets have in common
        left = left - design.reshape(3 * n, -1)[:, 3:6] @ held
        design[:, :, 3:6] = 0.0
    x: Array = np.asarray(np.linalg.lstsq(design.reshape(3 * n, -1), left, rcond=1e-10)[0], dtype=np.float64)
    tools = x[3:].reshape(count, 3)
    if held is not None:
        tools[0] = held
    return tools, Pose(rotation, x[:3])


def _frame_turn(turns: Array, measured: Array, label: Index) -> Array | None:
    """Rotation of the measuring frame from how three or more targets turn together; None for fewer.

    Two poses with the flange turned by R are measured turned by ``F R F'``: the rotation vectors are related by F.
    """
    from scipy.spatial.transform import Rotation

    count = int(label.max()) + 1
    if count < 3 or len(measured) % count or not np.array_equal(label, np.tile(np.arange(count), len(label) // count)):
        return None
    bodies = measured.reshape(-1, count, 3)
    about = bodies - bodies.mean(axis=1, keepdims=True)
    flange = turns[::count]
    pairs = [(i, j) for i in range(len(bodies)) for j in range(i)][:: max(1, len(bodies) ** 2 // (2 * TURNS))]
    if len(pairs) < 3:
        return None
    seen = np.array([Rotation.align_vectors(about[i], about[j])[0].as_rotvec() for i, j in pairs])
    commanded = Rotation.from_matrix(np.array([flange[i] @ flange[j].T for i, j in pairs])).as_rotvec()
    if np.linalg.matrix_rank(commanded, tol=1e-2) < 2:
        return None
    return np.asarray(Rotation.align_vectors(seen, commanded)[0].as_matrix())
