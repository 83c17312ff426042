"""Rows of a join that stand in another order: two exchanged, several that changed places, all of a few shifted."""

from __future__ import annotations

import numpy as np

from errormodel.arrays import Index
from errormodel.exceptions import InputError
from errormodel.survey import Survey
from identification.diagnosis.data_checks.blunder import Points, listed

FEWEST_PROVED = 5  # rows, of which an exchange of two shows: three fit any frame, four nearly
MANY = 16  # rows, from which on those that changed places stand out, and the diagnosis looks for other orders
BETTER = 10.0  # times nearer, in the other order
SMALL = 0.01  # mm: what lies so near has no mistake worth a refusal
FAR = 6.0  # times the distance of four in five rows: a row so far from its command may have another one
CURE = "Join with --match nearest or name, or give the commands that were measured"


def refuse_few_exchanged(parts: list[tuple[Index, Points]], survey: Survey, most: float) -> None:
    """InputError where two rows of a few fit each other's commands, or all of them are shifted.

    Parameters
    ----------
    parts : rows of the survey that share a frame, with their points.
    most : of the points' reach: so far may points lie from their commands that belong to them.
    """
    for rows, part in parts:
        if FEWEST_PROVED <= len(part) < MANY and (found := _of_few(part, _numbers(survey, rows), most)):
            raise InputError(_file(survey, rows), found, CURE)


def refuse_exchanged(parts: list[tuple[Index, Points]], survey: Survey, most: float) -> None:
    """InputError where rows far from their own commands fit those of each other; parameters as above."""
    for rows, part in parts:
        if len(part) >= FEWEST_PROVED and (found := places_changed(part, _numbers(survey, rows), most)):
            raise InputError(_file(survey, rows), found, CURE)


def _file(survey: Survey, rows: Index) -> str:
    return str(survey.table["file"].iloc[rows[0]])


def _numbers(survey: Survey, rows: Index) -> list[int]:
    """Rows by their numbers in the survey's file, from 1."""
    return [int(k) for k in survey.table["row"].iloc[rows]]


def places_changed(part: Points, numbers: list[int], most: float) -> str:
    """Rows far from their own commands that fit those of each other, in words; empty where there are none."""
    from scipy.optimize import linear_sum_assignment

    pose = part.pose()
    at = pose.apply(part.nominal)
    distance = np.linalg.norm(part.measured - at, axis=1)
    usual = max(float(np.quantile(distance, 0.8)), SMALL / FAR)
    far = np.flatnonzero(distance > FAR * usual)
    if not 2 <= len(far) <= len(part) / 2 or usual > most * part.reach:
        return ""
    apart = np.linalg.norm(part.measured[far][:, None] - at[far][None], axis=2)
    own, other = linear_sum_assignment(apart)
    moved = far[own[own != other]]
    if len(moved) < 2:
        return ""
    after, before = apart[own, other][own != other], distance[moved]
    # the middle distance is that of a row without mistakes, which 80 % of all keep within
    good = (after < FAR * usual) & (after < before / 2)
    if good.sum() < 2 or float(np.median(after)) > float(np.median(before)) / BETTER:
        return ""
    rows = listed([numbers[k] for k in moved[good]])
    what = "are exchanged" if good.sum() == 2 else "are in another order"
    return (
        f"rows {rows} {what}: on each other's commands they lie {1e3 * float(np.max(after[good])):.0f} um off at most, "
        f"as they stand {float(np.min(before[good])):.3g} mm at least"
    )


def _of_few(part: Points, numbers: list[int], most: float) -> str:
    """Of few rows none stands out: every exchange of two and every shift is tried."""
    n = len(part)
    before = _rms(part)
    pairs = [(i, j) for i in range(n) for j in range(i + 1, n)]
    tries = [(f"rows {numbers[i]} and {numbers[j]} are exchanged", _swap(n, i, j)) for i, j in pairs]
    tries += [(f"the rows are shifted by {k}", np.roll(np.arange(n), k)) for k in range(1, n)]
    after, text = min((_rms(part.reordered(order)), text) for text, order in tries)
    if after < before / BETTER and after < most * part.reach and before > SMALL:
        return f"{text}: so the points lie {1e3 * after:.0f} um from the commands, as they stand {before:.3g} mm"
    return ""


def _swap(n: int, i: int, j: int) -> Index:
    order = np.arange(n)
    order[[i, j]] = j, i
    return order


def _rms(part: Points) -> float:
    """Root mean square distance (mm) in the best frame of all points alike."""
    return float(np.sqrt(np.mean(part.distances(part.pose(rounds=0)) ** 2)))
