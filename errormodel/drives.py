"""Two drives of one axis, as of a gantry: one joint in the chain, two columns in a survey.

The joint's position is the mean of the two columns; their difference (first minus second, mm) is the channel
``w_sync_<joint>``, on which `gantry-racking` depends.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from errormodel.exceptions import InputError
from errormodel.machine import Machine
from errormodel.serial_chain import directions
from errormodel.surveys.columns import MEASURED, TOOL_COLUMNS

Array = NDArray[np.float64]

# largest difference of the two drives as a share of the travel; by judgement: a beam skewed by more is damaged
MOST_SKEW_SHARE = 0.02
# a difference that is the same in all rows is one of zeros beyond this yaw (rad), and this many times its scatter
LARGEST_YAW, CONSTANT_OVER_SCATTER = 1e-3, 20.0
USUAL_SPACING_MM = 1000.0  # where the spacing of the drives is not stated
# difference of two columns, as a share of their range, below which they are one motion: two drives, or one command
SAME_MOTION_SHARE = 1e-3
FEWEST_DRIVE_ROWS = 8  # fewest rows from which two columns are compared; by judgement
# factor by which one drive must explain the measured distances better than two in series; by judgement
SINGLE_DRIVE_GAIN = 4.0


def as_one(frame: pd.DataFrame, machine: Machine, name: str) -> pd.DataFrame:
    """Replace the columns of two drives by the joint's position and their difference, mm.

    A column of the joint itself takes precedence over the mean of its drives.

    Parameters
    ----------
    frame : the file in internal units, with ``row``.
    name : the file, for messages.

    Raises
    ------
    InputError
        The drives are farther apart than a beam can be skewed.
    """
    for joint in machine.joints:
        if not joint.drives or not all(drive in frame for drive in joint.drives):
            continue
        first, second = (frame[drive].to_numpy(dtype=np.float64) for drive in joint.drives)
        apart = np.nan_to_num(np.abs(first - second))
        if apart.max(initial=0.0) > MOST_SKEW_SHARE * (joint.travel[1] - joint.travel[0]):
            worst = int(apart.argmax())
            one, other = joint.drives
            raise InputError(
                f"{name}, row {frame['row'].iloc[worst]}, columns {one} and {other}",
                f"{apart[worst]:.6g} mm between the two drives of {joint.name}",
                "Give both in the same unit, from the same zero and in the same direction",
            )
        constant = float(np.nanmedian(first - second))
        scatter = float(np.ptp(np.nanquantile(first - second, (0.1, 0.9))))
        if abs(constant) > max(LARGEST_YAW * (joint.spacing or USUAL_SPACING_MM), CONSTANT_OVER_SCATTER * scatter):
            one, other = joint.drives
            raise InputError(
                f"{name}, columns {one} and {other}",
                f"{one} lies {constant:.6g} mm beside {other} in all rows, within {scatter:.2g} mm: zeros that differ",
                f"Give both from the same zero: subtract {constant:.6g} mm from {one}, or add it to {other}",
            )
        own = frame[joint.name] if joint.name in frame else (first + second) / 2
        frame = frame.drop(columns=[*joint.drives]).assign(**{joint.name: own, joint.difference: first - second})
    return frame


def in_step(table: pd.DataFrame, machine: Machine) -> tuple[pd.DataFrame, list[str]]:
    """Commands with the drives of each joint in step unless stated otherwise; notes where an effect depends on them."""
    notes = []
    for joint in machine.joints:
        if not joint.drives or (joint.difference in table and table[joint.difference].notna().all()):
            continue
        given = table[joint.difference] if joint.difference in table else pd.Series(np.nan, table.index)
        table = table.assign(**{joint.difference: given.fillna(0.0)})
        if any(joint.difference in spec.options.values() for spec in machine.effects):
            notes.append(f"the drives {' and '.join(joint.drives)} of {joint.name} are taken to be in step")
    return table, notes


def check_series(frame: pd.DataFrame, machine: Machine, name: str) -> list[str]:
    """Refuse two drives of one axis that the machine declares in series, as if one carried the other.

    Their columns are equal and the tool moved as far as one of them. Without measured points to decide, a note.

    Raises
    ------
    InputError
        There are two such joints.
    """
    rows = frame[frame["joint"] == ""] if "joint" in frame else frame
    axes, notes = directions(machine.elements), []
    for one, other in combinations([j for j in machine.joints if j.type == "prismatic"], 2):
        sense = float(axes[one.name] @ axes[other.name])
        if abs(sense) < 1 - 1e-6 or len(rows) < FEWEST_DRIVE_ROWS:
            continue
        first, second = rows[one.name].to_numpy(), rows[other.name].to_numpy() * round(sense)
        way, apart = float(np.ptp(first)), float(np.ptp(first - second))
        if not apart < SAME_MOTION_SHARE * way:
            continue
        held = rows.assign(**{other.name: float(np.median(rows[other.name]))})
        series, single = _misfit(rows, rows, machine), _misfit(held, rows, machine)
        label = "".join(a for a, b in zip(one.name, other.name, strict=False) if a == b).rstrip("_") or one.name
        cure = (
            f"Declare one joint: {{joint: {label}, type: prismatic, axis: ..., travel: [{one.travel[0]:g}, "
            f"{one.travel[1]:g}], drives: [{one.name}, {other.name}]}}; the difference of the two becomes the channel "
            f"w_sync_{label}, by which the effect of racking is known"
        )
        found = f"{one.name} = {other.name} within {max(apart, 0.001):.2g} mm over {way:.4g} mm"
        if series is None or single is None:
            notes.append(f"{found}, in series; if they are two drives of one axis: {cure[0].lower()}{cure[1:]}")
        elif single < series / SINGLE_DRIVE_GAIN:
            raise InputError(
                f"{name}, columns {one.name} and {other.name}",
                f"{found}, and the tool went as far as one of them: two drives of one axis, which the machine has in "
                "series",
                cure,
            )
    return notes


def _misfit(commands: pd.DataFrame, rows: pd.DataFrame, machine: Machine) -> float | None:
    """Median difference (mm) of nominal and measured distances from row to row; None with too few measured points."""
    from errormodel.chain import Chain

    names = [n for n in MEASURED if n in rows]
    seen = rows[names].notna().all(axis=1).to_numpy()
    if len(names) < len(MEASURED) or seen.sum() < FEWEST_DRIVE_ROWS:
        return None
    part = commands[seen]
    tool = [
        part[n].fillna(value).to_numpy() if n in part else np.full(len(part), value)
        for n, value in zip(TOOL_COLUMNS, machine.tool, strict=True)
    ]
    joints = [part[j.name].to_numpy() for j in machine.joints]
    columns: list[Array] = [np.ascontiguousarray(c, dtype=np.float64) for c in (*joints, *tool)]
    chain = Chain(Machine(machine.name, machine.elements, machine.tool))
    nominal = chain.kernel("nominal", outputs=(0, 1, 2))(columns).T
    measured = rows.loc[seen, names].to_numpy(dtype=np.float64)
    went, way = (np.linalg.norm(np.diff(points, axis=0), axis=1) for points in (nominal, measured))
    return float(np.median(np.abs(went - way)))
