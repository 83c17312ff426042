"""Range of each joint and channel covered by the fitted rows, and notes on points outside it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array
from errormodel.chain import Chain
from errormodel.channels import UNITS_OF_CHANNELS, root
from errormodel.effects import make
from errormodel.exceptions import MISTYPED, InputError, alike, enumerated
from errormodel.simulation import outward
from errormodel.surveys.temperatures import HEATED, ZERO_DEGC, in_kelvin
from identification.uncertainty.unseen_expansion import at_constant_size

if TYPE_CHECKING:
    import pandas as pd

RANGE_MARGIN_SHARE = 0.1  # extrapolation beyond the measured range, as a share of it, that gets no note; by judgement
IMPOSSIBLE_KELVIN = 100.0  # beyond all that was recorded, of what is not heated on purpose: another unit; by judgement
IDLE_KELVIN = 1.0  # of a temperature that nothing depends on, beyond which a machine moves by more than noise
TURN = 2 * np.pi
# Share of a turn from which a rotary joint counts as measured all round, however fine its steps: a tenth is open then,
# as much as gets no note of other joints
ROUND_SHARE = 1 - RANGE_MARGIN_SHARE
STEP_SLACK = 1.1  # of the largest step: positions read from a scale are not quite those of equal steps; by judgement
_BY_THE_CLOCK = ("lag(", "initial(", "rate(")  # channels that follow from the times of the rows, too
# Prefixes of channels that have no range, or whose unidentified share is in the uncertainty of `predict`
_UNRANGED_PREFIXES = ("dir_", "run(", "of(", "point_", "tool_")


def all_round(positions: Array) -> bool:
    """Whether a rotary joint was measured all round, so that nothing lies outside, where it begins a new turn either.

    A turn in n equal steps has no position at its end, which is that at its start. So the part that was left out
    counts as measured where it is no wider than the steps within, which count as measured, too. No gap may be half a
    turn: what has the period of a turn needs three positions.

    Parameters
    ----------
    positions : (n,) rad, in any order; those that are not known are nan.
    """
    known = np.sort(positions[np.isfinite(positions)])
    if len(known) < 2:
        return False
    step, left_out = float(np.diff(known).max()), TURN - float(known[-1] - known[0])
    return left_out <= (1 - ROUND_SHARE) * TURN or (left_out <= STEP_SLACK * step and max(left_out, step) < TURN / 2)


def covered(chain: Chain, table: pd.DataFrame) -> dict[str, list[float]]:
    """Lowest and highest value of each joint, channel of the model or of use: mm, deg, s, degC as in files.

    Of a rotary joint that was measured all round the highest is at least a turn beyond the lowest.
    """
    rotary = [j.name for j in chain.machine.joints if j.type == "rotary" and j.name in table]
    round_ = {name for name in rotary if all_round(table[name].to_numpy(dtype=np.float64))}
    table = outward(table, chain.machine)
    use = (str(c) for c in table.columns if str(c).startswith("T_") or c in UNITS_OF_CHANNELS)
    names = dict.fromkeys((*(j.name for j in chain.machine.joints), *map(root, chain.channels), *use))
    out = {}
    for name in names:
        if name == "row" or name.startswith(_UNRANGED_PREFIXES) or name not in table:
            continue
        values = table[name].to_numpy(dtype=np.float64)
        if np.isfinite(values).any():
            low, high = float(np.nanmin(values)), float(np.nanmax(values))
            out[name] = [low, max(high, low + np.degrees(TURN)) if name in round_ else high]
    return out


@dataclass(frozen=True)
class Beyond:
    """Points beyond the fitted range of a joint or channel, in the units of files.

    Attributes
    ----------
    count : how many; `at` : place of the farthest in the table, and its `value`.
    unit : with a space before it.
    acts : whether anything in the model depends on it.
    """

    name: str
    count: int
    at: int
    value: float
    low: float
    high: float
    unit: str
    acts: bool

    @property
    def words(self) -> str:
        return (
            f"beyond what was measured of {self.name}, {self.low:.6g} to {self.high:.6g}{self.unit}; the farthest at "
            f"{self.value:.6g}{self.unit}"
        )


def beyond_notes(
    chain: Chain, ranges: Mapping[str, list[float]], table: pd.DataFrame, possible: Mapping[str, str]
) -> Iterator[str]:
    """Notes on joints and channels whose values lie outside the fitted range: number of points and farthest row.

    The stated uncertainty is that of the parameters and assumes that the model holds there.

    Parameters
    ----------
    ranges : lowest and highest fitted value by name, as `covered` returns them.
    table : points to predict, mm and rad.
    possible : effects that may depend on channels, in words, by channel.
    """
    for found in farthest_beyond(chain, ranges, table):
        row = table.iloc[found.at]
        count = f"{found.count} point{'s lie' if found.count > 1 else ' lies'}"
        there = _there(chain, found.name, found.acts, possible.get(found.name, ""))
        yield f"{count} {found.words} ({row['file']}, row {row['row']}). There {there}"


def farthest_beyond(chain: Chain, ranges: Mapping[str, list[float]], table: pd.DataFrame) -> Iterator[Beyond]:
    """Joints and channels of points that lie outside the fitted range by more than `RANGE_MARGIN_SHARE` of it.

    Parameters
    ----------
    ranges : lowest and highest fitted value by name, as `covered` returns them.
    table : points, mm and rad.
    """
    table = outward(table, chain.machine)
    kinds = {j.name: j.type for j in chain.machine.joints}
    acting = {*kinds, *map(root, chain.channels)}
    if any(name.startswith(_BY_THE_CLOCK) for name in chain.channels):
        acting.add("time")
    for name, (low, high) in ranges.items():
        if name not in table or (kinds.get(name) == "rotary" and np.radians(high - low) >= ROUND_SHARE * TURN):
            continue
        values = table[name].to_numpy(dtype=np.float64)
        beyond = np.fmax(low - values, values - high)
        margin = IDLE_KELVIN if name.startswith("T_") and name not in acting else 1e-9 * max(abs(low), abs(high))
        outside = beyond > RANGE_MARGIN_SHARE * (high - low) + margin
        if not outside.any():
            continue
        at = int(np.nanargmax(np.where(outside, beyond, np.nan)))
        unit = {"prismatic": " mm", "rotary": " deg"}.get(kinds.get(name, ""), _unit(name))
        yield Beyond(name, int(outside.sum()), at, float(values[at]), low, high, unit, name in acting)


def unrecorded_load(ranges: Mapping[str, list[float]], table: pd.DataFrame) -> Iterator[str]:
    """A note on loads of points, where the fitted rows have none.

    Parameters
    ----------
    ranges : as `covered` returns them; none of a fit that has not kept them.
    """
    if not ranges or "load" in ranges or "load" not in table:
        return
    loads = np.abs(table["load"].to_numpy(dtype=np.float64))
    if np.nanmax(loads, initial=0.0) > 0:
        at = int(np.nanargmax(loads))
        yield (
            f"the model knows nothing of the load, {table['load'].iloc[at]:g} kg in row {table['row'].iloc[at]}: the "
            "fitted survey has no column load. What it does to the machine is in no prediction, nor in the "
            "uncertainty. Record the load in every row of a survey with several, and fit that"
        )


def refuse_far_temperatures(ranges: Mapping[str, list[float]], table: pd.DataFrame) -> None:
    """InputError about temperatures so far beyond the fitted range that they are in another unit.

    Parameters
    ----------
    ranges : lowest and highest fitted value by name, as `covered` returns them.
    table : points to predict.
    """
    for name, (low, high) in ranges.items():
        if not name.startswith("T_") or name not in table or HEATED.search(name):
            continue
        values = table[name].to_numpy(dtype=np.float64)
        beyond = np.nan_to_num(np.fmax(low - values, values - high))
        if beyond.max(initial=0.0) <= IMPOSSIBLE_KELVIN:
            continue
        at = int(np.argmax(beyond))
        file, row = table["file"].iloc[at], table["row"].iloc[at]
        recorded = f"where {low:.4g} to {high:.4g} degC were recorded"
        if in_kelvin(name, values[[at]]):
            celsius = f"; in K it would be {values[at] - ZERO_DEGC:.4g} degC"
            cure = (
                f"If the rows are in K, write them a survey.yaml with errormodel: 1, files: [{{path: {file}}}] and "
                "units: {temperature: K}, and predict at that"
            )
        elif in_kelvin(name, np.array([low, high])):
            celsius = ""
            cure = "If the survey was in K, write units: {temperature: K} in its survey.yaml and fit it again"
        else:
            celsius, cure = "", "Write temperatures in degC, as they were recorded"
        raise InputError(f"{file}, row {row}, column {name}", f"{values[at]:.5g} degC, {recorded}{celsius}", cure)


def unused_temperatures(ranges: Mapping[str, list[float]], table: pd.DataFrame) -> Iterator[str]:
    """A note on temperatures of points, where the fitted rows have none at all.

    Parameters
    ----------
    ranges : as `covered` returns them; none of a fit that has not kept them.
    """
    names = [str(c) for c in table if str(c).startswith("T_") and table[c].notna().any()]
    if ranges and names and not any(name.startswith("T_") for name in ranges):
        yield (
            f"{enumerated(names)} {'is' if len(names) == 1 else 'are'} not used: the survey was fitted without "
            "temperatures. What they do to the machine is in no prediction, nor in the uncertainty. Record them in the "
            "survey's rows, and fit that"
        )


def unrecorded_temperatures(
    ranges: Mapping[str, list[float]], table: pd.DataFrame, said: Collection[str]
) -> Iterator[str]:
    """A note on points without temperatures, where the fitted rows have some.

    Parameters
    ----------
    ranges : as `covered` returns them.
    said : columns of which other notes say that they are missing.
    """
    names = [name for name in ranges if name.startswith("T_")]
    if any(name in table and table[name].notna().any() for name in names):
        return
    if not (names := [name for name in names if name not in said]):
        return
    recorded = enumerated([f"{n} {ranges[n][0]:.4g} to {ranges[n][1]:.4g} degC" for n in names])
    near = {n: alike(n, (str(c) for c in table if str(c).startswith("T_")), MISTYPED) for n in names}
    hints = [f"{column} is perhaps {name}" for name, column in near.items() if column]
    many = len(names) > 1
    yield (
        f"the recording had {recorded}, and the rows have no such column{'s' * many}"
        f"{f' ({enumerated(hints)})' if hints else ''}: predicted as at the temperatures of the survey. What other "
        f"temperatures do is not in the uncertainty. Add the column{'s' * many}"
    )


def _there(chain: Chain, name: str, acts: bool, possible: str) -> str:
    """What the model does beyond what was measured of a channel: what has no name does not go on."""
    if not acts and possible:
        return (
            f"the likeliest model does not depend on it, but {possible} may: what that would change, carried on "
            "unproven, is in the uncertainty by its probability"
        )
    if not acts:
        grow = at_constant_size(chain.machine) if name.startswith("T_") else []
        known = f"; the expansion of {', '.join(grow)} that it may cause is in the uncertainty" if grow else ""
        return f"nothing in the model depends on it, and what it does to the machine was not seen{known}"
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
