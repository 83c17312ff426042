"""Rows of robot calibration: the coordinates of two to four reflectors on the flange, then the joint values.

Written to the excerpt of RABKKK/LaserTrackerPoseData4KinIdent: no header, blanks, three reflectors, the joints last.
Each reflector becomes a row of its own, ``target`` says which.
"""

from __future__ import annotations

import numpy as np

from errormodel.exceptions import InputError
from errormodel.raw_formats.base import Asked, RawFile, RawFormat, Recording, joint_names
from errormodel.raw_formats.layout import Layout
from errormodel.raw_formats.table_columns import columns_of, table_of_text

TARGETS = (3, 2, 4)  # reflectors on a flange, the usual number first
RIGID = 1e-3  # of the distance between two reflectors: so well it stays over the rows; by judgement
SLACK = 0.1  # mm: of two readings of a reflector in its nest; by judgement


class RobotTargets(RawFormat):
    """Several reflectors in one row, recognised by distances between them that stay."""

    name = "robot-targets"
    title = "reflectors on a flange and joint values in one row"
    source = "readme of RABKKK/LaserTrackerPoseData4KinIdent"
    seen = True

    @classmethod
    def recognises(cls, raw: RawFile) -> bool:
        table = raw.clear_layout
        if table is None or table.named or len(table.names) < 7:
            return False
        return all(table.numeric(k) for k in range(len(table.names))) and _count(_values(table)) > 0

    @classmethod
    def read(cls, raw: RawFile, asked: Asked) -> Recording:
        import pandas as pd

        table = table_of_text(raw)
        values = columns_of(raw, asked)
        numbers = values.frame.to_numpy(dtype=float)
        count = _count(numbers)
        if not count:
            raise InputError(raw.name, "no reflectors whose distances stay", "Name --format and --columns")
        joints = list(joint_names(asked.machine))
        rest = numbers[:, 3 * count :]
        if asked.machine is not None and rest.shape[1] < len(joints):
            found = f"{rest.shape[1]} columns behind {count} reflectors, and the machine has {len(joints)} joints"
            raise InputError(raw.name, found, "Give the machine that was measured, or name --format and --columns")
        own = rest[:, rest.shape[1] - len(joints) :] if joints else rest
        left = rest[:, : rest.shape[1] - own.shape[1]]
        if left.size and np.ptp(left, axis=0).any():  # joints of the row that the machine has not, or none of them
            joints, own, left = [], rest, rest[:, :0]
        names = joints or [str(3 * count + k + 1) for k in range(own.shape[1])]
        frame = pd.DataFrame(np.repeat(own, count, axis=0), columns=names)
        frame[["mx", "my", "mz"]] = numbers[:, : 3 * count].reshape(-1, 3)
        frame["target"] = [str(k + 1) for k in range(count)] * len(numbers)
        notes = [f"{count} reflectors in each row"]
        if joints:
            notes.append(f"the last {len(joints)} columns taken as {', '.join(joints)}")
        if left.size:
            notes.append(f"{left.shape[1]} constant columns not used")
        lines = tuple(np.repeat(table.lines, count).tolist())
        return Recording(frame, {}, lines, (*values.notes, *notes, "no units in the file: taken as mm and degrees"))


def _values(table: Layout) -> np.ndarray:
    import pandas as pd

    from errormodel.formats.base import as_numbers

    comma = table.delimiter != ","
    columns = [as_numbers(pd.Series(table.column(k), dtype="str"), comma)[0] for k in range(len(table.names))]
    return np.column_stack(columns)


def _count(values: np.ndarray) -> int:
    """Number of reflectors at the beginning of each row (n, columns), by distances that stay; 0: none."""
    for count in TARGETS:
        if values.shape[1] < 3 * count or len(values) < 3:
            continue
        points = values[:, : 3 * count].reshape(len(values), count, 3)
        if np.isnan(points).any() or np.ptp(points, axis=0).max() < 1.0:
            continue
        pairs = [(i, j) for i in range(count) for j in range(i)]
        apart = np.array([np.linalg.norm(points[:, i] - points[:, j], axis=1) for i, j in pairs])
        middle = np.median(apart, axis=1)
        if middle.min() > 1.0 and (np.abs(apart - middle[:, None]).max(axis=1) < RIGID * middle + SLACK).all():
            return count
    return 0
