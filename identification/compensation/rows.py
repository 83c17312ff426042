"""The survey behind a fit: which commands were measured, and what the fit left of the rows that it did not see."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Mask
from errormodel.chain import TOOL_CHANNELS
from errormodel.channels import direction
from errormodel.exceptions import InputError
from errormodel.inputs import noted
from errormodel.instruments.plain import Plain
from errormodel.machine import Machine
from errormodel.survey import Survey
from identification.compensation.read_motions import joints_read, placed
from identification.observation.assembly import frame_labels
from identification.observation.frames import IDENTITY, Pose
from identification.results.store import CURE, StoredFit

if TYPE_CHECKING:
    import pandas as pd

FEWEST = 12  # held-out poses that are worth a figure


def read_rows(folder: Path, machine: Machine) -> pd.DataFrame:
    """``residuals.csv`` of a fit in mm and rad, rows whose commands are all known.

    Raises
    ------
    InputError
        There is no such file, or it is of another machine.
    """
    import pandas as pd

    path = noted(folder / "residuals.csv")
    try:
        table = pd.read_csv(path, dtype={"run": str, "file": str})
    except (OSError, ValueError) as error:
        raise InputError(str(path), f"it cannot be read ({error})", CURE) from error
    missing = [j.name for j in machine.joints if j.name not in table]
    if missing or not len(table):
        found = f"no column '{missing[0]}'" if missing else "no rows"
        raise InputError(str(path), found, "Run the fit again")
    for joint in machine.joints:
        if joint.type == "rotary":
            table[joint.name] = np.radians(table[joint.name])
    if (about := joints_read(table)) is not None:
        return placed(table, machine, set(about))
    known = table[[j.name for j in machine.joints]].notna().all(axis=1)
    return table[known].reset_index(drop=True)


@dataclass(frozen=True)
class Rows:
    """Commands of a survey in mm and rad.

    Attributes
    ----------
    q, direction : (n, joints)
    tool : (n, 3) mm
    left : (n, 3) measured minus predicted by a fit that did not see the row, mm, in the reference's axes.
    frames : (n,) label of the frame that a row was measured in.
    what : which rows these are, in words.
    about : (n,) joint whose error motions a row reads, "" where it is a position; None: all are positions.
    """

    q: Array
    direction: Array
    tool: Array
    left: Array
    frames: Array
    what: str
    about: Array | None = None

    def __len__(self) -> int:
        return len(self.q)

    def part(self, keep: Mask, of: str) -> Rows:
        """Some of the rows, and what tells them from the others."""
        q, came, tool, left, frames = (a[keep] for a in (self.q, self.direction, self.tool, self.left, self.frames))
        about = None if self.about is None else self.about[keep]
        return Rows(q, came, tool, left, frames, f"{len(q)} {self.what.partition(' ')[2]}, {of}", about)


def commands(table: pd.DataFrame, machine: Machine) -> tuple[Array, Array, Array]:
    """Positions, directions of arrival (n, joints) and tools (n, 3) of a table."""
    q = table[[j.name for j in machine.joints]].to_numpy(dtype=np.float64)
    came = np.column_stack([direction(table, j.name) for j in machine.joints]) if len(table) else np.ones_like(q)
    tools = np.tile(np.asarray(machine.tool, dtype=np.float64), (len(table), 1))
    for k, name in enumerate(TOOL_CHANNELS):
        if name in table:
            tools[:, k] = table[name].fillna(machine.tool[k])
    return q, came, tools


def held_out(fit: StoredFit, table: pd.DataFrame) -> Rows | None:
    """Positions that no fit saw: test files, or the blocks that were left out; None if there are too few."""
    for role, column, what in (
        ("test", "residual", "rows of test files"),
        ("fit", "heldout", "rows left out of the fit in blocks"),
    ):
        names = [f"{column}_{axis}_um" for axis in "xyz"]
        if not {*names} <= {*table.columns}:
            continue
        keep = (table["role"] == role) & table[names].notna().all(axis=1)
        part = table[keep]
        if len(part) < FEWEST:
            continue
        q, came, tools = commands(table, fit.chain.machine)
        mask = keep.to_numpy(dtype=bool)
        labels = frame_labels(Survey(part, "shared", (), Plain(type="plain"), Path()), fit.frame_mode)
        measured = 1e-3 * part[names].to_numpy(dtype=np.float64)
        left = np.empty_like(measured)
        for label in dict.fromkeys(labels):
            rows = labels == label
            left[rows] = measured[rows] @ _pose(fit, part["file"].iloc[int(np.argmax(rows))], label, role).rotation
        return Rows(q[mask], came[mask], tools[mask], left, labels, f"{len(part)} {what}")
    return None


def _pose(fit: StoredFit, file: str, label: str, role: str) -> Pose:
    if role == "test":
        return fit.test_frames.get(file, {}).get(label) or fit.frames.get(label, IDENTITY)
    return fit.frames.get(label, IDENTITY)
