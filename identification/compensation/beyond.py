"""Corrected commands beyond what was measured: how far the model is carried on there, and which rows lie there.

Tables end where they end, and controls hold their edges. Commands that are corrected themselves follow the model: that
of an arm of constant errors holds at any angle, and the correction of an edge would be wrong by what the arm turns.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from errormodel.arrays import Array, Mask
from errormodel.channels import root
from errormodel.controllers.base import EDGE_HOLDS
from errormodel.effects import make
from errormodel.machine import Joint
from identification.compensation.volume import Volume
from identification.results.stored_fit import StoredFit
from identification.uncertainty.measured_range import RANGE_MARGIN_SHARE, farthest_beyond


def carried_on(volume: Volume) -> Volume:
    """The same volume, whose correction beyond it is the model's as far as that may be carried on.

    Without end along joints that no error depends on. Along other rotary joints, whose turn moves errors, for the share
    of the measured range that predictions are carried on without a note. Along other linear joints the edge's
    correction is held: a slide's error motions beyond it are not known, and its geometry hardly changes.
    """
    constant = np.array([not _varies(volume, j) for j in volume.field.joints])
    moved = volume.high > volume.low
    margin = np.where(volume.field.rotary, RANGE_MARGIN_SHARE * (volume.high - volume.low), 0.0)
    further = np.where(moved, np.where(constant, np.inf, margin), 0.0)
    return replace(volume, held=(volume.low - further, volume.high + further))


def _varies(volume: Volume, joint: Joint) -> bool:
    """Whether an error depends on the position of a joint."""
    machine = volume.field.chain.machine
    effects = (c for spec in machine.effects for c in make(spec).channels(machine))
    play = f"play({joint.name},"
    return any(b.kind != "none" for b in joint.models.values()) or any(
        root(c) == joint.name or c.startswith(play) for c in effects
    )


def region_words(volume: Volume) -> str:
    """What the correction is beyond the measured volume."""
    names = np.array([j.name for j in volume.field.joints])
    high, moved = volume.ends[1], volume.high > volume.low
    free, part = moved & np.isinf(high), np.isfinite(high) & (high > volume.high)
    words = [
        f"along {', '.join(names[which])}{how}"
        for which, how in ((free, ", on which no error depends"), (part, f" by {RANGE_MARGIN_SHARE:.0%} of its range"))
        if which.any()
    ]
    if not words:
        return EDGE_HOLDS
    held = "" if free[moved].all() else "; else the correction of the edge is held"
    return f"beyond it the model is carried on {', and '.join(words)}{held}"


def passes(volume: Volume, q: Array) -> Mask:
    """Joints (joints,) that commands q (n, joints) bring beyond both ends of what the correction follows."""
    low, high = volume.ends
    return np.asarray((q < low).any(axis=0) & (q > high).any(axis=0))


def is_rows(name: str) -> bool:
    """Whether a programme is a table of commands, whose rows are positions to be reached one after the other."""
    return name.lower().endswith(".csv")


def rows_beyond(fit: StoredFit, volume: Volume, name: str, q: Array) -> Iterator[str]:
    """What comes first of commands q (n, joints), mm and rad, that lie beyond what was measured, joint by joint.

    Parameters
    ----------
    name : the programme; of a CSV the commands are its rows, by which they are named.
    """
    import pandas as pd

    rows = is_rows(name)
    joints = [j.name for j in volume.field.joints]
    table = pd.DataFrame(q, columns=joints).assign(row=np.arange(1, len(q) + 1))
    ranges = {n: r for n, r in fit.data.get("covered", {}).items() if n in joints}
    for found in farthest_beyond(fit.chain, ranges, table):
        k = joints.index(found.name)
        ends = volume.field.outward(np.array(volume.ends))[:, k]
        held = bool(np.isfinite(ends).all())
        there = (
            f"Beyond {ends[0]:.6g} to {ends[1]:.6g}{found.unit} the correction of the edge is held"
            if held
            else "There the model is carried on unproven"
        )
        where = f" (row {found.at + 1})" if rows else ""
        yield (
            f"FIRST: {found.count} of the {len(q)} {'rows' if rows else 'positions'} of {name} "
            f"lie{'s' * (found.count == 1)} {found.words}{where}. {there}, and no figure here is of such places"
        )
