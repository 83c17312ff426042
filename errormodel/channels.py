"""Channels of a survey by name: its columns, and signals derived from them (lagged temperatures, play, direction).

- ``X``: a joint; ``time``, ``feed``, ``load``, ``T_bed``, ``w_sync``: columns as they are.
- ``dir_X``: direction of approach, +1 or -1.
- ``lag(T_bed,600)``: the column after a first-order lag of 600 s.
- ``initial(T_bed,600)``: what such a lag keeps of 1 K in the first row: ``exp(-t/600)``.
- ``play(X,0.01)``: X after a play of 0.01 (mm or rad), in the order of the rows.
- ``run(3)``: 1 in the rows of run 3, else 0, as where no row has a run.
- ``of(points)``: 1 in rows of no observation of single readings, else 0; ``of(L1)``: in those of the observation L1.
- ``row``: number of the row in the fitted file, from 1; rows of test files and of predictions come after it.
- ``speed(X|X,Y,Z|A,C)``: speed of X (mm/s or rad/s, with its sign) as its share of the ``feed`` along the path of the
  linear joints X, Y, Z or, where these stand, of the rotary A, C (`errormodel.path_speed`).
- ``rate(X)``: speed of X (mm/s or rad/s) by the times of the rows: derivative of a spline.
- ``resumed(3600,900)``: time from which the machine worked on after a recording's end at 3600 s, with no steps longer
  than 900 s but rests (`errormodel.machine_rests`).
- ``w_x2 less X``: what the encoder of a second drive, ``w_x2``, reads beyond the position of X, mm.
- ``point_x``: not a column but the nominal position of the chain, mm.

Units: mm, rad, s, degC.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from errormodel.approach import direction
from errormodel.arrays import Array, Index
from errormodel.exceptions import MISTYPED, InputError, alike, enumerated, nearest
from errormodel.machine_rests import RESUMED_CHANNEL, resumed
from errormodel.path_speed import RATE_CHANNEL, SPEED_CHANNEL, clock_speed, path_speed
from errormodel.row_order import label_numbers, measured_order
from errormodel.temperature_courses import by_label, clocks, noise_name, settled

if TYPE_CHECKING:
    import pandas as pd

# Name of a derived channel. A sensor's name may hold commas and brackets: the number follows the last comma.
DERIVED_CHANNEL = re.compile(r"(lag|initial|play)\((.+),([^,()]+)\)", re.DOTALL)
AHEAD_CHANNEL = re.compile(r"(w_.+) less ([^ ]+)", re.DOTALL)
# K between two rows of one clock and time that no noise and no rounded time explains; by judgement
AT_ONCE_KELVIN = 0.5
# columns that must be complete; positions may be missing in rows about another joint
UNITS_OF_CHANNELS = {"time": "s", "feed": "mm/min", "load": "kg"}
OWN_COLUMNS = ("file", "role", "row")  # of a survey's table, which no file has
RECORDS = "T_", "w_"  # prefixes of sensors' columns
# beginnings of the names of columns that have no gaps where an effect needs them
GAPLESS = (*RECORDS, "time", "feed", "load")
POINTS = "of(points)"  # rows of positions, of no observation of single readings
CLOCKS = "time", "row"  # of a survey: times or, where these were not recorded, the order of its rows
# nominal position of the functional point in the reference's axes, mm
POINT_CHANNELS = ("point_x", "point_y", "point_z")


def run_of(name: str) -> str:
    """Label of the run whose rows a channel marks (``run(3)``); else empty."""
    return name[4:-1] if name.startswith("run(") else ""


def channel(table: pd.DataFrame, name: str) -> Array:
    """Return one channel over all rows, (n,).

    Raises
    ------
    InputError
        The survey has no such column, or the column has gaps.
    """
    call = DERIVED_CHANNEL.fullmatch(name)
    if call:
        return _DERIVED[call[1]](table, call[2], float(call[3]))
    if moving := SPEED_CHANNEL.fullmatch(name):
        return speed(table, *moving.groups())
    if moving := RATE_CHANNEL.fullmatch(name):
        return rate(table, moving[1])
    if again := RESUMED_CHANNEL.fullmatch(name):
        return resumed(channel(table, "time"), float(again[1]), float(again[2]))
    if name not in table and (ahead := AHEAD_CHANNEL.fullmatch(name)):
        return channel(table, ahead[1]) - channel(table, ahead[2])
    if name.startswith("dir_"):
        return direction(table, name[4:])
    if name == "row":
        rows = table["row"].to_numpy(dtype=np.float64) if "row" in table else np.arange(1.0, len(table) + 1)
        if "role" not in table:
            return rows
        test = (table["role"] == "test").to_numpy()
        return np.where(test, float(rows[~test].max(initial=0.0)) + np.cumsum(test), rows)
    if name.startswith("run("):
        own = table["run"].astype(str) == name[4:-1] if "run" in table else np.zeros(len(table))
        return np.asarray(own, dtype=np.float64)
    if name.startswith("of("):
        from errormodel.surveys.observations import observed

        return np.asarray(observed(table) == ("" if name == POINTS else name[3:-1]), dtype=np.float64)
    if name not in table:
        raise _missing(table, name, "which an effect of this machine needs")
    values = table[name].to_numpy(dtype=np.float64)
    if name.startswith(GAPLESS) and not np.isfinite(values).all():
        row = int(np.flatnonzero(~np.isfinite(values))[0])
        raise InputError(
            f"{', row '.join(_place(table, row))}, column {name}",
            "no value, though an effect of this machine depends on it",
            "Fill the gap, or take the effect out of machine.yaml",
        )
    return values


def lacking(there: Collection[str], names: Iterable[str]) -> list[str]:
    """Columns that channels need and that are not among those `there`, each once, in the order of their need."""
    needed: dict[str, None] = {}
    for name in names:
        if name.startswith(("dir_", "run(", "of(")) or name in (*POINT_CHANNELS, "row"):
            continue
        needed[root(name)] = None
        if DERIVED_CHANNEL.fullmatch(name) and not name.startswith("play("):
            needed["time"] = None
        if moving := SPEED_CHANNEL.fullmatch(name):
            needed |= dict.fromkeys(joint for group in moving.groups()[1:] for joint in group.split(",") if joint)
    return [name for name in needed if name not in there]


def root(name: str) -> str:
    """Base channel of a derived one: ``T_bed`` of ``lag(T_bed,600)``, ``feed`` of a speed, ``X`` of ``rate(X)``."""
    if ahead := AHEAD_CHANNEL.fullmatch(name):
        return ahead[1]
    if moving := RATE_CHANNEL.fullmatch(name):
        return moving[1]
    if SPEED_CHANNEL.fullmatch(name):
        return "feed"
    if RESUMED_CHANNEL.fullmatch(name):
        return "time"
    call = DERIVED_CHANNEL.fullmatch(name)
    return call[2] if call else name


def follows_sides(name: str) -> bool:
    """Whether a channel depends on directions of approach: these, positions after a play, and speeds."""
    return name.startswith(("dir_", "play(")) or bool(SPEED_CHANNEL.fullmatch(name))


def columns(table: pd.DataFrame, names: Sequence[str]) -> list[Array]:
    """Several channels over all rows, each (n,), with temperatures smoothed over time (`settled`).

    A lagged temperature is taken as recorded, since the lag itself smooths it.

    Raises
    ------
    InputError
        The survey lacks some of their columns: it names all; or one has gaps.
    """
    if len(absent := lacking({*map(str, table)}, names)) > 1:
        cure = f"{_mistyped(table, absent)}Add them. {_found(table)}"
        raise InputError(f"{_place(table, 0)[0]}, header", needed_by_effects(absent), cure)
    smooth = settled(table, {name for name in names if name.startswith("T_")})
    return [channel(smooth if name.startswith("T_") else table, name) for name in names]


def check_one_temperature(table: pd.DataFrame, names: Iterable[str]) -> None:
    """Raise InputError where one clock that runs has two temperatures of a sensor at one time."""
    if "time" not in table or not table["time"].notna().all():
        return
    time = table["time"].to_numpy(dtype=np.float64)
    for name in (n for n in names if n in table and table[n].notna().all()):
        values = table[name].to_numpy(dtype=np.float64)
        for rows in by_label(clocks(table, name)):
            order = rows[np.lexsort((values[rows], time[rows]))]
            first = np.concatenate([[True], np.diff(time[order]) > 0])
            lowest = order[np.maximum.accumulate(np.where(first, np.arange(len(order)), 0))]
            row, other = order[k := int(np.argmax(values[order] - values[lowest]))], lowest[k]
            if np.ptp(time[rows]) > 0 and values[row] - values[other] > AT_ONCE_KELVIN:
                also = (
                    f"row {_place(table, int(other))[1]} has {values[other]:g} degC at the same time, {time[row]:g} s"
                )
                raise InputError(
                    f"{', row '.join(_place(table, int(row)))}, column {name}",
                    f"{values[row]:g} degC, where {also}: one clock has one temperature at a time",
                    "If each row is a case of its own, in which the machine has settled, give all of them one time; "
                    "if they belong to several recordings, give each a run of its own, with times from its beginning",
                )


def needed_by_effects(names: Sequence[str]) -> str:
    """What is found where columns of effects are missing."""
    shown = [f"'{n}'{f' ({UNITS_OF_CHANNELS[n]})' if n in UNITS_OF_CHANNELS else ''}" for n in names]
    if len(shown) == 1:
        return f"no column {shown[0]}, which an effect of this machine needs"
    return f"no columns {enumerated(shown)}, which effects of this machine need"


def _found(table: pd.DataFrame) -> str:
    """The columns with values, those left out that a survey has in any case."""
    every = {*OWN_COLUMNS, "run", "tool_x", "tool_y", "tool_z", *map(noise_name, map(str, table))}
    own = [c for c in table if c not in every and table[c].notna().any()]
    return f"Found: {', '.join(map(str, own))}"


def _mistyped(table: pd.DataFrame, names: Sequence[str]) -> str:
    """Which columns may be meant for some that are missing; nothing where none is like them."""
    own = [c for c in map(str, table.columns) if c not in OWN_COLUMNS]
    near = {n: alike(n, own, MISTYPED) for n in names}
    hints = [f"'{column}' for '{name}'" for name, column in near.items() if column]
    return f"Did you mean {enumerated(hints)}? " if hints else ""


def _missing(table: pd.DataFrame, name: str, why: str, how: str = "") -> InputError:
    """A column that an effect needs is not there; `how` it could be written."""
    unit = UNITS_OF_CHANNELS.get(name)
    kind = name[:2] if name.startswith(RECORDS) else ""  # in place of a sensor another sensor may have been meant
    columns = [c for c in map(str, table.columns) if c not in OWN_COLUMNS and c.startswith(kind)]
    add = f"{_mistyped(table, [name])}Add it ({unit}{how}). {_found(table)}"
    cure = add if unit else nearest(name, columns) or "Add it"
    return InputError(f"{_place(table, 0)[0]}, header", f"no column '{name}', {why}", cure)


def _place(table: pd.DataFrame, row: int) -> tuple[str, str]:
    """File and data row (from 1) of a row of a survey's table, for messages."""
    if "file" not in table:
        return "survey", str(row + 1)
    return str(table["file"].iloc[row]), str(table["row"].iloc[row])


