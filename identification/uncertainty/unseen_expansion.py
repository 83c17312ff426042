"""Expansion of linear axes in rows that are warmer or colder than the recording, which does not show it.

Scales and screws expand by nothing (glass ceramic, or compensated), by 8 (glass) or by 12 ppm per kelvin (steel), each
as likely beforehand. A diagnosis bounds that by its rows as far as they show it: not at one temperature, nor where an
axis moved once while it warmed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from errormodel.arrays import Array
from errormodel.channels import root
from errormodel.effects import make
from errormodel.effects.shared import STEEL_EXPANSION
from errormodel.machine import Machine
from identification.uncertainty.other_assumption import Predict, half_change

if TYPE_CHECKING:
    import pandas as pd

Expansions: TypeAlias = Mapping[str, Mapping[str, float]]
"""Root mean square coefficient of expansion, 1/K, of a linear axis by a temperature, as a recording leaves it open."""

GLASS_EXPANSION = 8e-6  # 1/K
BEFOREHAND = float(np.sqrt((GLASS_EXPANSION**2 + STEEL_EXPANSION**2) / 3))  # 1/K, root mean square of the three


def at_constant_size(machine: Machine) -> list[str]:
    """Linear axes that no temperature moves in the model."""
    warm = set[str]()
    for effect in map(make, machine.effects):
        if any(root(name).startswith("T_") for name in effect.drivers):
            warm.add(effect.where)
    return [j.name for j in machine.joints if j.type == "prismatic" and j.name not in warm]


def with_unseen_expansion(
    machine: Machine,
    ranges: Mapping[str, list[float]],
    expansions: Expansions,
    table: pd.DataFrame,
    channels: list[Array],
    labels: Array,
    predicted: Array,
    predict: Predict,
) -> Array:
    """Predictions (n, 9) with the expansion that a recording leaves open in their uncertainty.

    It is from the middle of what was measured of a temperature; by one of which nothing is known but its range, from
    the end of that. Whether the scale is held at either end of the travel or in its middle is not known, nor which of
    the temperatures drives it: the variance is the mean over them.

    Parameters
    ----------
    ranges : lowest and highest recorded value by name, mm and degC.
    channels : each (n,), the joints' first; `labels` (n,): of the rows' frames.
    predicted : (n, 9)
        Position, error and standard uncertainty in mm.
    predict : such predictions of other rows, from their channels and labels.
    """
    out, fixed = predicted.copy(), at_constant_size(machine)
    names = [n for n in ranges if n.startswith("T_") and n in table and table[n].notna().any()]
    for number, joint in enumerate(machine.joints):
        if joint.name not in ranges or joint.name not in fixed:
            continue
        known, square = expansions.get(joint.name, {}), np.zeros(len(table))
        for name in names:
            low, high = ranges[name] if name not in known else 2 * [float(np.mean(ranges[name]))]
            values = table[name].to_numpy(dtype=np.float64)
            kelvin = np.nan_to_num(np.fmax(values - high, 0.0) + np.fmax(low - values, 0.0))
            square += (known.get(name, BEFOREHAND) * kelvin) ** 2 / len(names)
        if len(rows := np.flatnonzero(square)):
            at, (first, last) = channels[number][rows], joint.travel
            held = np.hypot(at - (first + last) / 2, (last - first) / np.sqrt(6))  # root mean square distance
            grown = held * np.sqrt(square[rows])
            half = half_change(channels, labels, predicted, predict, rows, {number: at + grown})
            out[rows, 6:] = np.hypot(out[rows, 6:], 2 * half[:, :3])
    return out
