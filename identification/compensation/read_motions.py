"""Surveys of single-joint error motions, prepared for compensation: joints measured, positions, held-out residuals.

Positions in mm and rad; error motions at the tool's tip in mm.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from errormodel.controllers.setup import Setup
from errormodel.conventions import MOTIONS, TRANSLATIONS
from errormodel.exceptions import InputError
from errormodel.machine import Machine
from identification.compensation.field import Field

if TYPE_CHECKING:
    import pandas as pd

    from identification.compensation.rows import Rows


def joints_read(table: pd.DataFrame) -> dict[str, list[str]] | None:
    """Error motions measured of each joint, of a survey of error motions only; None for any other survey."""
    if "joint" not in table or table["joint"].isna().any():
        return None
    out: dict[str, list[str]] = {}
    for name, rows in table[table["role"] == "fit"].groupby("joint", sort=False):
        out[str(name)] = [m for m in MOTIONS if rows.filter(like=f"residual_{m}_").notna().to_numpy().any()]
    return out


def placed(table: pd.DataFrame, machine: Machine, read: Collection[str]) -> pd.DataFrame:
    """Complete rows that concern one joint with positions of all joints.

    Joints that were measured elsewhere are placed in the middle of their measured range, the others at the median of
    their positions or in the middle of their travel.
    """
    table = table.copy()
    for joint in machine.joints:
        given = table[joint.name].to_numpy(dtype=np.float64)
        own = given[(table["joint"] == joint.name).to_numpy()] if joint.name in read else given[np.isfinite(given)]
        if joint.name in read:
            table[joint.name] = np.where(np.isnan(given), (own.min() + own.max()) / 2, given)
        else:
            table[joint.name] = float(np.median(own)) if len(own) else sum(joint.travel) / 2
    return table


def known_at_tip(folder: Path, read: Mapping[str, Sequence[str]]) -> list[str]:
    """Joints whose errors at the tool follow from the measured error motions.

    Raises
    ------
    InputError
        There is no such joint, since only angles were measured.
    """
    known = [joint for joint, motions in read.items() if any(m in TRANSLATIONS for m in motions)]
    if not known:
        found = f"angles of {' and '.join(read)} and no displacement: how far the tool moves by them is not known"
        cure = "Read dx, dy or dz of these joints as well, or measure mx my mz, and fit"
        raise InputError(str(folder), found, f"{cure} (tables correct linear axes, and no rotary one)")
    return known


def motion_rows(field: Field, table: pd.DataFrame, read: Mapping[str, Sequence[str]]) -> Rows | None:
    """Held-out residuals of error motions, transferred to the tool's tip.

    Each run of a joint has a zero of its own, which serves as its frame. None if there are too few rows of each joint.
    """
    from identification.compensation.rows import FEWEST_HELD_OUT, Rows, commands

    q, came, tools = commands(table, field.chain.machine)
    left, known = np.zeros((len(table), 3)), np.zeros(len(table), dtype=bool)
    for k, joint in enumerate(field.joints):
        names = [f"heldout_{m}_{'um' if m in TRANSLATIONS else 'urad'}" for m in read.get(joint.name, ())]
        keep = ((table["joint"] == joint.name) & table[names].notna().any(axis=1)).to_numpy(dtype=bool)
        if not names or keep.sum() < FEWEST_HELD_OUT:
            continue
        known |= keep
        motions = np.zeros((int(keep.sum()), 6))
        for motion, name in zip(read[joint.name], names, strict=True):
            factor = 1e-3 if motion in TRANSLATIONS else 1e-6
            motions[:, MOTIONS.index(motion)] = factor * table[name].fillna(0.0).to_numpy(dtype=np.float64)[keep]
        left[keep] = np.einsum("nim,nm->ni", field.levers(q[keep])[0][:, :, 6 * k : 6 * k + 6], motions)
    runs, joints = (table[c].astype(str).to_numpy(dtype=object)[known] for c in ("run", "joint"))
    what = f"{known.sum()} rows left out of the fit in blocks"
    rows = Rows(q[known], came[known], tools[known], left[known], runs, what, joints)
    return rows if len(rows) else None


def notes_on_motions(setup: Setup, read: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Notes on errors that readings of error motions do not determine."""
    for axis in setup.axes:
        motions = read.get(axis.joint, ())
        turns = [m for m in motions if m not in TRANSLATIONS]
        if not motions:
            yield f"nothing was read of {axis.joint}: no tables for its errors"
        elif len(turns) == len(motions):
            yield f"of {axis.joint} only angles were read ({' '.join(turns)}): no tables for them without dx, dy or dz"
        elif turns:
            yield (
                f"{' '.join(turns)} of {axis.joint} act at the tool by the lever from the frame of {axis.joint}: dx dy "
                "dz must have been read there"
            )
    yield "squareness does not show in error motions of single joints: it is not corrected"
