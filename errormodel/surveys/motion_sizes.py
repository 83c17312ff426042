"""Plausibility of the sizes of error motions: a unit that is wrong by 1000, or by an inch, is far beyond machines.

Too large ones are refused; ones below what any machine does are doubted in a note.
"""

from __future__ import annotations

import math
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
# Least plausible error motions: 0.1 um/m is what 0.01 K does to steel (11.5 um/(m K)), and a fifth of what a laser in
# compensated air is off by; repeats differ by a tenth of that at least, as the air of the beam does by 0.01 K
# (0.93 um/(m K)). Short stages come to some 20 nm and repeat to 5 nm; the best air bearings tilt by 1 urad, the best
# tables are off by 0.5 urad, and the noise of an autocollimator is 0.02 urad.
LEAST_RANGE_MM, LEAST_RANGE_PER_MM, LEAST_RANGE_RAD = 2e-5, 1e-7, 1e-7
LEAST_SCATTER_MM, LEAST_SCATTER_PER_MM, LEAST_SCATTER_RAD = 5e-6, 1e-8, 5e-9
MANY = 10  # readings, to say that they are too good; and repeats beyond the first; by judgement
ROUND_OFF = 1e-10  # mm or rad: less is none
LARGER_UNITS = (("um", "mm", "inch", "m"), ("urad", "arcsec", "mrad", "deg", "rad"))  # of translations, of rotations
LIKELY = 1000.0  # times: so far are units that are mistaken for each other
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


def repeatability(values: Array, position: Array, side: Array, run: Array) -> float:
    """Pooled standard deviation of values (n,) at one position from one side; NaN with fewer than `MANY` repeats.

    Each run has a zero of its own, and its median is taken off.
    """
    table = pd.DataFrame({"value": values, "at": position.round(6), "side": np.nan_to_num(side), "run": run})
    table["value"] -= table.groupby("run")["value"].transform("median")
    groups = table.groupby(["at", "side"])["value"]
    about, free = table["value"] - groups.transform("mean"), len(table) - groups.ngroups
    return float(np.sqrt(np.sum(about**2) / free)) if free >= MANY else np.nan


def check_motions(
    frame: pd.DataFrame, machine: Machine, units: SurveyUnits, name: str, read_as: Mapping[str, ReadAs] | None
) -> list[str]:
    """Notes on error motions that vary by less than a machine's do, or by more where the user has stated their unit.

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
        quantity: Literal["length", "angle"] = "length" if linear else "angle"
        word, unit, _ = (read_as or {}).get(motion) or (motion, "", "")
        if linear and way > 0:
            _refuse_positions(f"{name}, column {motion}", joint, motion, values, position, word, unit)
        spread = central_range(values, rows["run"].to_numpy() if "run" in rows else None)
        usual = usual_range(way, linear)
        if spread <= usual:
            if not linear or way > 0:
                notes += _too_good(joint, motion, rows, spread, way, unit_of_column(motion, quantity, units), read_as)
            continue
        own = unit_of_column(motion, quantity, units)
        size = spread / factor(own, quantity)
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


def _too_good(
    joint: Joint, motion: str, rows: pd.DataFrame, spread: float, way: float, own: str,
    read_as: Mapping[str, ReadAs] | None,
) -> list[str]:  # fmt: skip
    """A note where error motions vary, or repeat, by less than those of any machine, and in which unit they would not.

    Parameters
    ----------
    spread : their range, mm or rad, over `way` (mm; 0 of a rotary joint).
    own : unit of their column.
    """
    linear = motion in TRANSLATIONS
    quantity: Literal["length", "angle"] = "length" if linear else "angle"
    values, n = rows[motion].to_numpy(dtype=np.float64), len(rows)
    side = rows[f"dir_{joint.name}"].to_numpy(dtype=np.float64) if f"dir_{joint.name}" in rows else np.zeros(n)
    run = rows["run"].to_numpy() if "run" in rows else np.zeros(n)
    scatter = repeatability(values, rows[joint.name].to_numpy(dtype=np.float64), side, run)
    least = LEAST_RANGE_MM + LEAST_RANGE_PER_MM * way if linear else LEAST_RANGE_RAD
    finest = LEAST_SCATTER_MM + LEAST_SCATTER_PER_MM * way if linear else LEAST_SCATTER_RAD
    small, fine = ROUND_OFF < spread < least and n >= MANY, ROUND_OFF < scatter < finest
    word, stated, _ = (read_as or {}).get(motion) or (motion, own, "")
    said, usual, names = factor(stated or own, quantity), usual_range(way, linear), LARGER_UNITS[not linear]
    sizes = {name: factor(name, quantity) / said for name in names}
    likely = sorted((u for u, k in sizes.items() if k > 1), key=lambda u: abs(math.log(sizes[u] / LIKELY)))
    fits = [u for u in likely if least <= sizes[u] * spread <= usual and not sizes[u] * scatter < finest]
    if not small and not (fine and fits):  # readings without noise are no matter of a unit
        return []
    shown, scale = ("um", 1e3) if linear else ("urad", 1e6)
    over = f" over {way:.4g} mm" if way else ""
    found = f"error motions {motion} of {joint.name} that vary by {scale * spread:.2g} {shown}{over}"
    found += f" and repeat to {scale * scatter:.2g} {shown}" if fine else ""
    limits = f"some {scale * least:.2g} and {scale * finest:.2g} {shown} are the least that any does"
    found += f": no machine is so good ({limits})"
    if not fits:
        return [f"{found}. Look for readings that were computed or made up, or a unit that is far too small"]
    option = f"write units: {{{motion}: {fits[0]}}} in a survey.yaml"
    option = option if read_as is None else f"import again with --units {word}={fits[0]}"
    size = f"{scale * spread * sizes[fits[0]]:.3g} {shown}"
    return [f"{found}. Read in {fits[0]}, not in {stated or own}, they vary by {size}: if they are, {option}"]


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
