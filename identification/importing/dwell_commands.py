"""Whether stretches in which a target stands still are dwells: in a dwell the machine stands still too.

A target in the centre of a turn stays while joints move, and so does the ball of an R-test at every pose. Rows of such
poses are readings, each with its own command.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from errormodel.arrays import Array, Index, Mask
from errormodel.chain import Chain
from errormodel.exceptions import InputError
from errormodel.machine import Machine
from errormodel.nominal import Nominal
from identification.importing.dwells import Dwells, find_dwells
from identification.importing.matching import DENSE, Matched
from identification.importing.sources import SourceFile
from identification.importing.words import LISTED, row_ranges
from identification.results.terminal import counted

ONE_PLACE = 1.0  # mm that commands reach: of an R-test on one ball they differ by the rounding of the axes only
FEWEST = 5  # dwells, to say so of a whole part of a log
MOSTLY = 0.8  # of its dwells
STAYS = 1e-4  # of a joint's travel: so far may it move within a dwell, as it was read back; by judgement


def dwells_of(points: Array, source: SourceFile, commands: SourceFile | None, chain: Chain) -> Dwells | None:
    """Dwells in what was measured (n, 3); None where every row is a reading of its own.

    Parameters
    ----------
    source : the measured file; without `commands` it holds the joints as well.
    commands : a list of poses; or a log of the way, row beside row where it has as many rows as were measured.
    """
    dwells = find_dwells(points)
    if dwells is None:
        return None
    if commands is None:
        return dwells if _stand(dwells, source, chain.machine).all() else None
    if commands.rows > 1 and float(np.linalg.norm(np.ptp(_path(commands, chain), axis=0))) < ONE_PLACE:
        return None  # the ball of an R-test, at which the target stays all the time
    seen = int(np.isfinite(points).any(axis=1).sum())
    if commands.rows == seen:
        return dwells_of_logs(dwells, commands, chain)
    commanded = find_dwells(_path(commands, chain))
    log = commanded is not None and commanded.moving > 0
    # of a list of poses, rows or dwells are as many as there are commands
    return dwells if log or abs(len(dwells) - commands.rows) <= abs(seen - commands.rows) else None


def dwells_of_logs(dwells: Dwells | None, commands: SourceFile, chain: Chain) -> Dwells | None:
    """Dwells in what was measured, where the commands of as many rows are a log of the way as well.

    None where either has no readings on the way: a list of poses, in which places may come several times.
    """
    if dwells is None or not dwells.moving:
        return None
    path = _path(commands, chain)
    commanded = find_dwells(path)
    if commanded is None or not commanded.moving:
        return None
    still = np.array([float(np.ptp(path[a : b + 1], axis=0).max()) for a, b in _middles(dwells)])
    turns = (still <= STAYS * float(np.ptp(path, axis=0).max())) & ~_stand(dwells, commands, chain.machine)
    return None if turns.any() else dwells


def rests_of(commands: SourceFile, chain: Chain) -> Index | None:
    """Rows of the commands, from 0, in the middle of each rest of a log of the way; None of a list of poses.

    A log repeats a command while the machine waits: readings are taken at these rests, and not between them.
    """
    joints = Nominal(chain, commands.recording.frame).joints
    joints = joints * [chain.size if j.type == "rotary" else 1.0 for j in chain.machine.joints]
    rests = find_dwells(joints)
    if rests is None or not rests.moving:
        return None
    moved = np.array([np.ptp(joints[a : b + 1], axis=0).max() for a, b in _middles(rests)])
    if (moved > STAYS * np.ptp(joints, axis=0).max()).any():
        return None
    return np.asarray((rests.first + rests.last) // 2)


def left_moving(
    matched: Matched, path: Array, command_times: Array, when: Array, dwells: Dwells, name: str
) -> tuple[Matched, list[str]]:
    """Dwells joined by time to a log of the way, without those in which the commands move: no rest, but a turn.

    Parameters
    ----------
    path : (m, 3) nominal points at the commands, mm; command_times : (m,) s.
    when : (n,) s, of all readings.
    name : of their file, for messages.

    Raises
    ------
    InputError
        They are all those from one row on, or up to one: there the clocks do not belong together.
    """
    own = matched.command >= 0
    if matched.offset is None or len(path) <= DENSE * len(dwells):
        return matched, []
    ends = np.array(_middles(dwells), dtype=np.intp).clip(0, len(when) - 1)
    low, high = (np.searchsorted(command_times, when[k] - matched.offset, side="right") - 1 for k in ends.T)
    far = STAYS * float(np.ptp(path, axis=0).max())
    parts = [path[max(a, 0) : b + 1] for a, b in zip(low, high, strict=True)]  # empty outside the log
    moved = np.array([float(np.ptp(p, axis=0).max()) if len(p) else 0.0 for p in parts])
    moving = own & (moved > far)
    if not moving.any() or moving.sum() > own.sum() / 2:  # most of them: the machine is late, or its commands are
        return matched, []
    rows = np.column_stack([dwells.first, dwells.last])[moving]
    _refuse_all_from_one(moving[own], rows, name)
    text = f"left out: {counted(len(rows), 'dwell')} in which the commands move ({row_ranges(rows)})"
    return replace(matched, command=np.where(moving, -1, matched.command)), [text]


def _refuse_all_from_one(moving: Mask, rows: Index, name: str) -> None:
    """InputError where the dwells in which the commands move are the last of a log, or the first."""
    count = int(moving.sum())
    last, first = moving[-count:].mean() > MOSTLY, moving[:count].mean() > MOSTLY
    if count < FEWEST or not (last or first):
        return
    what = f"from row {rows[0, 0] + 1} on" if last else f"up to row {rows[-1, 1] + 1}"
    raise InputError(
        name,
        f"{count} dwells {what}, nearly all there are, lie where the commands move: a clock was set there",
        "Import both parts by themselves, each with the rows of the other left out: --leave-out",
    )


def suspects(dwells: Dwells, commands: int) -> str:
    """Which dwells may be none, or may be lacking, where there are not as many as commands: in words, or empty."""
    sizes = dwells.last - dwells.first + 1
    more = len(dwells) - commands
    text = f"; turns of the way in {row_ranges(dwells.turning)} were taken for none" if len(dwells.turning) else ""
    if not 0 < more <= LISTED:
        return text
    least = np.sort(np.argsort(sizes, kind="stable")[:more])
    rows = np.column_stack([dwells.first, dwells.last])[least]
    of = f"{sizes[least].min()} to {sizes[least].max()}" if more > 1 else f"{sizes[least[0]]}"
    return f"; the shortest: {row_ranges(rows)}, of {of} readings where {int(np.median(sizes))} are usual{text}"


def at_rows(commands: SourceFile, rows: Index) -> SourceFile:
    """A file of commands with some of its rows only."""
    recording = commands.recording
    lines = tuple(recording.lines[k] for k in rows) if recording.lines else ()
    frame = recording.frame.iloc[rows].reset_index(drop=True)
    return replace(commands, recording=replace(recording, frame=frame, lines=lines, again=()))


def _path(commands: SourceFile, chain: Chain) -> Array:
    """Nominal points (n, 3) of the commands, mm."""
    return Nominal(chain, commands.recording.frame).points(np.asarray(chain.machine.tool))


def _middles(dwells: Dwells) -> list[tuple[int, int]]:
    """First and last row of the middle half of each dwell."""
    quarter = np.maximum((dwells.last - dwells.first) // 4, 1)
    middle = (dwells.first + dwells.last) // 2
    return [(int(m - q), int(m + q)) for m, q in zip(middle, quarter, strict=True)]


def _stand(dwells: Dwells, file: SourceFile, machine: Machine) -> np.ndarray:
    """Whether all joints stand still in the middle half of each dwell, (n,)."""
    stand = np.ones(len(dwells), dtype=bool)
    for joint in machine.joints:
        span = float(np.ptp(joint.travel))
        span = float(np.degrees(span)) if joint.type == "rotary" else span
        for name in joint.columns:
            if name not in file.recording.frame:
                continue
            values = file.column(name)
            stand &= [not np.ptp(values[a : b + 1]) > STAYS * span for a, b in _middles(dwells)]
    return stand
