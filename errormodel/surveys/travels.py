"""Comparison of commanded positions with the travels: notes on poses outside, and on another zero or sign."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from errormodel.machine import Joint, Machine

Array = NDArray[np.float64]

_OUTSIDE_SHARE = 0.5  # share of poses outside a travel from which on another zero or sign is suggested; by judgement
# share of the travel that the positions must cover for that; by judgement: fewer may be one place beyond it
_FILLED_SHARE = 0.1


def travel_notes(table: pd.DataFrame, machine: Machine) -> Iterator[str]:
    """Notes on joints that are commanded beyond their travel: number of poses, and the farthest."""
    for joint in machine.joints:
        low, high = joint.travel
        q = table[joint.name].to_numpy()
        beyond = np.fmax(low - q, q - high)
        outside = beyond > 1e-6 * (high - low)
        if outside.any():
            worst = table.loc[int(np.nanargmax(beyond)), [joint.name, "file", "row"]]
            unit, scale = ("mm", 1.0) if joint.type == "prismatic" else ("deg", 180 / math.pi)
            count = f"{outside.sum()} pose{'s are' if outside.sum() > 1 else ' is'}"
            clear = outside.mean() > _OUTSIDE_SHARE and np.nanmax(q) - np.nanmin(q) > _FILLED_SHARE * (high - low)
            shift = _other_zero(joint, q, scale) if clear else None
            zero = "" if shift is None else f"; {_mended_travel(joint, q, shift, bool(outside.all()))}"
            yield (
                f"{count} outside the travel of {joint.name}, {low * scale:.6g} to {high * scale:.6g} {unit}; "
                f"the farthest at {worst[joint.name] * scale:.6g} {unit} ({worst['file']}, row {worst['row']}){zero}"
            )


def _mended_travel(joint: Joint, q: Array, shift: float, every: bool) -> str:
    """Correction where most positions are outside a travel that a shift (mm or deg) brings all of them into."""
    unit, scale = ("mm", 1.0) if joint.type == "prismatic" else ("deg", 180 / math.pi)
    low, high = joint.travel
    same = joint.type == "rotary" and shift % 360 == 0  # full turns
    wrong = ". Levers and scales are wrong until this is mended" if every and not same else ""
    slack = 1e-6 * (high - low)
    if np.nanmin(-q) > low - slack and np.nanmax(-q) < high + slack:
        return f"the sign of {joint.name} is wrong, or its zero: see which at the machine{wrong}"
    sure = "" if every else "it may be that "
    travel = f"[{low * scale - shift:.6g}, {high * scale - shift:.6g}]"
    return (
        f"{sure}{joint.name} counts from another zero: then add {shift:.6g} {unit} to its column, or write travel: "
        f"{travel} in machine.yaml{wrong}"
    )


def _other_zero(joint: Joint, q: Array, scale: float) -> float | None:
    """Roundest constant (mm or deg) that brings all positions into the travel; None if none does."""
    least = (joint.travel[0] - float(np.nanmin(q))) * scale
    most = (joint.travel[1] - float(np.nanmax(q))) * scale
    slack = 1e-6 * (joint.travel[1] - joint.travel[0]) * scale
    if most < least - slack or least <= 0 <= most:
        return None
    for step in (1000, 500, 360, 180, 100, 90, 50, 10, 5, 1):
        nearest = math.ceil((least - slack) / step) * step
        if nearest and nearest <= most + slack:
            return float(nearest)
    return (least + most) / 2
