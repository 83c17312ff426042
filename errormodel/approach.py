"""Directions in which joints approach the positions of a survey: by columns, or by the order of the rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Index, Mask
from errormodel.line_starts import line_starts
from errormodel.row_order import label_numbers, measured_order

if TYPE_CHECKING:
    import pandas as pd

JUMP_STEPS = 2.5  # times the median step between targets: a longer step back begins a new sequence; by judgement


def direction(table: pd.DataFrame, joint: str) -> Array:
    """Direction of approach of a joint: +1 from smaller positions, -1 from larger ones, (n,).

    It is that of the column ``dir_<joint>``; where the column is empty, that of the order of a file's rows (of their
    times where a run's rows are not in order). A joint at rest keeps its sign; before its first move it has the sign of
    that move; without any move it has +1. For rows about the joint's own error motions see `passes`.
    """
    if f"dir_{joint}" in table and not np.isnan(given := table[f"dir_{joint}"].to_numpy(dtype=np.float64)).any():
        return np.array(given)
    order, moved = _moves(table, joint)
    by_file = moved.groupby(label_numbers(table, ["file"])[order])
    derived = by_file.ffill().fillna(by_file.bfill()).fillna(1.0)
    result = np.empty(len(table))
    result[order] = derived.to_numpy()
    if "joint" in table:
        own = order[(table["joint"] == joint).to_numpy()[order]]
        file, runs = label_numbers(table, ["file"]), label_numbers(table, ["run"])
        for code in np.unique(file[own]):
            rows = own[file[own] == code]
            result[rows] = passes(table[joint].to_numpy(dtype=np.float64)[rows], runs[rows])
    if f"dir_{joint}" in table:
        result = np.where(np.isnan(given), result, given)
    return result


def assumed_sides(table: pd.DataFrame, joint: str) -> Index:
    """Which rows have a direction of approach that nothing states: those before a joint's first move in a file or run.

    Returns
    -------
    (n,) integers: from 1 the number of the series of rows, 0 where a column or a move states the direction, and where
    the joint never moves.
    """
    known, run = _known_by_moves(table, joint), label_numbers(table, ["file", "run"])
    result = np.where(~known & np.isin(run, run[known]), run + 1, 0)
    if f"dir_{joint}" in table:
        result[np.isfinite(table[f"dir_{joint}"].to_numpy(dtype=np.float64))] = 0
    return result


def starts_of_lines(table: pd.DataFrame, joint: str, joints: Sequence[str]) -> Mask:
    """Rows (n,) that begin a line of positions of all `joints`, along which this joint moves as it did not come there.

    Rows whose column ``dir_<joint>`` states the direction are none of them.
    """
    order, result = measured_order(table), np.zeros(len(table), dtype=np.bool_)
    places = table[[*joints]].to_numpy(dtype=np.float64)[order]
    along = line_starts(places, label_numbers(table, ["file", "run"])[order])[:, joints.index(joint)]
    result[order] = along * direction(table, joint)[order] < 0
    if f"dir_{joint}" in table:
        result &= np.isnan(table[f"dir_{joint}"].to_numpy(dtype=np.float64))
    return result


def unknown_sides(table: pd.DataFrame, joint: str) -> Mask:
    """Rows (n,) whose direction of approach neither a column nor a move of the joint in their run states."""
    unknown = ~_known_by_moves(table, joint)
    if f"dir_{joint}" in table:
        unknown &= np.isnan(table[f"dir_{joint}"].to_numpy(dtype=np.float64))
    return unknown


def passes(position: Array, run: Index) -> Array:
    """Direction of approach to the targets of a bidirectional test, +-1, from positions (n,) and runs (n,).

    In ISO 230-2 the joint overruns the last target and approaches it from the other side. Of a target at a reversal
    that is read twice as often as the others, the later half therefore belongs to the way back. For the same reason the
    first target of a run, and one that the joint jumps back to, has the direction of the targets after it.
    """
    starts = np.flatnonzero(np.diff(position, prepend=np.nan) != 0)
    counts = np.diff(np.append(starts, len(position)))
    steps = np.diff(position[starts])
    signs = np.sign(steps)
    if not len(signs):
        return np.ones(len(position))
    before, after = np.append(signs[0], signs), np.append(signs, signs[-1])
    inner = counts[1:-1][signs[1:] == signs[:-1]]
    usual = float(np.median(inner)) if len(inner) else float(counts.min())
    long = np.abs(steps) > JUMP_STEPS * np.median(np.abs(steps))
    out = np.repeat(before, counts)
    for k in np.flatnonzero(before != after):
        a, b = starts[k], starts[k] + counts[k]
        fresh = np.flatnonzero(np.diff(run[a - 1 : b])) if a else np.zeros(0, dtype=np.intp)
        around = signs[[k - 3, k - 2, k, k + 1]] if 2 < k < len(signs) - 1 else before[k : k + 1]
        if long[k - 1] and (around == after[k]).all():
            out[a:b] = after[k]
        elif len(fresh):
            out[a + fresh[-1] : b] = after[k]
        elif counts[k] >= 2 * usual:
            out[a + counts[k] // 2 : b] = after[k]
    return out


def _moves(table: pd.DataFrame, joint: str) -> tuple[Index, pd.Series]:
    """Rows in the order in which a joint came to them, and in this order the sign of its move to each; NaN at rest."""
    order, file = measured_order(table), label_numbers(table, ["file"])
    position = table[joint].iloc[order].groupby(file[order])
    return order, np.sign(position.ffill().groupby(file[order]).diff()).replace(0.0, np.nan)


def _known_by_moves(table: pd.DataFrame, joint: str) -> Mask:
    """Rows (n,) from a joint's first move in a file or run on."""
    import pandas as pd

    order, moved = _moves(table, joint)
    run = pd.Series(label_numbers(table, ["file", "run"])[order])
    # how it came to a run's first row, the end of the run before does not say
    moves = moved.reset_index(drop=True).mask(~run.duplicated()).notna()
    known = np.empty(len(table), dtype=np.bool_)
    known[order] = moves.groupby(run).cummax()
    return known
