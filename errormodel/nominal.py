"""The nominal machine at commands: its points, and the pose of its last frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain

if TYPE_CHECKING:
    import pandas as pd


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
