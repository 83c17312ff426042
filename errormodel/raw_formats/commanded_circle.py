"""Commanded positions along a circle, for traces that hold the angle of a bar and no coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from errormodel.arrays import Array
from errormodel.exceptions import InputError, nearest
from errormodel.instruments.base import Positive
from errormodel.machine import Machine
from errormodel.yamlfile import FileModel, Number

if TYPE_CHECKING:
    import pandas as pd

JUST_BEFORE = 1e-7  # rad: where an axis reverses, it has the direction that it arrives with


class CommandedCircle(FileModel):
    """The circle that a machine was commanded to run while a trace was recorded."""

    centre: dict[str, Number] = Field(
        description="commanded position (mm, degrees) of every joint at the centre, such as {X: 0, Y: 0, Z: 300}"
    )
    plane: str = Field(
        "",
        pattern="^([A-Z]{2})?$",
        description="the two linear axes of its plane, such as XY; angles count from the first to the second; left "
        "out: as the file states it",
    )
    radius: Positive | None = Field(None, description="commanded radius in mm; left out: the nominal one of the file")
    start: Number = Field(0.0, description="degrees to add to the angles of the file, whose zero is the first axis")

    def commands(
        self, machine: Machine, angle: Array, side: Array, plane: str, radius: float, where: str
    ) -> pd.DataFrame:
        """Positions of the joints (mm, degrees) and the directions of travel of those of the plane, a row an angle.

        Parameters
        ----------
        angle : (n,) rad, from the plane's first axis to its second; `side`: (n,) 1 where it grows, else -1.
        plane, radius : as the file states them, mm; used where the circle does not.
        where : the file, for messages.

        Raises
        ------
        InputError
            No plane or radius is known, the machine has no such axes, or a joint has no position.
        """
        import pandas as pd

        joints = {j.name: j for j in machine.joints}
        axes = self._axes(machine, plane, where)
        for name in self.centre:
            if name not in joints:
                raise InputError(f"{where}, centre", f"the machine has no joint '{name}'", nearest(name, joints))
        missing = [name for name in joints if name not in self.centre]
        if missing:
            raise InputError(
                f"{where}, centre", f"no position of {missing[0]}", "Give that of every joint, as X=0,Y=0,Z=300"
            )
        size = self.radius or radius
        if not np.isfinite(size):
            raise InputError(where, "no commanded radius", "Say it: radius: in survey.yaml, or --radius")
        turned = angle + np.radians(self.start)
        arrives = turned - side * JUST_BEFORE
        columns = {name: np.full(len(angle), float(self.centre[name])) for name in joints}
        for name, place, slope in zip(axes, (np.cos, np.sin), (-np.sin(arrives), np.cos(arrives)), strict=True):
            columns[name] = columns[name] + size * place(turned)
            columns[f"dir_{name}"] = np.sign(slope * side)
        return pd.DataFrame(columns)

    def _axes(self, machine: Machine, stated: str, where: str) -> str:
        plane = self.plane or stated
        if not plane:
            raise InputError(where, "no plane of the circle", "Say it: plane: XY in survey.yaml, or --plane XY")
        linear = [j.name for j in machine.joints if j.type == "prismatic"]
        for axis in plane:
            if axis not in linear:
                found = f"the plane {plane}, and the machine has no linear joint '{axis}'"
                raise InputError(where, found, f"Its linear joints are {', '.join(linear)}")
        if plane[0] == plane[1]:
            raise InputError(where, f"the plane {plane}", "Write two different axes, such as XY")
        return plane


def senses_of(angle: Array) -> Array:
    """1 where the angle grows, else -1, (n,); where the bar turns back, as it goes on."""
    if len(angle) < 2:
        return np.ones(len(angle))
    steps = np.sign(np.diff(angle, prepend=2 * angle[0] - angle[1]))
    moving = np.flatnonzero(steps)
    if not len(moving):
        return np.ones(len(angle))
    following = moving[np.minimum(np.searchsorted(moving, np.arange(len(angle))), len(moving) - 1)]
    return np.asarray(steps[following])
