"""Speed of each joint on the path of the commanded positions, from the feed, the order of the rows and their times.

A control takes the feed as the speed along the path (F of ISO 6983), of which each joint has its share. The path is
that of the linear axes; where only rotary ones move it is in degrees, and the feed in degrees per minute. The path's
direction in a row is that of the step to it or, where it runs on through the row, of the steps before and after. Where
many steps took the time that the feed lets expect, rows were read in motion, and the times say how fast: at the ends of
a line the feed is not reached, and a row that was read at rest has no speed.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Index, Mask
from errormodel.path_steps import RUNS_ON, STANDS, PathSteps, directions

if TYPE_CHECKING:
    from errormodel.machine import Machine

SPEED_CHANNEL = re.compile(r"speed\(([^|]+)\|([^|]*)\|([^|]*)\)")
RATE_CHANNEL = re.compile(r"rate\((.+)\)")
AT_FEED = 0.9, 1.1  # of the feed: a step that was made at it; by judgement
IN_MOTION = 0.2  # share of such steps, or of quick ones, from which on rows were read in motion; by judgement
SHARE_RUNS_ON = 0.5  # of the rows, through which a path runs on that is not stopped at each; by judgement
AT_REST_S = 1.0  # a pose at rest takes longer to come to, to settle at and to read; by judgement
FASTEST = 1.2  # times the feed: faster was no feed; by judgement, since times are rounded
PAUSE = 0.5  # ratio of the rates of two steps, below which the slower one had a pause in it; by judgement
SIDEWAYS = 0.3  # share of a step that a joint may go against its side: on a curve it turns round between two rows


def speed_name(machine: Machine, joint: str) -> str:
    """Name of the channel of a joint's speed on the path, mm/s or rad/s with its sign: ``speed(X|X,Y,Z|A,C)``."""
    linear, turning = (",".join(j.name for j in machine.joints if j.type == kind) for kind in ("prismatic", "rotary"))
    return f"speed({joint}|{linear}|{turning})"


def rate_name(joint: str) -> str:
    """Name of the channel of a joint's speed by the clock, mm/s or rad/s: ``rate(X)``."""
    return f"rate({joint})"


def joint_of_speed(name: str) -> str | None:
    """The joint of which a channel is the speed, on the path or by the clock; None of other channels."""
    found = SPEED_CHANNEL.fullmatch(name) or RATE_CHANNEL.fullmatch(name)
    return found[1] if found else None


def path_speed(position: Array, linear: Mask, feed: Array, side: Array, time: Array, series: Index) -> Array:
    """Speed of every joint in every row, (n, joints), mm/s and rad/s.

    Parameters
    ----------
    position : commanded positions (n, joints), mm and rad, in the order in which they were reached.
    linear : which joints are prismatic (joints,).
    feed : along the path (n,), mm/min, and deg/min where only rotary joints move.
    side : direction in which each joint came to each row (n, joints), +-1.
    time : of the rows (n,), s; NaN where it is not known.
    series : number of the series of rows (n,) that each belongs to; from one to another there is no step.
    """
    whole = PathSteps.of(position, series)
    starts, place, steps, ways = whole.first, whole.place, whole.steps, whole.directions
    took = np.full(len(steps), np.nan)
    took[1:-1][whole.joined] = (time[starts[1:]] - time[whole.after[:-1] - 1])[whole.joined]
    length = _length(steps, linear)
    pace = feed / 60
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = np.where(took > 0, length / took, np.nan) / np.append(pace[starts], np.inf)  # of the feed
    known = np.isfinite(rate[:-1])
    moving = known.any() and np.mean((rate[:-1][known] > AT_FEED[0]) & (rate[:-1][known] < AT_FEED[1])) > IN_MOTION
    before, after = slice(None, -1), slice(1, None)
    came = side[starts]
    forth = [(length[s] > 0) & (ways[s] * came >= -SIDEWAYS).all(axis=1) for s in (before, after)]
    straight = whole.cosine
    if moving:
        weight = [np.where(rate[s] < FASTEST, np.minimum(rate[s], 1.0), 0.0) for s in (before, after)]
    else:
        weight = [1.0 + np.append(1.0, straight[:-1]), 1.0 + np.append(straight[1:], -1.0)]
    weight = [w * f for w, f in zip(weight, forth, strict=True)]
    through = (straight > RUNS_ON) & (np.minimum(*weight) > (PAUSE * np.maximum(*weight) if moving else 0.0))
    use = [through | (weight[0] >= weight[1]), through | (weight[0] < weight[1])]
    path = np.asarray(sum(u[:, None] * steps[s] for u, s in zip(use, (before, after), strict=True)))
    way, lasted = (
        sum(np.where(u, v[s], 0.0) for u, s in zip(use, (before, after), strict=True)) for v in (length, took)
    )
    pace_here = pace
    if moving:
        with np.errstate(divide="ignore", invalid="ignore"):
            timed = (np.where(lasted > 0, way / lasted, np.inf))[place]
        pace_here = np.fmin(timed, pace)
    along = _length(path, linear)
    share = path / np.where(along > 0, along, 1.0)[:, None]
    contrary = ~(forth[0] | forth[1])
    share[contrary] = np.abs(share[contrary]) * came[contrary]
    return np.asarray(pace_here[:, None] * share[place])


def clock_speed(position: Array, time: Array, series: Index) -> Array:
    """Speed of a joint in every row (n,) by the clock, mm/s or rad/s: derivative of a cubic spline through its rows.

    Parameters
    ----------
    position : commanded positions (n,), mm or rad, in the order of the times.
    time, series : as in `path_speed`; of rows at one time, and of a series of one row, the speed is 0.
    """
    from scipy.interpolate import CubicSpline

    out = np.zeros(len(position))
    for label in np.unique(series):
        rows = np.flatnonzero(series == label)
        rows = rows[np.concatenate([[True], np.diff(time[rows]) > 0])]
        if len(rows) > 1:
            # central differences of rows some seconds apart are a few per cent too slow
            out[rows] = CubicSpline(time[rows], position[rows])(time[rows], 1)
    return out


def in_motion(position: Sequence[Array], time: Array | None = None) -> bool:
    """Whether rows seem to be read on the fly: their path runs on through most, and several joints (n,) each move.

    Where one joint moves at a time, as on lines, only times (n,), s, tell: a pose at rest takes a second and more.
    """
    if len(position) < 2 or len(position[0]) < 3:
        return False
    path = np.column_stack(position)
    steps = directions(np.diff(path, axis=0), path)
    straight = np.einsum("nj,nj->n", steps[1:], steps[:-1])
    together = np.mean(np.count_nonzero(steps, axis=1) > 1) > SHARE_RUNS_ON
    moved = steps.any(axis=1)
    quick = time is not None and moved.any() and np.mean(np.diff(time)[moved] < AT_REST_S) > IN_MOTION
    return bool(np.mean(straight > RUNS_ON) > SHARE_RUNS_ON and (together or quick))


def _length(steps: Array, linear: Mask) -> Array:
    """Length of each step's path (n,): of the linear joints, mm; where these stand, of the others, degrees."""
    slid = np.linalg.norm(steps[:, linear], axis=1)
    turned = np.degrees(np.linalg.norm(steps[:, ~linear], axis=1))
    return np.asarray(np.where(slid > STANDS, slid, turned))