def speed(table: pd.DataFrame, joint: str, linear: str, turning: str) -> Array:
    """Speed of a joint (n,), mm/s or rad/s: its share of the feed on the path of joints named with commas between."""
    names = [n for n in (*linear.split(","), *turning.split(",")) if n]
    order = measured_order(table)
    time = channel(table, "time") if "time" in table else np.full(len(table), np.nan)
    out = np.empty(len(table))
    out[order] = path_speed(
        np.column_stack([channel(table, n) for n in names])[order],
        np.array([n in linear.split(",") for n in names]),
        channel(table, "feed")[order],
        np.column_stack([direction(table, n) for n in names])[order],
        time[order],
        label_numbers(table, ["file", "run"])[order],
    )[:, names.index(joint)]
    return out


def rate(table: pd.DataFrame, joint: str) -> Array:
    """Speed of a joint (n,), mm/s or rad/s, by the times at which a run's rows were measured."""
    if "time" not in table:
        why = f"by which an effect of this machine takes the speed of {joint}"
        raise _missing(table, "time", why, "; at poses at rest one and the same time in every row")
    order, out = measured_order(table), np.empty(len(table))
    series = label_numbers(table, ["file", "run"])[order]
    out[order] = clock_speed(channel(table, joint)[order], channel(table, "time")[order], series)
    return out


