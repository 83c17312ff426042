"""Drift recordings of a survey: repeated error-motion readings at a few positions while temperatures change.

Invalid data raise an error or are left out with a note: times that decrease, recordings with overlapping times at
different temperatures, gaps in time, failed sensors, constant temperatures. Units: mm, rad, s, degC.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Index, Mask
from errormodel.conventions import MOTIONS, Motion
from errormodel.exceptions import InputError
from errormodel.machine import Machine
from errormodel.survey import Survey
from identification.diagnosis.data_checks.temperature_sensors import faults

if TYPE_CHECKING:
    import pandas as pd

# All by judgement
FEWEST_RECORDING_ROWS = 12  # rows at one position and run that make a recording; fewer calibrate the geometry
LEAST_TEMPERATURE_RANGE_K = 1.0  # K, range that the most variable sensor must have in the files of a role
GAP_STEPS, GAP_SECONDS = 10.0, 600.0  # a gap in time is longer than this many median steps and this many seconds
GAP_TEMPERATURE_STEP_K = 0.5  # K, change of a temperature across a gap above which a side of it is left out
SAME_HOURS_TOLERANCE_K = 0.3  # K, allowed difference of a sensor in two recordings with overlapping times
LEAST_NOISE_SHARE_OF_DRIFT = 1e-4  # smallest noise over the range of the drift: a coarse resolution can hide noise
SENSOR_GROUP_CORRELATION = 0.999  # correlation from which sensors form one group


@dataclass(frozen=True)
class Drift:
    """One error motion of one joint over all its recordings of one role.

    Attributes
    ----------
    rows : (n,) row numbers in the survey's table.
    position, values : (n,) position of the joint and error motion, mm or rad.
    series : (n,) number of run and position: each has its own zero of the instrument.
    """

    joint: str
    motion: Motion
    rows: Index
    position: Array
    values: Array
    series: Index

    @cached_property
    def noise(self) -> float:
        """Standard deviation of one value, from second differences in time, which slow drift does not affect."""
        second = [np.diff(self.values[self.series == s], 2) for s in np.unique(self.series)]
        noise = float(np.sqrt(np.mean(np.square(np.concatenate(second))) / 6))
        return max(noise, LEAST_NOISE_SHARE_OF_DRIFT * float(np.ptp(self.values)), 1e-15)


@dataclass(frozen=True)
class Recordings:
    """Drifts by role, and the usable temperature sensors.

    Attributes
    ----------
    survey : without the rows that were left out.
    fit, test : drifts of the error motions that both roles have, in the same order.
    groups : sensors that correlate at `SENSOR_GROUP_CORRELATION` or more; the first of each represents it.
    left_out : unusable sensors, with the reason.
    notes : sentences for the user.
    """

    survey: Survey
    fit: tuple[Drift, ...]
    test: tuple[Drift, ...]
    groups: tuple[tuple[str, ...], ...]
    left_out: dict[str, str]
    notes: tuple[str, ...]

    @property
    def sensors(self) -> tuple[str, ...]:
        """The first sensor of each group."""
        return tuple(group[0] for group in self.groups)


def recordings(machine: Machine, survey: Survey) -> Recordings:
    """The drift recordings of a survey, checked.

    Raises
    ------
    InputError
        Columns or files are missing, times decrease, temperatures are constant, or no sensor or motion is usable.
    """
    source = str(survey.source)
    names = [str(c) for c in survey.table if str(c).startswith("T_")]
    if not names or "time" not in survey.table or "joint" not in survey.table:
        found = "no column " + ", ".join(c for c, there in _needed(survey, names) if not there)
        raise InputError(
            source, found, "Give rows about a joint's error motions (joint, dx ... ec), time and T_<sensor>"
        )
    if survey.table["time"].isna().any():
        row = survey.table[survey.table["time"].isna()].iloc[0]
        cure = "Give every file its time: what expands is behind the temperatures"
        raise InputError(f"{row['file']}, row {row['row']}, column time", "no time, which other files have", cure)
    if not survey.test:
        found = "no file has role: test, and a thermal model is worth what it says of another thermal cycle"
        raise InputError(source, found, "Give the recordings of one cycle the role test in a survey.yaml")
    parts = _parts(machine, survey.table)
    _refuse_clocks(parts, names)
    survey, notes = _without_gaps(survey, parts, names)
    left_out = dict(_left_out(survey.table, names))
    alive = [name for name in names if name not in left_out]
    if not alive:
        name, reason = next(iter(left_out.items()))
        more = f" (and {len(left_out) - 1} more)" if len(left_out) > 1 else ""
        raise InputError(source, f"no sensor is left: {name} {reason}{more}", "Give temperatures that every file has")
    drifts = {role: list(_drifts(machine, survey, role)) for role in ("fit", "test")}
    keys = [{(d.joint, d.motion) for d in drifts[role]} for role in ("fit", "test")]
    if not keys[0] & keys[1]:
        found = (
            f"no error motion with {FEWEST_RECORDING_ROWS} readings at one position in the files to fit and in those "
            "to test"
        )
        raise InputError(source, found, "Record the same error motions over both cycles, each at a few positions")
    lonely = sorted(f"{j} {m}" for j, m in keys[0] ^ keys[1])
    if lonely:
        notes += (f"not in both roles, and not modelled: {', '.join(lonely)}",)
    fit, test = (tuple(d for d in drifts[r] if (d.joint, d.motion) in keys[0] & keys[1]) for r in ("fit", "test"))
    for role, own in (("fit", fit), ("test", test)):
        _refuse_constant(survey, np.unique(np.concatenate([d.rows for d in own])), alive, role)
    return Recordings(survey, fit, test, tuple(_groups(survey, fit, alive)), left_out, notes)


def _needed(survey: Survey, sensors: list[str]) -> list[tuple[str, bool]]:
    """Required columns, and whether the survey has them."""
    there = set(survey.table)
    return [("joint", "joint" in there), ("time", "time" in there), ("T_<sensor>", bool(sensors))]


def _parts(machine: Machine, table: pd.DataFrame) -> list[tuple[str, pd.DataFrame]]:
    """Recordings, each of one file, run, joint and position, with their names for messages."""
    out = []
    for joint in machine.joints:
        own = table[table["joint"] == joint.name]
        for (_, run, _), part in own.groupby(["file", "run", joint.name], sort=False):
            if len(part) >= FEWEST_RECORDING_ROWS:
                position = float(part[joint.name].iloc[0])
                shown = float(np.degrees(position)) if joint.type == "rotary" else position
                out.append((f"run {run} ({joint.name} at {shown:g})", part))
    return out


def _refuse_clocks(parts: list[tuple[str, pd.DataFrame]], sensors: list[str]) -> None:
    """Raise InputError where time decreases, or two recordings of a file overlap in time at other temperatures."""
    for name, part in parts:
        time = part["time"].to_numpy(dtype=np.float64)
        falls = np.flatnonzero(np.diff(time) < 0)
        if len(falls):
            row = part.iloc[falls[0] + 1]
            found = f"time goes back by {-np.diff(time)[falls[0]]:.6g} s within {name}"
            cure = "Correct the times, or give what follows a file of its own: what expands depends on what was before"
            raise InputError(f"{row['file']}, row {row['row']}, column time", found, cure)
    for (one, here), (other, there) in combinations(parts, 2):
        file = here["file"].iloc[0]
        apart = _disagreement(here, there, sensors) if file == there["file"].iloc[0] else 0.0
        if apart > SAME_HOURS_TOLERANCE_K:
            found = f"{one} and {other} claim the same hours, at temperatures that differ by {apart:.1f} K"
            cure = "Let time go on from recording to recording, or give each a file of its own"
            raise InputError(f"{file}, column time", found, cure)


def _disagreement(one: pd.DataFrame, other: pd.DataFrame, sensors: list[str]) -> float:
    """Temperature difference of two recordings where their times overlap, K: 90 % quantile, largest of all sensors."""
    here, there = (p["time"].to_numpy(dtype=np.float64) for p in (one, other))
    both = (here >= there.min()) & (here <= there.max())
    if both.sum() < 2:
        return 0.0
    whole = [s for s in sensors if one[s].notna().all() and other[s].notna().all()]
    gaps = [np.interp(here[both], there, other[s]) - one[s].to_numpy(dtype=np.float64)[both] for s in whole]
    return max((float(np.quantile(np.abs(g), 0.9)) for g in gaps), default=0.0)


def _without_gaps(
    survey: Survey, parts: list[tuple[str, pd.DataFrame]], sensors: list[str]
) -> tuple[Survey, tuple[str, ...]]:
    """The survey without the shorter side of every gap in time across which temperatures changed, and notes."""
    notes = list[str]()
    bad = np.zeros(len(survey), dtype=bool)
    for name, part in parts:
        time, numbers = part["time"].to_numpy(dtype=np.float64), part["row"].to_numpy()
        steps = np.diff(time)
        usual = float(np.median(steps))
        warm = part[sensors].to_numpy(dtype=np.float64)
        change = np.nan_to_num(np.abs(np.diff(warm, axis=0))).max(axis=1)
        for k in np.flatnonzero((steps > max(GAP_STEPS * usual, GAP_SECONDS)) & (change > GAP_TEMPERATURE_STEP_K)):
            side = slice(0, k + 1) if 2 * (k + 1) < len(time) else slice(k + 1, None)
            bad[part.index[side]] = True
            first, last = numbers[side][[0, -1]]
            notes.append(
                f"{part['file'].iloc[0]}, row {numbers[k + 1]}: time jumps by {steps[k]:.0f} s while a temperature "
                f"changes by {change[k]:.1f} K, which no lag can follow: rows {first} to {last} of {name} are left out"
            )
    return (survey.rows(~bad) if bad.any() else survey), tuple(notes)


def _left_out(table: pd.DataFrame, names: list[str]) -> Iterator[tuple[str, str]]:
    """Sensors that fail in some recording, with the first reason."""
    found: dict[str, str] = {}
    for (file, run), part in table.groupby(["file", "run"], sort=False):
        for name, reason in faults(part.sort_values("time", kind="stable")).items():
            found.setdefault(name, f"{reason} ({file}, run {run})")
    return ((name, found[name]) for name in names if name in found)


def _drifts(machine: Machine, survey: Survey, role: str) -> Iterator[Drift]:
    """Drifts of all recorded error motions of one role."""
    table = survey.table
    for joint in machine.joints:
        own = ((table["joint"] == joint.name) & (table["role"] == role)).to_numpy(dtype=bool)
        for motion in MOTIONS:
            rows = np.flatnonzero(own & table[motion].notna().to_numpy())
            key = table.iloc[rows].groupby(["file", "run", joint.name], sort=False)
            kept: Mask = (key["row"].transform("size") >= FEWEST_RECORDING_ROWS).to_numpy(dtype=bool)
            if kept.any():
                _, series = np.unique(key.ngroup().to_numpy()[kept], return_inverse=True)
                part = table.iloc[rows[kept]]
                position, values = (part[c].to_numpy(dtype=np.float64) for c in (joint.name, motion))
                yield Drift(joint.name, motion, rows[kept], position, values, series)


def _refuse_constant(survey: Survey, rows: Index, sensors: list[str], role: str) -> None:
    """Raise InputError if no temperature changes enough in the rows."""
    part = survey.table.iloc[rows]
    ranges = {name: float(np.ptp(part[name].to_numpy(dtype=np.float64))) for name in sensors}
    most = max(ranges, key=lambda name: ranges[name])
    if ranges[most] < LEAST_TEMPERATURE_RANGE_K:
        found = f"temperatures hardly change in the files to {role}: {most}, most of all, by {ranges[most]:.2g} K"
        cure = f"Record a warm-up, by {LEAST_TEMPERATURE_RANGE_K:g} K or more; better by all that the machine will see"
        raise InputError(str(survey.source), found, cure)


def _groups(survey: Survey, drifts: tuple[Drift, ...], sensors: list[str]) -> list[tuple[str, ...]]:
    """Groups of correlated sensors: each joins the first group whose first sensor it correlates with."""
    rows = np.unique(np.concatenate([d.rows for d in drifts]))
    values = survey.table.iloc[rows][sensors].to_numpy(dtype=np.float64)
    moving = values - values.mean(axis=0)
    norms = np.linalg.norm(moving, axis=0)
    alike = (moving.T @ moving) / np.maximum(np.outer(norms, norms), 1e-30)
    groups: list[list[int]] = []
    for k in range(len(sensors)):
        home = next((g for g in groups if alike[g[0], k] >= SENSOR_GROUP_CORRELATION), None)
        if home is None:
            groups.append([k])
        else:
            home.append(k)
    return [tuple(sensors[k] for k in g) for g in groups]
