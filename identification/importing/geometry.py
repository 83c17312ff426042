"""Nominal points at commands, and the functional points of several targets."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.chain import Chain
from errormodel.machine import Machine
from identification.observation.frames import align
from identification.observation.pose import Pose

if TYPE_CHECKING:
    import pandas as pd

ROUNDS = 8  # of alternating frame and targets: each is a closed form
TURNS = 200  # pairs of poses from which the turn of the frame is taken


class Nominal:
    """The nominal machine at commands.

    Parameters
    ----------
    chain : Chain
    commands : DataFrame with the joints (mm, degrees; a joint of two drives by the mean of them).
    """

    def __init__(self, chain: Chain, commands: pd.DataFrame) -> None:
        self.chain = chain
        self.size = len(commands)
        self._columns = {c: np.zeros(self.size) for c in chain.channels}
        for joint in chain.machine.joints:
            names = [joint.name] if joint.name in commands else list(joint.drives)
            q = commands[names].to_numpy(dtype=np.float64).mean(axis=1)
            self._columns[joint.name] = np.radians(q) if joint.type == "rotary" else q

    @property
    def joints(self) -> Array:
        """Positions (n, joints), mm and rad."""
        return np.column_stack([self._columns[j.name] for j in self.chain.machine.joints])

    def channels(self, tool: Array) -> list[Array]:
        """Channels of the chain, each (n,), at functional points `tool`, (3,) or (n, 3), mm."""
        columns = dict(self._columns)
        for k, name in enumerate(("tool_x", "tool_y", "tool_z")):
            columns[name] = np.broadcast_to(np.asarray(tool, dtype=np.float64)[..., k], self.size).copy()
        return [columns[c] for c in self.chain.channels]

    def points(self, tool: Array) -> Array:
        """Nominal points (n, 3) of functional points `tool`, (3,) or (n, 3), mm."""
        kernel = self.chain.kernel("nominal", outputs=(0, 1, 2))
        return np.asarray(kernel(self.channels(tool)).T)

    def flanges(self) -> tuple[Array, Array]:
        """Last frame of the chain at each command: rotations (n, 3, 3), origins (n, 3) in mm."""
        origin = self.points(np.zeros(3))
        axes = [self.points(np.eye(3)[k]) - origin for k in range(3)]
        return np.stack(axes, axis=-1), origin


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
