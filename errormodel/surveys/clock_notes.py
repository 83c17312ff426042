"""Notes on times: that fall, by which a machine creeps or flies, as with another unit, or that a position follows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array
from errormodel.machine import Machine
from errormodel.path_speed import AT_REST_S, in_motion
from errormodel.row_order import label_numbers, measured_order

if TYPE_CHECKING:
    import pandas as pd

# time in which the fastest joint would cross its travel, s: on the fly none takes an hour, and none a tenth of a second
_CREEPS, _FLIES = 3600.0, 0.1
_DRIFTS, _FOLLOWS = 1800.0, 0.9  # s in which a machine warms up; share of a position's variance that time explains
_LONGER = "Times are in s; if these are in min or h, write units: {time: min} or {time: h} in survey.yaml"
_SELDOM, _ROWS = 2, 20  # times that a clock is set back, in as many rows at least: readings late in a log are more


def clock_notes(table: pd.DataFrame, machine: Machine) -> Iterator[str]:
    """Notes where times fall, or rows creep on a path that runs on, or any fly, or are read at rest too soon."""
    if "time" not in table:
        return
    steps = table["time"].groupby(label_numbers(table, ["file", "run"])).diff()
    if len(table) > 2 and (steps < 0).any() and not (steps > 0).any():
        yield (
            "column time: times fall from row to row, so that the rows are taken as measured from the last to the "
            "first. If this is the time that was left, write the time since the start"
        )
    elif 0 < (back := (steps < 0).to_numpy()).sum() <= _SELDOM and len(table) >= _ROWS:
        first = int(np.flatnonzero(back)[0])
        number = table["row"].iloc[first] if "row" in table else first + 1
        more = ", and once more" if back.sum() > 1 else ""
        yield (
            f"column time: before row {number} the time goes back by {-steps.iloc[first]:.4g} s{more}; rows are taken "
            "in the order of their times, but by `diagnose` where it finds that the clock was set back. If it was, "
            "give the rows behind a run of their own, or add to their times what it lost"
        )
    joints = [j for j in machine.joints if np.isfinite(table[j.name]).all() and np.ptp(table[j.name]) > 0]
    if not joints:
        return
    order = measured_order(table)
    time, series = table["time"].to_numpy(dtype=np.float64)[order], label_numbers(table, ["file", "run"])[order]
    path = [table[j.name].to_numpy(dtype=np.float64)[order] for j in joints]
    share = np.max(
        [np.abs(np.diff(q)) / (j.travel[1] - j.travel[0]) for q, j in zip(path, joints, strict=True)], axis=0
    )
    yield from _in_step_with_time(time, dict(zip((j.name for j in joints), path, strict=True)))
    moves = (series[1:] == series[:-1]) & (share > 0) & (np.diff(time) > 0)
    if not moves.any():
        return
    crossed = float(np.median(np.diff(time)[moves] / share[moves]))
    if crossed > _CREEPS and in_motion(path):
        yield (
            f"column time: rows seem to be read on the fly, but so slowly that the fastest joint would take "
            f"{crossed / 3600:.3g} h for its travel. Times are in s; if these are in ms, write units: {{time: ms}} in "
            "survey.yaml"
        )
    usual = float(np.median(np.diff(time)[moves]))
    if crossed < _FLIES:
        yield f"column time: from row to row the fastest joint would cross its travel in {crossed:.2g} s. {_LONGER}"
    elif usual < AT_REST_S and "joint" not in table and not in_motion(path, time):  # a switch is touched sooner
        yield (
            f"column time: rows that seem to be measured at rest are {usual:.2g} s apart (median), in which no machine "
            f"comes to the next position, settles and is read. {_LONGER}"
        )


def _in_step_with_time(time: Array, path: Mapping[str, Array]) -> Iterator[str]:
    """A note on joints that went through their travel once, while the hours passed."""
    known = np.isfinite(time)  # a file beside others may have none
    time, path = time[known], {name: q[known] for name, q in path.items()}
    if len(time) < _ROWS or (duration := float(np.ptp(time))) < _DRIFTS:
        return
    first, last = time <= time.min() + duration / 5, time >= time.max() - duration / 5
    for name, q in path.items():
        follows = float(np.corrcoef(time, q)[0, 1]) ** 2 if np.ptp(q) > 0 else 0.0
        again = q[first].max() >= q[last].min() and q[last].max() >= q[first].min()
        if follows > _FOLLOWS and not again:
            yield (
                f"the position of {name} follows the time ({100 * follows:.0f} % of its variance, over "
                f"{duration / 3600:.2g} h): what drifts meanwhile, or moves once, looks like an error of {name}, and "
                "this survey cannot tell them apart; stated uncertainties hold nothing of it. Measure the first "
                "positions again at the end, or the positions in random order"
            )