def lag(table: pd.DataFrame, name: str, tau: float) -> Array:
    """Column after a first-order lag with time constant `tau` (s), in equilibrium at its first value, clock by clock.

    Rows at one time are independent states, each in equilibrium.
    """
    values, time = channel(table, name), channel(table, "time")
    out = values.copy()
    for rows in _by_clock(table, name):
        out[rows] = lagged(time[rows], values[rows], tau)
    return out


def initial(table: pd.DataFrame, name: str, tau: float) -> Array:
    """What a first-order lag keeps of 1 K at its first row, clock by clock; nothing of rows at one time, long settled.

    It is the lag's free response: what differs at first from the column fades with the time constant `tau` (s).
    """
    time = channel(table, "time")
    out = np.zeros(len(time))
    for rows in _by_clock(table, name):
        out[rows] = np.exp(-(time[rows] - time[rows].min()) / tau)
    return out


def _by_clock(table: pd.DataFrame, name: str) -> list[Index]:
    """Indices of the rows of each clock of a column (`clocks`) that runs; rows at one time are no series."""
    time = channel(table, "time")
    return [rows for rows in by_label(clocks(table, name)) if np.ptp(time[rows]) > 0]


def lagged(time: Array, values: Array, tau: float) -> Array:
    """Exact first-order lag of a signal (n,), or of several (n, k), at unevenly spaced times (any order), (n,).

    The signal is linear between the times. Over a step h the lag keeps ``exp(-h/tau)`` of its value and takes the rest
    from the line.
    """
    order = np.argsort(time, kind="stable")
    x = values[order]
    steps, rise = np.diff(time[order]) / tau, np.diff(x, axis=0)
    kept = np.exp(-steps)
    slope = np.where(steps > 0, -np.expm1(-steps) / np.where(steps > 0, steps, 1.0), 1.0)
    taken = np.concatenate([x[:1], x[1:] - (kept * x[:-1].T).T - (slope * rise.T).T])
    out = np.empty_like(x)
    out[order] = fading(kept, taken)
    return out


