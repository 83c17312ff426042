"""Directions in which joints approach the positions of a survey: by columns, or by the order of the rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Index, Mask
from errormodel.line_starts import line_starts
from errormodel.read_again import read_again
from errormodel.row_order import label_numbers, measured_order
from errormodel.surveys.columns import TOOL_COLUMNS

if TYPE_CHECKING:
    import pandas as pd

CORRELATED = 0.5  # of a column with the readings in question: from there on it distinguishes them; by judgement
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


def one_way_each(sides: Array, labels: Array) -> bool:
    """Whether rows (n,) came from both sides, but those of each label from one side only."""
    codes = np.unique(labels.astype(str), return_inverse=True)[1]
    return len(np.unique(sides)) > 1 and len(np.unique(np.stack([codes, sides]), axis=1).T) == len(np.unique(codes))


def assumed_sides(table: pd.DataFrame, joint: str) -> Index:
    """Which rows have a direction of approach that nothing states: those before a joint's first move in a file or run.

    Returns
    -------
    (n,) integers: from 1 the number of the series of rows, 0 where a column or a move states the direction, and where
    the joint never moves.
    """
    known, run = _known_by_moves(table, joint), label_numbers(table, ["file", "run"])
    return np.where(~known & np.isin(run, run[known]) & unstated(table, joint), run + 1, 0)


def starts_of_lines(table: pd.DataFrame, joint: str, joints: Sequence[str]) -> Mask:
    """Rows (n,) that begin a line of positions of all `joints`, along which this joint moves as it did not come there.

    Rows whose column ``dir_<joint>`` states the direction are none of them.
    """
    order, result = measured_order(table), np.zeros(len(table), dtype=np.bool_)
    places = table[[*joints]].to_numpy(dtype=np.float64)[order]
    along = line_starts(places, label_numbers(table, ["file", "run"])[order])[:, joints.index(joint)]
    result[order] = along * direction(table, joint)[order] < 0
    return result & unstated(table, joint)


def from_other_side(table: pd.DataFrame, joint: str, joints: Sequence[str], recorded: Sequence[str]) -> list[Mask]:
    """Rows (n,) that may be readings of a target from the other side; see `read_again`.

    Parameters
    ----------
    joints : all of the machine.
    recorded : other columns; readings that one of these distinguishes are not distinguished by the side.
    """
    order, tool = measured_order(table), [name for name in TOOL_COLUMNS if name in table]
    position, tools = (table[[*names]].to_numpy(dtype=np.float64)[order] for names in (joints, tool))
    series = label_numbers(table, ["file", "run"])[order]
    others = [v - v.mean() for v in (table[name].to_numpy(dtype=np.float64)[order] for name in recorded) if np.ptp(v)]
    result = []
    for again, targets in read_again(position, tools, joints.index(joint), series):
        turned = np.where(again, 1.0, -1.0)[targets]
        if not any(abs(np.corrcoef(v[targets], turned)[0, 1]) > CORRELATED for v in others if np.ptp(v[targets])):
            rows = np.zeros(len(table), dtype=np.bool_)
            rows[order] = again
            result.append(rows & unstated(table, joint))
    return result


def unknown_sides(table: pd.DataFrame, joint: str) -> Mask:
    """Rows (n,) whose direction of approach neither a column nor a move of the joint in their run states."""
    return ~_known_by_moves(table, joint) & unstated(table, joint)


def unstated(table: pd.DataFrame, joint: str) -> Mask:
    """Rows (n,) whose direction of approach no column ``dir_<joint>`` states."""
    if f"dir_{joint}" not in table:
        return np.ones(len(table), dtype=np.bool_)
    return np.asarray(np.isnan(table[f"dir_{joint}"].to_numpy(dtype=np.float64)))


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
