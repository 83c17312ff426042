"""Detection of placeholders for missing values: -9999 and similar numbers, and 0, 0, 0 where no target was seen.

They are read as empty cells, with a note. A number within the range of the other values is a measurement.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from errormodel.conventions import MOTIONS
from errormodel.formats.base import spoken
from errormodel.surveys.columns import MEASURED, ORIENTATION

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# digits before and after the decimal point of such placeholders
_INTEGER_DIGITS, _DECIMAL_DIGITS = range(2, 8), range(5)
# 99.9, 999, 9999.99 ...: numbers of nines by which loggers mark a missing value
PLACEHOLDER_NINES = np.array(
    [float("9" * n + "." + "9" * k) for n in _INTEGER_DIGITS for k in _DECIMAL_DIGITS if n + k > 2]
)
FEWEST_OTHER_ROWS = 8  # fewest other rows from which their range is known; by judgement
IMPOSSIBLE_TEMPERATURE = 9999.0  # no temperature of a machine, in any unit
ABSOLUTE_ZERO = -273.15  # degC
RECORDED_COLUMNS = ("time", "feed", "load")  # columns that are recorded beside the measured ones
# distance of the point 0, 0, 0 from all others, as a share of their extent, from which on it was not seen
UNSEEN_DISTANCE_SHARE = 0.05
UNSEEN_DISTANCE_MM = 1.0  # the same in mm, at least; both by judgement


def without_nines(
    columns: Mapping[str, Array], joints: Sequence[str], rows: Array
) -> tuple[dict[str, Array], list[str]]:
    """Measured and recorded columns with NaN for 999, -9999, -999.9 and similar numbers, and notes.

    Such a number is a placeholder where it is repeated to the last digit farther from all other values than their
    range, or stands in all of mx my mz. It is a measurement where a joint was commanded to that position in its row. In
    a recorded column (T_*, w_*, time, feed, load) a single cell is sufficient.

    Parameters
    ----------
    columns : the columns of numbers by name, in the user's units.
    joints : names of the columns with commands.
    rows : number of each row in its file, from 1.
    """
    out, notes = dict(columns), list[str]()
    known = (*MEASURED, *ORIENTATION, *MOTIONS, *RECORDED_COLUMNS)
    names = [n for n in columns if n in known or n.startswith(("T_", "w_"))]
    nines = {n: found for n in names if (found := np.isin(np.abs(columns[n]), PLACEHOLDER_NINES)).any()}
    if not nines:
        return out, notes
    said: dict[tuple[float, bytes], list[str]] = {}
    for name, found in nines.items():
        for value in np.unique(columns[name][found]):
            here = columns[name] == value
            for joint in joints:
                here &= np.abs(columns.get(joint, np.zeros(len(rows)))) != abs(value)
            others = columns[name][np.isfinite(columns[name]) & ~found]
            if name in RECORDED_COLUMNS or name.startswith(("T_", "w_")):
                here &= _no_record(name, float(value), columns[name], others)
            else:
                here &= _all_three(columns, value) | bool(here.sum() > 1 and _far(value, others, int(here.sum())))
            if here.any():
                out[name] = np.where(here, np.nan, out[name])
                said.setdefault((float(value), here.tobytes()), []).append(name)
    for (value, mask), own in said.items():
        notes.append(_note(f"{value:.10g}", own, rows[np.frombuffer(mask, dtype=bool)]))
    return out, notes


def _no_record(name: str, value: float, column: Array, others: Array) -> Mask | bool:
    """Mask of cells whose number is impossible for a recorded column; times increase, and a feed may be 9999 mm/min."""
    if name in RECORDED_COLUMNS and value < 0:
        return not (others < 0).any()
    if name == "feed":
        return False
    far = _far(value, others, int((column == value).sum()))
    if name == "time":
        return far & (np.fmin.accumulate(column[::-1])[::-1] < column)
    return far or (name.startswith("T_") and abs(value) >= IMPOSSIBLE_TEMPERATURE)


def below_absolute_zero(frame: pd.DataFrame) -> Iterator[tuple[str, Mask, str]]:
    """Temperature columns with cells below absolute zero, the mask of these cells, and a note.

    Parameters
    ----------
    frame : one file, temperatures in degC, with ``row``.
    """
    for name in (n for n in map(str, frame.columns) if n.startswith("T_")):
        cold = frame[name].to_numpy(dtype=np.float64) < ABSOLUTE_ZERO - 1e-6
        if cold.any():
            rows = spoken(frame["row"].to_numpy()[cold].tolist())
            yield name, cold, f"less than {ABSOLUTE_ZERO} degC, absolute zero, in {name} of {rows} read as not measured"


def _all_three(columns: Mapping[str, Array], value: float) -> Mask | bool:
    if not all(name in columns for name in MEASURED):
        return False
    return np.asarray(np.logical_and.reduce([columns[name] == value for name in MEASURED]))


def _far(value: float, others: Array, count: int) -> bool:
    """Whether a value is farther from all others than their range; with few others it cannot be decided."""
    if len(others) < FEWEST_OTHER_ROWS:
        return not len(others) and count >= FEWEST_OTHER_ROWS  # a component that was never measured
    return bool(np.abs(others - value).min() > np.ptp(others))


def zeros(frame: pd.DataFrame, joints: Sequence[str]) -> Iterator[tuple[Mask, str]]:
    """Mask of rows with mx my mz all exactly 0 though no other point is near, and a note.

    Parameters
    ----------
    frame : one file in mm and rad, with ``row``.
    joints : names of the machine's joints.
    """
    if not all(name in frame for name in MEASURED):
        return
    points = frame[list(MEASURED)].to_numpy(dtype=np.float64)
    seen, zero = np.isfinite(points).all(axis=1), (points == 0).all(axis=1)
    others = points[seen & ~zero]
    if not zero.any() or len(others) < FEWEST_OTHER_ROWS:
        return
    extent, nearest = float(np.linalg.norm(np.ptp(others, axis=0))), float(np.linalg.norm(others, axis=1).min())
    commands = frame.loc[zero, [j for j in joints if j in frame]].drop_duplicates()
    if nearest > extent or (len(commands) > 1 and nearest > max(UNSEEN_DISTANCE_SHARE * extent, UNSEEN_DISTANCE_MM)):
        yield zero, _note("0", MEASURED, frame["row"].to_numpy()[zero])


def zero_orientations(frame: pd.DataFrame, rotary: Sequence[str]) -> Iterator[tuple[Mask, str]]:
    """Mask of rows with mrx mry mrz all exactly 0 though no orientation of the same rotary positions is near; a note.

    Parameters
    ----------
    frame : one file in mm and rad, with ``row``.
    rotary : names of the machine's rotary joints.
    """
    if not all(name in frame for name in ORIENTATION):
        return
    vectors = frame[list(ORIENTATION)].to_numpy(dtype=np.float64)
    zero = (vectors == 0).all(axis=1)
    turned = frame[[j for j in rotary if j in frame]].to_numpy(dtype=np.float64)
    unseen = np.zeros_like(zero)
    for at in np.unique(turned[zero], axis=0):
        here = (turned == at).all(axis=1)
        others = vectors[here & ~zero & np.isfinite(vectors).all(axis=1)]
        if len(others) < FEWEST_OTHER_ROWS:
            continue
        extent, nearest = np.linalg.norm(np.ptp(others, axis=0)), np.linalg.norm(others, axis=1).min()
        unseen |= here & zero & bool(nearest > extent)
    if unseen.any():
        yield unseen, _note("0", ORIENTATION, frame["row"].to_numpy()[unseen])


def _note(value: str, names: Sequence[str], rows: Array) -> str:
    return f"{value} in {' '.join(names)} of {spoken(rows.tolist())} read as not measured"
