"""A survey of error motions only, as a compensation sees it: what is known at the tool, and what is left."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from errormodel.controllers.setup import Setup
from errormodel.conventions import MOTIONS, TRANSLATIONS
from errormodel.exceptions import InputError
from identification.compensation.field import Field
from identification.compensation.rows import FEWEST_HELD_OUT, Rows, commands, conditions_in

if TYPE_CHECKING:
    import pandas as pd


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


def several_zeros(values: Mapping[str, float], read: Mapping[str, Sequence[str]]) -> bool:
    """Whether an error motion was read from more than one zero: what moves the zero itself then does not show."""
    return any(
        sum(i.startswith(f"zero[{joint}, run ") and i.endswith(f"].{motion}") for i in values) > 1
        for joint, motions in read.items()
        for motion in motions
    )


def motion_rows(field: Field, table: pd.DataFrame, read: Mapping[str, Sequence[str]]) -> Rows | None:
    """Held-out residuals of error motions, transferred to the tool's tip.

    Each run of a joint has a zero of its own, which serves as its frame. None if there are too few rows of each joint.
    """
    q, came, tools = commands(table, field.chain.machine)
    left, known = np.zeros((2, len(table), 3)), np.zeros(len(table), dtype=bool)
    for k, joint in enumerate(field.joints):
        names = [f"heldout_{m}_{'um' if m in TRANSLATIONS else 'urad'}" for m in read.get(joint.name, ())]
        keep = ((table["joint"] == joint.name) & table[names].notna().any(axis=1)).to_numpy(dtype=bool)
        if not names or keep.sum() < FEWEST_HELD_OUT:
            continue
        known |= keep
        levers = field.levers(q[keep])[0][:, :, 6 * k : 6 * k + 6]
        for part, kind in zip(left, ("heldout", "residual"), strict=True):
            motions = np.zeros((int(keep.sum()), 6))
            for motion, name in zip(read[joint.name], names, strict=True):
                factor = 1e-3 if motion in TRANSLATIONS else 1e-6
                column = table[name.replace("heldout", kind, 1)].fillna(0.0)
                motions[:, MOTIONS.index(motion)] = factor * column.to_numpy(dtype=np.float64)[keep]
            part[keep] = np.einsum("nim,nm->ni", levers, motions)
    runs, joints = (table[c].astype(str).to_numpy(dtype=object)[known] for c in ("run", "joint"))
    what = f"{known.sum()} rows left out in blocks, less run means"
    held, seen = left[:, known]
    own = {name: values[known] for name, values in conditions_in(field.chain, table).items()}
    rows = Rows(q[known], came[known], tools[known], held, runs, what, joints, seen, own)
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
