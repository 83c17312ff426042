"""Cuts divided where the correction bends, so that straight lines between corrected points follow it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.setup import Setup
from errormodel.gcode.paths import Line
from errormodel.gcode.steps import Step

Correct = Callable[[Array, Array], Array]
"""Commands for wanted positions and directions of arrival, all (n, axes), mm and deg."""

BEND = 0.0002  # mm or deg, by which a straight piece may miss the curve of the correction
LARGEST = 1.0  # mm or deg: what is larger is no compensation
LONGEST = 10_000  # pieces of one block
FINER = 6  # times the samples are doubled before a block is refused


@dataclass(frozen=True)
class Run:
    """Part of a path along which every axis keeps its direction.

    Attributes
    ----------
    share : (k,) of the length, rising; `corrected` : (k, axes) commands there.
    came : (axes,) of +-1.
    """

    share: Array
    corrected: Array
    came: Array


def known(q: Array) -> Array:
    """Positions with 0 for what is not known: it is not known only where it does not matter."""
    return np.where(np.isfinite(q), q, 0.0)


def directions(before: Array, step: Array) -> Array:
    """Directions (axes,) along a step; axes that never moved count as coming from below."""
    moved = np.abs(step) > 1e-9
    kept = np.where(before != 0, before, 1.0)
    return np.where(moved, np.sign(step), kept)


def runs_of(step: Step) -> list[tuple[Array, Array]]:
    """Shares between which directions are kept, with the directions (axes,)."""
    if step.path is None:
        return []
    corners, came, out = step.path.corners(), step.came, []
    for a, b in zip(corners[:-1], corners[1:], strict=True):
        ends = step.path.at(np.array([a, b]))
        moved = ends[1] - ends[0]
        out.append((np.array([a, b]), directions(came, moved)))
        came = np.where(np.abs(moved) > 1e-9, np.sign(moved), came)
    return out


def first_samples(path: Line, a: float, b: float, setup: Setup) -> int:
    """Intervals to sample between two shares: four in each that the errors along an axis need, and an arc's chords."""
    moved = np.abs(np.diff(path.at(np.array([a, b])), axis=0)[0])
    needed = [moved[k] / (x.measured[1] - x.measured[0]) * x.intervals for k, x in enumerate(setup.axes)
              if x.measured[1] > x.measured[0]]  # fmt: skip
    most = max(needed, default=0.0)
    chords = int(np.ceil(path.pieces() * (b - a)))  # more than LONGEST: refused with its block
    return int(max(2, min(np.ceil(4 * most), LONGEST), chords))


def divided(steps: Sequence[Step], setup: Setup, correct: Correct) -> list[list[Run]]:
    """Runs of the paths of cuts (of steps that have one), each with the points between which the correction is straight.

    All blocks are corrected together, then those again, twice as fine, whose samples do not show how it bends.

    Raises
    ------
    InputError
        A correction is too large, or bends too often.
    """
    out: list[list[Run]] = [[] for _ in steps]
    open_ = [(k, n, ends, came, first_samples(s.path, *ends, setup))
             for k, s in enumerate(steps) if s.path is not None
             for n, (ends, came) in enumerate(runs_of(s))]  # fmt: skip
    found: dict[tuple[int, int], Run] = {}
    for k, *_, count in open_:
        if count > LONGEST:
            steps[k].block.refuse(f"an arc of {count} chords, and {LONGEST} is the most", "Divide it")
    for _ in range(FINER + 1):
        if not open_:
            break
        shares = [np.linspace(*ends, 2 * count + 1) for _, _, ends, _, count in open_]
        points = [steps[k].path.at(s) for (k, *_), s in zip(open_, shares, strict=True)]  # type: ignore[union-attr]
        came = [np.tile(c, (len(s), 1)) for (_, _, _, c, _), s in zip(open_, shares, strict=True)]
        wanted = known(np.vstack(points))
        moved = correct(wanted, np.vstack(came)) - wanted
        again, at = [], 0
        for (k, n, ends, sign, count), share, point in zip(open_, shares, points, strict=True):
            part = moved[at : at + len(share)]
            at += len(share)
            reasonable(steps[k], part, setup)
            between = np.abs(part[1::2] - (part[:-1:2] + part[2::2]) / 2).max()
            if between > BEND / 2:
                again.append((k, n, ends, sign, 2 * count))
                continue
            whole, path = 2 if steps[k].path.pieces() > 1 else 1, steps[k].path  # type: ignore[union-attr]
            kept = np.arange(0, len(share), 2) if whole == 2 else _straight(share, part)
            if path is not None:
                found[k, n] = Run(share[kept], (point + part)[kept], sign)
        open_ = again
    for k, _, _, _, count in open_:
        steps[k].block.refuse(f"a correction that bends more often than {count // 2} times along it", "Divide it")
    for (k, _), run in sorted(found.items(), key=lambda item: item[0]):
        out[k].append(run)
    for step, runs in zip(steps, out, strict=True):
        if sum(len(r.share) for r in runs) > LONGEST:
            step.block.refuse(f"more than {LONGEST} pieces", "Divide it")
    return out


def _straight(share: Array, moved: Array) -> Array:
    """Indices to keep, so that lines between them stay within `BEND` of all samples (Douglas and Peucker)."""
    kept, stack = {0, len(share) - 1}, [(0, len(share) - 1)]
    while stack:
        a, b = stack.pop()
        if b - a < 2:
            continue
        part = (share[a : b + 1] - share[a]) / (share[b] - share[a])
        gap = np.abs(moved[a : b + 1] - (moved[a] + part[:, None] * (moved[b] - moved[a]))).max(axis=1)
        if gap.max() > BEND / 2:
            middle = a + int(np.argmax(gap))
            kept.add(middle)
            stack += [(a, middle), (middle, b)]
    return np.array(sorted(kept))


def reasonable(step: Step, moved: Array, setup: Setup) -> None:
    """Raise InputError where a correction is none: not a number, or larger than `LARGEST`."""
    largest = np.abs(moved).max(axis=0)
    k = int(np.argmax(np.where(np.isfinite(largest), largest, np.inf)))
    if not largest[k] <= LARGEST:
        unit = "deg" if setup.axes[k].rotary else "mm"
        found = f"a correction of {setup.axes[k].name} by {largest[k]:.3f} {unit}, and {LARGEST:g} {unit} is the most"
        step.block.refuse(found, "Adjust the machine first, measure and fit again")
