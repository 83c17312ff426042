"""Candidate poses of a plan: a low-discrepancy sequence plus ends and middles of the travels, reachable and visible.

Positions of a joint are irregular, so that no period of a screw or scale is a multiple of their steps. Units: mm, rad.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from errormodel.arrays import Array, Mask
from errormodel.chain import TOOL_CHANNELS, Chain
from errormodel.channels import root
from errormodel.exceptions import InputError
from errormodel.instruments.base import Instrument
from errormodel.instruments.plain import Plain
from errormodel.surveys.columns import MEASURED, SIGMA_COLUMNS

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.survey import Survey
    from identification.planning.setup import Setup

SCATTERED_POSES = 1024  # poses of the low-discrepancy sequence per block
MOST_CORNER_POSES = 729  # combinations of ends and middles: all for six joints or fewer
END_SHIFT_SHARE = 0.03  # largest distance of a pose from an end or the middle, as a share of the travel; by judgement
POSE_BLOCKS_TRIED = 64  # blocks of poses searched for allowed ones


def candidates(chain: Chain, setup: Setup, seed: int) -> tuple[pd.DataFrame, int]:
    """Candidate poses (mm, rad) with tools, and the number of those, the first, that are evenly distributed.

    Raises
    ------
    InputError
        No pose is reachable and visible.
    """
    import pandas as pd

    rng = np.random.default_rng(seed)
    corners = _corners(len(chain.machine.joints), rng)
    corners = np.where(corners < 0.5, 0.0, np.where(corners > 0.5, 1.0, 0.5)) + END_SHIFT_SHARE * _inward(corners, rng)
    parts: list[pd.DataFrame] = []
    scattered = 0
    for block in np.split(
        _even(POSE_BLOCKS_TRIED * SCATTERED_POSES, len(chain.machine.joints), rng), POSE_BLOCKS_TRIED
    ):
        table = _within(chain, setup, block, rng)
        parts.append(table[allowed(chain, setup, table)])
        scattered += len(parts[-1])
        if scattered >= SCATTERED_POSES // 2:
            break
    table = _within(chain, setup, corners, rng)
    table = pd.concat([*parts, table[allowed(chain, setup, table)]], ignore_index=True)
    if not len(table):
        found = f"no pose of {POSE_BLOCKS_TRIED * SCATTERED_POSES} is reachable, visible and outside the boxes to avoid"
        raise InputError("--setup", found, "Make `avoid` smaller or `incidence` larger, or move the station")
    return table, scattered


def volume(chain: Chain, setup: Setup, seed: int) -> pd.DataFrame:
    """Poses (mm, rad) over the allowed travels, ends included, at which predictions are wanted, measurable or not."""
    import pandas as pd

    rng = np.random.default_rng([seed, 1])
    scattered = _even(SCATTERED_POSES // 2, len(chain.machine.joints), rng)
    corners = _corners(len(chain.machine.joints), rng)
    return pd.concat([_within(chain, setup, part, rng) for part in (corners, scattered)], ignore_index=True)


def _even(count: int, joints: int, rng: np.random.Generator) -> Array:
    """Low-discrepancy sequence (count, joints), 0 to 1: multiples of square roots of primes, from a random start."""
    primes = [n for n in range(2, 20 * joints) if all(n % k for k in range(2, n))][:joints]
    return np.asarray((rng.uniform(size=joints) + np.outer(np.arange(count), np.sqrt(primes))) % 1.0)


def _corners(joints: int, rng: np.random.Generator) -> Array:
    """Combinations of ends and middles of all joints, 0 to 1: all, or a random sample of them."""
    if 3**joints <= MOST_CORNER_POSES:
        return np.array(list(itertools.product([0.0, 0.5, 1.0], repeat=joints)))
    return np.asarray(rng.integers(0, 3, (MOST_CORNER_POSES, joints)) / 2)


def _inward(corners: Array, rng: np.random.Generator) -> Array:
    """Random shifts, 0 to 1, into the travel."""
    shift = rng.uniform(0.05, 1.0, corners.shape)
    return np.where(corners == 1.0, -shift, np.where(corners == 0.0, shift, rng.uniform(-1, 1, corners.shape)))


def _within(chain: Chain, setup: Setup, part: Array, rng: np.random.Generator) -> pd.DataFrame:
    """Table of poses, mm and rad, from positions 0 to 1 of the allowed travels, with random tools."""
    import pandas as pd

    columns = {}
    for joint, share in zip(chain.machine.joints, part.T, strict=True):
        low, high = setup.allowed(joint)
        position = low + (high - low) * share
        turns = joint.type == "rotary"  # rounded to 0.01 mm or 0.001 degrees, for short programs
        short = np.radians(np.round(np.degrees(position), 3)) if turns else np.round(position, 2)
        columns[joint.name] = np.clip(short, low, high)
    table = pd.DataFrame(columns)
    tools = setup.points(chain.machine)
    table[list(TOOL_CHANNELS)] = tools[rng.integers(0, len(tools), len(part))]
    return table


def allowed(chain: Chain, setup: Setup, table: pd.DataFrame) -> Mask:
    """Mask (n,) of poses that face the station and keep tool and line of sight outside all boxes."""
    fine = np.ones(len(table), dtype=bool)
    if not setup.avoid and setup.sight is None:
        return fine
    rows = chain.columns(assumed(chain, setup, table))
    pose = chain.kernel("nominal")(rows)
    point, turn = pose[:3].T, pose[3:].reshape(3, 3, -1).T  # (n, 3), (n, 3, 3)
    tool = table[list(TOOL_CHANNELS)].to_numpy(dtype=np.float64)
    lines = [(point - np.einsum("nij,nj->ni", turn, tool), point)]
    if setup.sight is not None:
        station = np.array(setup.sight.station)
        lines.append((point, np.broadcast_to(station, point.shape)))
        if setup.sight.facing is not None:
            sight = station - point
            axis = turn @ np.array(setup.sight.facing)
            cosine = np.einsum("ni,ni->n", sight, axis)
            fine &= cosine >= np.cos(np.radians(setup.sight.incidence)) * np.linalg.norm(
                sight, axis=1
            ) * np.linalg.norm(setup.sight.facing)
    for box, (start, end) in itertools.product(setup.avoid, lines):
        fine &= ~crosses(box.sides(), start, end)
    return fine


def crosses(sides: Array, start: Array, end: Array) -> Mask:
    """Mask (n,) of straight lines from `start` to `end`, each (n, 3) mm, that enter the box with sides (3, 2) mm."""
    step = end - start
    with np.errstate(divide="ignore", invalid="ignore"):
        first, last = ((sides[:, k] - start) / step for k in (0, 1))
    still = step == 0
    inside = (start > sides[:, 0]) & (start < sides[:, 1])
    enter = np.where(still, np.where(inside, -np.inf, np.inf), np.fmin(first, last)).max(axis=1)
    leave = np.where(still, np.where(inside, np.inf, -np.inf), np.fmax(first, last)).min(axis=1)
    return np.asarray((enter < leave) & (enter < 1) & (leave > 0))


def assumed(chain: Chain, setup: Setup, table: pd.DataFrame) -> pd.DataFrame:
    """The table with assumed values of the model's other channels: time at the given pace, temperatures, feed, load.

    The first sensor warms up exponentially by 5 K; further ones oscillate by 5 K with one, two ... periods.
    """
    part = np.arange(len(table)) / max(len(table) - 1, 1)
    columns = {"time": setup.pace * np.arange(len(table))}
    words = {root(name) for name in chain.channels} - set(table)
    sensors = [*setup.sensors, *sorted(w for w in words if w.startswith("T_") and w not in setup.sensors)]
    for k, name in enumerate(sensors):
        course = 1 - np.exp(-3 * part) if k == 0 else (1 - np.cos(2 * np.pi * k * part)) / 2
        columns[name] = 20.0 + 5.0 * course
    for k, name in enumerate(sorted(w for w in words if w in ("feed", "load") or w.startswith("w_"))):
        columns[name] = np.arange(len(table)) % (k + 2) * 1.0
    return table.assign(**columns)


def as_survey(chain: Chain, setup: Setup, table: pd.DataFrame, noise: Instrument | float) -> Survey:
    """The poses as a survey of the nominal machine, with the instrument's or a constant uncertainty `noise` (mm)."""
    from errormodel.survey import Survey

    table = assumed(chain, setup, table)
    nominal = chain.kernel("nominal", outputs=(0, 1, 2))(chain.columns(table))
    table = table.assign(**dict(zip(MEASURED, nominal, strict=True)), run="1", file="plan", role="fit")
    table["row"] = np.arange(1, len(table) + 1)
    instrument: Instrument = Plain()
    if isinstance(noise, Instrument):
        instrument = noise
    else:
        table[list(SIGMA_COLUMNS)] = noise
    survey = Survey(table, setup.frame, ("frame",), instrument, Path("plan"))
    if not setup.observations:
        return survey
    from identification.planning.readings import read_by

    return read_by(chain, setup, survey, noise)