def fading(kept: Array, taken: Array) -> Array:
    """Solution (n,) or (n, k) of the recursion ``x[i] = kept[i-1] x[i-1] + taken[i]``: a bidiagonal system."""
    from scipy.linalg import solve_banded

    bands = np.vstack([np.ones(len(taken)), np.append(-kept, 0.0)])
    return np.asarray(solve_banded((1, 0), bands, taken))


def plays_among(names: Iterable[str]) -> Iterator[tuple[str, str, float]]:
    """Positions after a play among channels: name, joint and width (mm or rad)."""
    for name in names:
        call = DERIVED_CHANNEL.fullmatch(name)
        if call and call[1] == "play":
            yield name, call[2], float(call[3])


def play(table: pd.DataFrame, name: str, width: float) -> Array:
    """Position of a joint after a play of full `width` (mm or rad), in the order of the rows."""
    q = channel(table, name)
    start = direction(table, name)[0]
    low, high = q - width / 2, q + width / 2
    # each row clamps the previous value into [low, high]; clamps compose into clamps, which allows a scan by doubling
    step = 1
    while step < len(q) and (low[step:] < high[step:]).any():  # where both are one, nothing before matters any more
        earlier_low, earlier_high = low[:-step], high[:-step]
        new_low = np.clip(earlier_low, low[step:], high[step:])
        new_high = np.clip(earlier_high, low[step:], high[step:])
        low, high = np.concatenate([low[:step], new_low]), np.concatenate([high[:step], new_high])
        step *= 2
    left: Array = np.clip(q[0] - start * width / 2, low, high)
    return left


# functions of the derived channels: (table, name, number) to values (n,)
_DERIVED = {"lag": lag, "initial": initial, "play": play}
