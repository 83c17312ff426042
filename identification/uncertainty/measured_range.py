"""Range of each joint and channel covered by the fitted rows, and notes on points outside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from errormodel.chain import Chain
from errormodel.channels import UNITS_OF_CHANNELS, root
from errormodel.effects import make
from errormodel.simulation import outward

if TYPE_CHECKING:
    import pandas as pd

RANGE_MARGIN_SHARE = 0.1  # extrapolation beyond the measured range, as a share of it, that gets no note; by judgement
IDLE_KELVIN = 1.0  # of a temperature that nothing depends on, beyond which a machine moves by more than noise
FULL_TURN_DEG = 324.0  # range of a rotary joint, 90 % of a turn, from which nothing counts as outside; by judgement
_BY_THE_CLOCK = ("lag(", "initial(", "rate(")  # channels that follow from the times of the rows, too
# Prefixes of channels that have no range, or whose unidentified share is in the uncertainty of `predict`
_UNRANGED_PREFIXES = ("dir_", "run(", "point_", "tool_")


def covered(chain: Chain, table: pd.DataFrame) -> dict[str, list[float]]:
    """Lowest and highest value of each joint, channel of the model or of use: mm, deg, s, degC as in files."""
    table = outward(table, chain.machine)
    use = (str(c) for c in table.columns if str(c).startswith("T_") or c in UNITS_OF_CHANNELS)
    names = dict.fromkeys((*(j.name for j in chain.machine.joints), *map(root, chain.channels), *use))
    out = {}
    for name in names:
        if name == "row" or name.startswith(_UNRANGED_PREFIXES) or name not in table:
            continue
        values = table[name].to_numpy(dtype=np.float64)
        if np.isfinite(values).any():
            out[name] = [float(np.nanmin(values)), float(np.nanmax(values))]
    return out


def beyond_notes(chain: Chain, ranges: Mapping[str, list[float]], table: pd.DataFrame) -> Iterator[str]:
    """Notes on joints and channels whose values lie outside the fitted range: number of points and farthest row.

    The stated uncertainty is that of the parameters and assumes that the model holds there.

    Parameters
    ----------
    ranges : lowest and highest fitted value by name, as `covered` returns them.
    table : points to predict, mm and rad.
    """
    table = outward(table, chain.machine)
    kinds = {j.name: j.type for j in chain.machine.joints}
    acting = {*kinds, *map(root, chain.channels)}
    if any(name.startswith(_BY_THE_CLOCK) for name in chain.channels):
        acting.add("time")
    for name, (low, high) in ranges.items():
        if name not in table or (kinds.get(name) == "rotary" and high - low >= FULL_TURN_DEG):
            continue
        values = table[name].to_numpy(dtype=np.float64)
        beyond = np.fmax(low - values, values - high)
        margin = IDLE_KELVIN if name.startswith("T_") and name not in acting else 1e-9 * max(abs(low), abs(high))
        outside = beyond > RANGE_MARGIN_SHARE * (high - low) + margin
        if not outside.any():
            continue
        at = int(np.nanargmax(np.where(outside, beyond, np.nan)))
        row = table.iloc[at]
        unit = {"prismatic": " mm", "rotary": " deg"}.get(kinds.get(name, ""), _unit(name))
        count = f"{outside.sum()} point{'s lie' if outside.sum() > 1 else ' lies'}"
        yield (
            f"{count} beyond what was measured of {name}, {low:.6g} to {high:.6g}{unit}; the farthest at "
            f"{values[at]:.6g}{unit} ({row['file']}, row {row['row']}). There {_there(chain, name, name in acting)}"
        )


def _there(chain: Chain, name: str, acts: bool) -> str:
    """What the model does beyond what was measured of a channel: what has no name does not go on."""
    if not acts:
        return "nothing in the model depends on it, and what it does to the machine was not seen"
    machine = chain.machine
    effects = [make(spec) for spec in machine.effects]
    own = [e for e in effects if name in {root(c) for c, *_ in e.within}]
    others = [e for e in effects if e not in own and name in set(map(root, e.channels(machine)))]
    tends = f"what has no name ({', '.join(dict.fromkeys(f'{e.effect} at {e.where}' for e in own))})"
    words = [f"{tends} tends to its mean, and its uncertainty grows to its size"] if own else []
    if others or not own or name in {j.name for j in machine.joints}:
        what = "the rest of the model" if own else "the model"
        words.append(f"{what} is carried on unproven, and its uncertainty holds only if it goes on as it was")
    return "; ".join(words)


def _unit(name: str) -> str:
    """Unit of a channel for messages."""
    return " degC" if name.startswith("T_") else f" {UNITS_OF_CHANNELS[name]}" if name in UNITS_OF_CHANNELS else ""
