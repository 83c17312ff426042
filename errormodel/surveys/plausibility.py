"""Plausibility of a survey's units: measured distances, travels, temperatures and speeds against the machine.

Distances between measured points equal those between nominal positions except for a fraction of a millimetre, wherever
the instrument stands. A wrong unit of length multiplies nearly all of them by one factor, such as 1000 or 25.4.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from errormodel.exceptions import InputError
from errormodel.machine import Joint, Machine
from errormodel.surveys.columns import MEASURED, TOOL_COLUMNS, unit_of_column
from errormodel.surveys.motion_sizes import FEWEST_ROWS, UNITS_MM, check_motions
from errormodel.surveys.temperatures import kelvin_note
from errormodel.units import factor

if TYPE_CHECKING:
    from errormodel.raw_formats.base import ReadAs
    from errormodel.surveys.file import SurveyUnits

Array = NDArray[np.float64]

_SHOP_DEGF = (55.0, 110.0)  # usual temperatures of shops in degF, which are implausible in degC
_ROOM_DEGC = (5.0, 45.0)  # of a sensor that another one is compared with; by judgement
# K between two members of a machine; K rms by which a sensor must change to be followed; share of that by which another
# one that follows it may differ, and that must be this share of what it differs by in degC. By judgement
_BETWEEN_MEMBERS, _CHANGES, _FOLLOWS, _FOLLOWS_BETTER = 5.0, 0.3, 0.5, 0.7
# mm/s, the fastest rapid traverses (120 m/min): a median from row to row, standstills included, is less
_FASTEST_MM_PER_S = 2e3
_LONGEST_STEP_S = 3600.0  # s; a longer median time from row to row is implausible; by judgement
_FEWEST_PACE_ROWS = 10  # fewest rows from which a speed is judged; by judgement
_SAMPLE_ROWS = 1000  # rows of the sample: more change nothing and take time
_WRONG_UNIT_SHARE = 0.05  # share of pairs of rows with agreeing distances below which a unit is wrong; by judgement
_OTHER_UNIT_SHARE = 0.7  # share of pairs of rows that must agree in another unit; by judgement
_SHORTEST_TOOL = 100.0  # times shorter than the machine's: a tool in metres; by judgement
_INCHES_OF_TRAVEL = 0.7  # share of a travel that targets must cover in inches for a doubt; by judgement
_FEW_INSIDE = 0.5  # of the positions within a travel: another unit is looked for that brings all in
_PART_FILLED = 0.3  # share of the travel that they must then cover; by judgement
_MOST_OF_TRAVEL = 0.5  # share of a travel that a thousand times the positions of one axis must cover; by judgement


def check_sizes(
    frame: pd.DataFrame,
    machine: Machine,
    units: SurveyUnits,
    name: str,
    measured: bool,
    read_as: Mapping[str, ReadAs] | None = None,
) -> list[str]:
    """Refuse an impossible unit of length, and kelvin; note implausible units of angle, temperature and time.

    Parameters
    ----------
    frame : DataFrame
        One file in internal units.
    machine : Machine
    units : SurveyUnits
        Declared units of the file.
    name : str
        The file, for messages.
    measured : bool
        Whether measured coordinates are checked.
    read_as : mapping or None
        What the error motions of a raw file were read from, as in `errormodel.raw_formats.base.Recording`.
    """
    said: list[str | None] = [_temperatures(frame, units, name, measured)]
    if measured and "joint" in frame:
        said += check_motions(frame, machine, units, name, read_as)
        for joint in machine.joints:
            about = frame[frame["joint"] == joint.name]
            if joint.type == "prismatic" and len(about) >= FEWEST_ROWS:
                said += [
                    _check_commands(about, [joint], units, name, None, read_as),
                    _short_test(about, joint, read_as),
                ]
    frame = frame[frame["joint"] == ""] if "joint" in frame else frame
    if frame.empty:
        return [f"{name}: {note}" for note in said if note]
    prismatic = [j for j in machine.joints if j.type == "prismatic"]
    sample = _sample(frame, machine) if measured else None
    notes = [*said, _check_commands(frame, prismatic, units, name, sample, read_as)]
    if sample is not None:
        _check_measured(sample, prismatic, units, name, read_as)
    notes += [None if measured else _tools(frame, machine)]
    notes += [_radians(frame, machine, units, sample), _pace(frame, prismatic, units)]
    return [f"{name}: {note}" for note in notes if note]


def _temperatures(frame: pd.DataFrame, units: SurveyUnits, where: str, measured: bool) -> str | None:
    """Note if temperatures are in kelvin, all look like Fahrenheit, or one like another one in Fahrenheit.

    Raises
    ------
    InputError
        All temperatures that were measured are in kelvin.
    """
    names = [str(n) for n in frame if str(n).startswith("T_") and n not in units.of_columns]
    if not names or units.temperature != "degC":
        return None
    if note := kelvin_note(frame[names], where, measured):
        return note
    if not (middle := frame[names].median()).notna().all():
        return None
    low, high = float(middle.min()), float(middle.max())
    # a single member may be as warm as that
    if _SHOP_DEGF[0] < low and high < _SHOP_DEGF[1] and len(names) > 1 and high - low < 15:
        text = f"{' '.join(names)} of {low:.0f} to {high:.0f} degC"
        return f"{text}; if they are in degF, write units: {{temperature: degF}}"
    return _one_in_fahrenheit(frame[names])


def _one_in_fahrenheit(read: pd.DataFrame) -> str | None:
    """Note if a temperature changes as another one does, beside it, if it is read in degF, and not in degC.

    A motor or a heater may be as warm, but does not follow the room so.
    """
    least, most = _SHOP_DEGF
    middle, changes = read.median(), read.std(ddof=0)
    names = [str(n) for n in read]
    for name in (n for n in names if least < middle[n] < most):
        near = [n for n in names if _ROOM_DEGC[0] < middle[n] < _ROOM_DEGC[1] and changes[n] > _CHANGES]
        off = {n: (read[name] - 32) / 1.8 - read[n] for n in near}
        by = {n: float(o.std(ddof=0)) for n, o in off.items() if abs(o.median()) < _BETWEEN_MEMBERS}
        if not by:
            continue
        other = min(by, key=by.__getitem__)
        in_degc = float((read[name] - read[other]).std(ddof=0))
        if by[other] < min(_FOLLOWS * changes[other], _FOLLOWS_BETTER * in_degc):
            return (
                f"{name} of {read[name].min():.0f} to {read[name].max():.0f} degC; in degF it would be "
                f"{abs(off[other].median()):.1f} K from {other} and follow it within {by[other]:.1g} K (rms), where in "
                f"degC it does so within {in_degc:.1g} K. If it is in degF, write units: {{{name}: degF}}"
            )
    return None


def _pace(frame: pd.DataFrame, joints: Sequence[Joint], units: SurveyUnits) -> str | None:
    """Note if the times imply impossible speeds, or an hour of rest at each pose."""
    if "time" not in frame or len(frame) < _FEWEST_PACE_ROWS or not frame["time"].notna().all():
        return None
    steps = frame["time"].diff().to_numpy()[1:]
    way = np.sqrt((frame[[j.name for j in joints]].diff().to_numpy()[1:] ** 2).sum(axis=1))
    late = (steps > 0) & (way > 0)
    if not late.any():
        return None
    speed, step = float(np.median(way[late] / steps[late])), float(np.median(steps[late]))
    if speed > _FASTEST_MM_PER_S:
        stated = unit_of_column("time", "time", units)
        return (
            f"linear joints at {speed / 1e3:.2g} m/s (median from row to row) by the column time in {stated}; if it is "
            f"in min or h, write units: {{time: min}} or {{time: h}} in a survey.yaml"
        )
    if step > _LONGEST_STEP_S and unit_of_column("time", "time", units) == "s":
        return f"{step / 3600:.1f} h from row to row by the column time; if it is in ms, write units: {{time: ms}}"
    return None


def _check_commands(
    frame: pd.DataFrame,
    joints: Sequence[Joint],
    units: SurveyUnits,
    name: str,
    sample: _Sample | None,
    read_as: Mapping[str, ReadAs] | None = None,
) -> str | None:
    """Raise InputError if positions of moving prismatic joints are off their travels and another unit brings all back.

    A note if they are not off but would fill all travels in inches.
    """
    moving = [(j, frame[j.name].to_numpy()) for j in joints if np.ptp(frame[j.name].to_numpy()) > 0]
    said = {_unit_read(j.name, units, read_as) for j, _ in moving}
    if len(said) != 1:  # no joint moves, or the columns have units of their own
        return None
    moved = [j.name for j, _ in moving]
    names = " ".join(moved)
    filled = np.array([np.ptp(q) / (j.travel[1] - j.travel[0]) for j, q in moving])

    def inside(scale: float) -> list[float]:
        return [float(np.mean(near_travel(j, q * scale))) for j, q in moving]

    outside, partly = min(inside(1.0)) < 0.05, min(inside(1.0)) < _FEW_INSIDE
    # all poses within a thousandth of the machine, or one axis over a thousandth of most of its travel: metres
    tiny = filled.max() < 0.002 and (len(moving) > 1 or 1000 * filled.max() > _MOST_OF_TRAVEL)
    tiny = tiny and not all(name in units.of_columns for name in moved)
    for scale, unit in _other_units(*said):
        fits = min(inside(scale)) > 0.95 and (filled * scale).max() < 1.5
        whole = partly and (filled * scale).min() > _PART_FILLED
        if fits and (filled * scale).min() > 0.02 and (outside or whole or (tiny and scale == 1000)):
            found = f"positions of {names} that fit the travels only if they are in {unit}"
            # the measured points may be in the right unit
            alone = (
                sample is not None
                and sample.agreement() <= _WRONG_UNIT_SHARE
                and sample.agreement(lengths=scale) > _OTHER_UNIT_SHARE
            )
            columns = [j.name for j in joints] if alone else moved
            cure = _cure(columns, unit, units, read_as, alone=alone or len(joints) == 1)
            kept = ", ".join(f"{n}: {unit_of_column(n, 'length', units)}" for n in moved)
            also = "" if outside or whole else f"; if they are right, units: {{{kept}}}"
            raise InputError(f"{name}, columns {names}", found, f"{cure[0].upper()}{cure[1:]}{also}")
        if fits and (filled * scale).min() > 0.7 and len(moving) > 1 and unit == "inch":
            cure = _cure(moved, unit, units, read_as)
            return f"{names} fill their travels if they are in inch; if so, {cure}"
    return None


def _short_test(frame: pd.DataFrame, joint: Joint, read_as: Mapping[str, ReadAs] | None) -> str | None:
    """Note if the targets of a raw file of one joint cover next to nothing of its travel, and most of it in inches."""
    q = frame[joint.name].to_numpy(dtype=np.float64)
    share = float(np.ptp(q)) / (joint.travel[1] - joint.travel[0])
    inch = UNITS_MM["inch"]
    if (
        read_as is None
        or joint.name not in read_as
        or not _INCHES_OF_TRAVEL < inch * share < 1
        or not np.all(near_travel(joint, inch * q))
    ):
        return None
    text = f"targets of {joint.name} from {q.min():.4g} to {q.max():.4g} mm, {100 * share:.0f} % of its travel; in "
    text += f"inches they would cover {100 * inch * share:.0f} %. If they are, import again with --units "
    if read_as[joint.name].word == joint.name:
        return f"{text}{joint.name}=inch, and likewise of what else is in inches"
    return f"{text}target=inch, and actual=inch, deviation=inch of what else is in inches"


def near_travel(joint: Joint, q: Array) -> NDArray[np.bool_]:
    """Whether positions (n,) lie within the travel of a joint, or a tenth of it beside."""
    low, high = joint.travel
    slack = 0.1 * (high - low)
    return (q > low - slack) & (q < high + slack)


def _other_units(unit: str) -> Iterator[tuple[float, str]]:
    """Other usual units of length, each with its size in the declared one."""
    said = factor(unit, "length")
    return ((mm / said, other) for other, mm in UNITS_MM.items() if mm != said)


def _unit_read(name: str, units: SurveyUnits, read_as: Mapping[str, ReadAs] | None) -> str:
    """The unit as which a column of lengths was read."""
    own = (read_as or {}).get(name)
    return own.unit if own is not None and own.unit else unit_of_column(name, "length", units)


def _cure(
    columns: Sequence[str],
    unit: str,
    units: SurveyUnits,
    read_as: Mapping[str, ReadAs] | None,
    alone: bool = False,
) -> str:
    """Correction for columns in another unit: for all lengths, or for these columns if `alone` or stated singly."""
    if read_as is not None:  # what a raw file states of a column goes before a unit by kind: each is named
        same = {_unit_read(n, units, read_as) for n in columns}
        more = [] if alone else [n for n in MEASURED if n in read_as and read_as[n].unit in same]
        words: dict[str, list[str]] = {}
        for own in (read_as[n] for n in (*columns, *more) if n in read_as):
            words.setdefault(own.option, []).append(f"{own.word}={unit}")
        options = " ".join(f"{option} {','.join(dict.fromkeys(said))}" for option, said in words.items())
        also = ", and likewise of readings that are positions" if any(read_as[n].word != n for n in columns) else ""
        return f"import again with {options}{also}"
    keys = columns if alone or any(c in units.of_columns for c in columns) else ["length"]
    return f"write units: {{{', '.join(f'{key}: {unit}' for key in keys)}}} in a survey.yaml"


@dataclass(frozen=True)
class _Sample:
    """Some rows in their order: channels (k, n) of `machine`, and measured values (n, c) of the named components."""

    machine: Machine
    rows: Array
    measured: Array
    components: tuple[str, ...]

    def agreement(self, measured: float = 1.0, lengths: float = 1.0, angles: float = 1.0) -> float:
        """Share of pairs of rows whose measured and nominal distances agree within 10 %, after scaling the columns."""
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
        least = (
            0.9 if self.measured.shape[1] == 3 else 0.2
        )  # with two components a part of the distance is not measured
        return float(np.mean((ratio > least) & (ratio < 1.1)))


def _sample(frame: pd.DataFrame, machine: Machine) -> _Sample | None:
    """Sample of the rows; None with fewer than two measured components, or with too few rows."""
    components = [name for name in MEASURED if name in frame and frame[name].notna().mean() > 0.5]
    if len(components) < 2:
        return None
    joints = [j.name for j in machine.joints]
    frame = frame[frame[components].notna().all(axis=1)]
    if len(frame) < 8:
        return None
    frame = frame.iloc[np.linspace(0, len(frame) - 1, min(len(frame), _SAMPLE_ROWS)).astype(int)]
    tool = [
        frame[name].fillna(value).to_numpy() if name in frame else np.full(len(frame), value)
        for name, value in zip(TOOL_COLUMNS, machine.tool, strict=True)
    ]
    rows = np.array([*(frame[name].to_numpy() for name in joints), *tool], dtype=np.float64)
    return _Sample(machine, rows, frame[components].to_numpy(dtype=np.float64), tuple(components))


def _check_measured(
    sample: _Sample, prismatic: list[Joint], units: SurveyUnits, name: str, read_as: Mapping[str, ReadAs] | None
) -> None:
    """Raise InputError if the distances between measured points are off by the factor of another unit."""
    if sample.agreement() > _WRONG_UNIT_SHARE:
        return
    row = {j.name: q for j, q in zip(sample.machine.joints, sample.rows[:-3], strict=True)}
    # either side may be in the wrong unit: the commands are believed if they fit the travels
    believed = all(np.mean(near_travel(j, row[j.name])) > 0.5 for j in prismatic)
    for measured in (believed, not believed):
        columns, others = [*MEASURED], [j.name for j in prismatic]
        columns, others = (columns, others) if measured else (others, columns)
        said = {_unit_read(c, units, read_as) for c in columns} or {units.length}
        for scale, unit in _other_units(*said) if len(said) == 1 else ():
            fits = sample.agreement(measured=scale) if measured else sample.agreement(lengths=scale)
            if fits > _OTHER_UNIT_SHARE:
                stated = ", ".join(dict.fromkeys(_unit_read(c, units, read_as) for c in others)) or units.length
                where = " ".join(others) or "the machine"
                found = f"in {unit}, it seems, where {where} {'are' if others else 'is'} in {stated}"
                present = [*sample.components] if measured else columns
                cure = f"If so, {_cure(present, unit, units, read_as, alone=True)}"
                raise InputError(f"{name}, columns {' '.join(columns)}", found, cure)


def _tools(frame: pd.DataFrame, machine: Machine) -> str | None:
    """Note if tools are a thousandth of the machine's: metres."""
    if not all(name in frame for name in TOOL_COLUMNS):
        return None
    length = float(np.linalg.norm(machine.tool))
    tools = np.linalg.norm(frame[list(TOOL_COLUMNS)].to_numpy(dtype=np.float64), axis=1)
    longest = float(np.nanmax(tools, initial=0.0))
    if not 0 < longest < length / _SHORTEST_TOOL:
        return None
    return (
        f"tools of at most {longest:.3g} mm, where the machine's is {length:.6g} mm; if they are in m, write units: "
        f"{{{', '.join(f'{name}: m' for name in TOOL_COLUMNS)}}}"
    )


def _radians(frame: pd.DataFrame, machine: Machine, units: SurveyUnits, sample: _Sample | None) -> str | None:
    """Note if rotary positions declared in degrees look like radians."""
    degree = factor(units.angle, "angle")
    rotary = [j for j in machine.joints if j.type == "rotary" and j.travel[1] - j.travel[0] > math.pi / 2]
    moving = [j.name for j in rotary if np.ptp(frame[j.name].to_numpy()) > 0 and j.name not in units.of_columns]
    if not moving or degree == 1 or np.abs(frame[moving].to_numpy()).max() / degree > 2 * math.pi + 1e-3:
        return None
    if sample is not None:
        if sample.agreement() > 0.3 or sample.agreement(angles=1 / degree) < _OTHER_UNIT_SHARE:
            return None
        return f"the measured points fit {' '.join(moving)} in rad, not {units.angle}; write units: {{angle: rad}}"
    return f"{' '.join(moving)} within 6.3 {units.angle} in all rows; if that is rad, write units: {{angle: rad}}"
