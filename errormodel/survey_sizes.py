"""Do the numbers fit the machine? Units that cannot be right are refused; poses outside the travels are noted.

Distances between measured points equal those between nominal positions but for a fraction of a millimetre, wherever the
instrument stands. A wrong unit therefore shows as one factor, 1000 or 25.4, in nearly all of them; nothing else does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from errormodel.exceptions import InputError
from errormodel.machine import Joint, Machine
from errormodel.survey_columns import MEASURED, TOOL
from errormodel.units import factor

if TYPE_CHECKING:
    from errormodel.survey_schema import SurveyUnits

Array = NDArray[np.float64]

_FACTORS = (1000.0, 1e-3, 25.4, 1 / 25.4)
_UNITS = {"um": 1e-3, "mm": 1.0, "inch": 25.4, "m": 1000.0}
_ROWS = 1000  # tell as much as a million
_CLEAR = 0.7  # part of the pairs that must agree on a factor


def check_sizes(frame: pd.DataFrame, machine: Machine, units: SurveyUnits, name: str, measured: bool) -> list[str]:
    """Refuse a file whose unit of length cannot be right; note one whose unit of angle looks wrong.

    Parameters
    ----------
    frame : DataFrame
        One file in internal units.
    machine : Machine
    units : SurveyUnits
        What the file is said to be in.
    name : str
        The file, for messages.
    measured : bool
        Whether measured coordinates count.
    """
    frame = frame[frame["joint"] == ""] if "joint" in frame else frame
    if frame.empty:
        return []
    prismatic = [j for j in machine.joints if j.type == "prismatic"]
    _check_commands(frame, prismatic, units, name)
    sample = _sample(frame, machine) if measured else None
    if sample is not None:
        _check_measured(sample, prismatic, units, name)
    note = _radians(frame, machine, units, sample)
    return [f"{name}: {note}"] if note else []


def travel_notes(table: pd.DataFrame, machine: Machine) -> Iterator[str]:
    """A note for every joint that is commanded beyond its travel: how often, and where the farthest is."""
    for joint in machine.joints:
        low, high = joint.travel
        q = table[joint.name].to_numpy()
        beyond = np.fmax(low - q, q - high)
        outside = beyond > 1e-6 * (high - low)
        if outside.any():
            worst = table.loc[int(np.nanargmax(beyond)), [joint.name, "file", "row"]]
            unit, scale = ("mm", 1.0) if joint.type == "prismatic" else ("deg", 180 / math.pi)
            count = f"{outside.sum()} pose{'s are' if outside.sum() > 1 else ' is'}"
            yield (
                f"{count} outside the travel of {joint.name}, {low * scale:.6g} to {high * scale:.6g} {unit}; "
                f"the farthest at {worst[joint.name] * scale:.6g} {unit} ({worst['file']}, row {worst['row']})"
            )


def _check_commands(frame: pd.DataFrame, joints: Sequence[Joint], units: SurveyUnits, name: str) -> None:
    """InputError if all prismatic joints that move are off their travels by one factor."""
    moving = [(j, frame[j.name].to_numpy()) for j in joints if np.ptp(frame[j.name].to_numpy()) > 0]
    if not moving:
        return
    spans = [j.travel[1] - j.travel[0] for j, _ in moving]
    filled = [float(np.ptp(q)) / span for (_, q), span in zip(moving, spans, strict=True)]

    def inside(scale: float) -> list[float]:
        slack = [0.1 * span for span in spans]
        return [
            float(np.mean((q * scale > j.travel[0] - s) & (q * scale < j.travel[1] + s)))
            for (j, q), s in zip(moving, slack, strict=True)
        ]

    outside = max(inside(1.0)) < 0.05
    tiny = len(moving) > 1 and max(filled) < 0.002  # all poses in a thousandth of the machine: metres
    for scale in _FACTORS if outside else _FACTORS[:1] if tiny else ():
        plausible = [0.1 < scale * f < 1.5 for f in filled]
        if min(inside(scale)) > 0.95 and (any(plausible) if outside else all(plausible)):
            names = " ".join(j.name for j, _ in moving)
            truly, found = (
                _unit(units, scale),
                f"positions of {names} that fit the travels only as {_unit(units, scale)}",
            )
            raise InputError(f"{name}, columns {names}", found, f"Write units: {{length: {truly}}} in a survey.yaml")


@dataclass(frozen=True)
class _Sample:
    """Some rows in their order: channels (k, n) of `machine`, measured components (n, c)."""

    machine: Machine
    rows: Array
    measured: Array

    def agreement(self, measured: float = 1.0, lengths: float = 1.0, angles: float = 1.0) -> float:
        """Part of the pairs of rows whose measured and nominal distances agree, with the columns scaled so."""
        from errormodel.chain import Chain

        scale = [lengths if j.type == "prismatic" else angles for j in self.machine.joints] + [1.0] * 3
        rows = [np.ascontiguousarray(row * s) for row, s in zip(self.rows, scale, strict=True)]
        nominal = Chain(self.machine).kernel("nominal", outputs=(0, 1, 2))(rows).T
        went, seen = (
            np.concatenate([np.linalg.norm(points[k:] - points[:-k], axis=1) for k in (1, 5)])
            for points in (nominal, self.measured * measured)
        )
        far = went > 0.05 * went.max(initial=0.0)
        if not far.any():
            return 1.0
        ratio = seen[far] / went[far]
        least = 0.9 if self.measured.shape[1] == 3 else 0.2  # with two components, part of the way is not seen
        return float(np.mean((ratio > least) & (ratio < 1.1)))


def _sample(frame: pd.DataFrame, machine: Machine) -> _Sample | None:
    """None if fewer than two components were measured, or too few rows."""
    components = [name for name in MEASURED if name in frame and frame[name].notna().mean() > 0.5]
    if len(components) < 2:
        return None
    joints = [j.name for j in machine.joints]
    frame = frame[frame[components].notna().all(axis=1)]
    if len(frame) < 8:
        return None
    frame = frame.iloc[np.linspace(0, len(frame) - 1, min(len(frame), _ROWS)).astype(int)]
    tool = [
        frame[name].fillna(value).to_numpy() if name in frame else np.full(len(frame), value)
        for name, value in zip(TOOL, machine.tool, strict=True)
    ]
    rows = np.array([*(frame[name].to_numpy() for name in joints), *tool], dtype=np.float64)
    return _Sample(machine, rows, frame[components].to_numpy(dtype=np.float64))


def _check_measured(sample: _Sample, prismatic: list[Joint], units: SurveyUnits, name: str) -> None:
    """InputError if the distances between measured points are off by one factor."""
    if sample.agreement() > 0.05:
        return
    names = [j.name for j in sample.machine.joints]
    travelled = [
        np.mean((q > 1.1 * j.travel[0] - 0.1 * j.travel[1]) & (q < 1.1 * j.travel[1] - 0.1 * j.travel[0]))
        for j in prismatic
        for q in [sample.rows[names.index(j.name)]]
    ]
    # metres measured and micrometres commanded give the same ratio: what fits the travels is right
    believed = not travelled or min(travelled) > 0.5
    for scale in _FACTORS:
        fits = sample.agreement(measured=scale) if believed else sample.agreement(lengths=scale)
        if fits > _CLEAR:
            truly, said = _unit(units, scale), units.length
            columns = "mx my mz" if believed else " ".join(j.name for j in prismatic)
            others = "the joint positions" if believed else "mx my mz"
            found = (
                f"looks like {truly} where {others} look like {said} (distances are off by {max(scale, 1 / scale):g})"
            )
            cure = f"Write all lengths in one unit: {columns} in {said}, or {others} in {truly} too and"
            raise InputError(f"{name}, columns {columns}", found, f"{cure} units: {{length: {truly}}} in a survey.yaml")


def _radians(frame: pd.DataFrame, machine: Machine, units: SurveyUnits, sample: _Sample | None) -> str | None:
    """A note if rotary positions said to be in degrees look like radians."""
    degree = factor(units.angle, "angle")
    rotary = [j for j in machine.joints if j.type == "rotary" and j.travel[1] - j.travel[0] > math.pi / 2]
    moving = [j.name for j in rotary if np.ptp(frame[j.name].to_numpy()) > 0]
    if not moving or degree == 1 or np.abs(frame[moving].to_numpy()).max() / degree > 2 * math.pi + 1e-3:
        return None
    if sample is not None:
        if sample.agreement() > 0.3 or sample.agreement(angles=1 / degree) < _CLEAR:
            return None
        return f"the measured points fit {' '.join(moving)} in rad, not {units.angle}; write units: {{angle: rad}}"
    return f"{' '.join(moving)} within 6.3 {units.angle} in all rows; if that is rad, write units: {{angle: rad}}"


def _unit(units: SurveyUnits, scale: float) -> str:
    """The unit of length that is `scale` times the one in `units`."""
    size = factor(units.length, "length") * scale
    return next((unit for unit, mm in _UNITS.items() if abs(size / mm - 1) < 0.01), f"{size:g} mm")
