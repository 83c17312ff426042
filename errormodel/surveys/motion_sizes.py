"""Plausibility of the sizes of error motions: a unit that is wrong by 1000, or by an inch, is far beyond machines."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import TYPE_CHECKING, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from errormodel.conventions import MOTIONS, TRANSLATIONS
from errormodel.exceptions import InputError
from errormodel.machine import Joint, Machine
from errormodel.surveys.columns import unit_of_column
from errormodel.units import factor

if TYPE_CHECKING:
    from errormodel.raw_formats.base import ReadAs
    from errormodel.surveys.file import SurveyUnits

Array = NDArray[np.float64]

FEWEST_ROWS = 3  # from which the range of an error motion is judged; by judgement
# Largest plausible error motions: a rolled screw of the coarsest class in use (ISO 3408-3, T7) is off by 52 um over
# 300 mm, a steel scale grows by 0.12 mm/m in 10 K, guideways tilt by 0.2 mrad at worst; the belt of a printer that was
# never calibrated is off by 3 mm/m. The limits are beyond all of these.
RANGE_PER_MM = 5e-3  # largest range of a translation, mm per mm of travel
RANGE_MM = 0.5  # and this much at least, mm
RANGE_RAD = 1e-3  # largest range of a rotation, rad
REASON = "the coarsest screws are off by 0.05 mm in 300 mm (ISO 3408-3, T7)"
# relative difference of the ranges of motion and position below which the column holds the position itself
POSITION_SHARE = 0.1
UNITS_MM = {"m": 1000.0, "inch": 25.4, "mm": 1.0, "um": 1e-3}
FACTOR_SLACK = 0.02  # relative, of a position's scale beside that of another unit: errors of machines are far smaller
CENTRAL = (0.05, 0.95)  # quantiles between which a range is taken: outliers are no unit


def usual_range(way: float, linear: bool = True) -> float:
    """Largest range of an error motion of a machine in mm, or rad, over `way` (mm; 0 for a rotary joint)."""
    return max(RANGE_MM, RANGE_PER_MM * way) if linear else RANGE_RAD


def central_range(values: Array, run: Array | None = None) -> float:
    """Range of the central 90 % of values (n,) about the medians of their runs: each run has a zero of its own."""
    good = np.isfinite(values)
    series = pd.Series(values[good])
    if run is not None:
        series = series - series.groupby(np.asarray(run)[good]).transform("median")
    low, high = np.quantile(series, CENTRAL)
    return float(high - low)


def check_motions(
    frame: pd.DataFrame, machine: Machine, units: SurveyUnits, name: str, read_as: Mapping[str, ReadAs] | None
) -> list[str]:
    """Notes on error motions that vary by more than a machine's do, where the user has stated their unit.

    Parameters
    ----------
    read_as : of a raw file, as in `errormodel.raw_formats.base.Recording`; None for a survey's own table.

    Raises
    ------
    InputError
        They vary by more, and nobody but the file states the unit.
    """
    notes = []
    for joint, motion in product(machine.joints, MOTIONS):
        if motion not in frame:
            continue
        rows = frame[(frame["joint"] == joint.name) & frame[motion].notna()]
        if len(rows) < FEWEST_ROWS:
            continue
        values = rows[motion].to_numpy(dtype=np.float64)
        position = rows[joint.name].to_numpy(dtype=np.float64)
        linear, way = motion in TRANSLATIONS, float(np.ptp(position)) if joint.type == "prismatic" else 0.0
        word, unit, _ = (read_as or {}).get(motion) or (motion, "", "")
        if linear and way > 0:
            _refuse_positions(f"{name}, column {motion}", joint, motion, values, position, word, unit)
        spread = central_range(values, rows["run"].to_numpy() if "run" in rows else None)
        usual = usual_range(way, linear)
        if spread <= usual:
            continue
        own = unit_of_column(motion, "length" if linear else "angle", units)
        size = spread / factor(own, "length" if linear else "angle")
        most = f"{usual:.2g} mm" if linear else f"{1e3 * usual:.2g} mrad"
        most += f" over {way:.4g} mm" if way else ""
        found = f"error motions of {joint.name} that vary by {size:.3g} {own}, where those of a machine vary by {most} "
        found += f"at most{f': {REASON}' if linear else ''}"
        if motion in units.of_columns:
            stated = unit or own
            notes.append(f"{found}; their unit ({stated}) was stated, and they are taken as they are")
            continue
        raise InputError(
            f"{name}, column {motion}", found, _cure(motion, word, unit, own, spread, usual, read_as is None)
        )
    return notes


def _cure(motion: str, word: str, unit: str, own: str, spread: float, usual: float, table: bool) -> str:
    """What to write where error motions are too large: the unit in which they would be a machine's, if there is one."""
    smaller = "um" if motion in TRANSLATIONS else "urad"
    if table:
        return f"Write units: {{{motion}: {smaller}}} in a survey.yaml; if it is so, units: {{{motion}: {own}}}"
    quantity: Literal["length", "angle"] = "length" if motion in TRANSLATIONS else "angle"
    said = unit or own
    of_deviations = word != "actual"  # another unit of positions changes their scale, and not their deviations alone
    fits = of_deviations and spread * factor(smaller, quantity) / factor(said, quantity) <= usual and said != smaller
    keep = f"if it is so, --units {word}={said}"
    if fits:
        return f"If they are in {smaller}, import again with --units {word}={smaller}; {keep}"
    return f"See that its columns are what they were read as (--columns); {keep}"


def _refuse_positions(
    where: str, joint: Joint, motion: str, values: Array, position: Array, word: str, unit: str
) -> None:
    """InputError where a translation (n,) follows the position (n,) itself, or a position in another unit."""
    way = float(np.ptp(position))
    slope = float(np.polyfit(position, values, 1)[0])
    scale = 1 + (slope if joint.axis[np.argmax(np.abs(joint.axis))] > 0 else -slope)  # actual position over target
    for other, mm in UNITS_MM.items() if word == "actual" else ():
        if unit in UNITS_MM and other != unit and abs(scale * mm / UNITS_MM[unit] - 1) < FACTOR_SLACK:
            found = f"actual positions in {unit} that change by {scale:.4g} times what {joint.name} does"
            raise InputError(where, found, f"They seem to be in {other}: import again with --units actual={other}")
    if abs(np.ptp(values) - way) < POSITION_SHARE * way:
        found = f"it changes by {way:.6g} mm where {joint.name} does: a position, not its deviation"
        raise InputError(where, found, f"Write {motion} as measured minus commanded")
