"""Division of cuts where the correction bends, so that straight lines between corrected points follow it.

Positions in mm and deg.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.setup import Setup
from errormodel.gcode.paths import Line
from errormodel.gcode.steps import Step

Correct = Callable[[Array, Array], Array]
"""Commands for wanted positions and directions of arrival, all (n, axes), mm and deg."""

CHORD_TOLERANCE = 0.0002  # mm or deg: permitted distance between a straight piece and the corrected curve; by judgement
LARGEST_CORRECTION = 1.0  # mm or deg: larger corrections are refused as implausible; by judgement
MOST_BLOCK_PIECES = 10_000  # pieces of one block; by judgement
MOST_DOUBLINGS = 6  # doublings of the samples before a block is refused


@dataclass(frozen=True)
class Run:
    """Part of a path along which no axis reverses.

    Attributes
    ----------
    share : (k,) ascending shares of the length; `corrected` : (k, axes) commands there.
    came : (axes,) directions of approach, +-1.
    """

    share: Array
    corrected: Array
    came: Array


def known(q: Array) -> Array:
    """Positions with 0 for unknown ones, which occur only where they have no effect."""
    return np.where(np.isfinite(q), q, 0.0)


def directions(before: Array, step: Array) -> Array:
    """Directions (axes,) along a step; axes that never moved count as coming from below."""
    moved = np.abs(step) > 1e-9
    kept = np.where(before != 0, before, 1.0)
    return np.where(moved, np.sign(step), kept)


@dataclass(frozen=True)
class Part:
    """Origin of a run: shares `ends` (2,) of a step's path, sampled in `count` intervals."""

    step: Step
    path: Line
    ends: Array
    came: Array
    count: int = 0

    def finer(self) -> Part:
        """The same part with twice as many samples."""
        return replace(self, count=2 * self.count)

    def shares(self) -> Array:
        """Ends and middles of the intervals."""
        return np.linspace(float(self.ends[0]), float(self.ends[1]), 2 * self.count + 1)


def parts_of(step: Step) -> list[Part]:
    """Parts of a step's path along which no axis reverses."""
    if step.path is None:
        return []
    came, out = step.came, []
    for pair in pairwise(step.path.corners()):
        ends = step.path.at(np.array(pair))
        moved = ends[1] - ends[0]
        out.append(Part(step, step.path, np.array(pair), directions(came, moved)))
        came = np.where(np.abs(moved) > 1e-9, np.sign(moved), came)
    return out


def sampled(part: Part, setup: Setup) -> Part:
    """A part with four samples per interval that the errors along an axis need, and at least the chords of an arc."""
    moved = np.abs(np.diff(part.path.at(part.ends), axis=0)[0])
    spans = np.array([a.measured[1] - a.measured[0] for a in setup.axes])
    needed = moved / np.where(spans > 0, spans, np.inf) * [a.intervals for a in setup.axes]
    chords = int(np.ceil(part.path.pieces() * (part.ends[1] - part.ends[0])))
    if chords > MOST_BLOCK_PIECES:
        part.step.block.refuse(f"an arc of {chords} chords, and {MOST_BLOCK_PIECES} is the most", "Divide it")
    return replace(part, count=int(max(2, min(np.ceil(4 * known(needed).max()), MOST_BLOCK_PIECES), chords)))


def divided(steps: Sequence[Step], setup: Setup, correct: Correct) -> list[list[Run]]:
    """Runs of the paths of steps, each with the points between which the correction is straight.

    All blocks are corrected together; those with too few samples for the curvature are sampled twice as finely again.

    Raises
    ------
    InputError
        A correction is too large, or bends too often.
    """
    parts = [[sampled(part, setup) for part in parts_of(step)] for step in steps]
    left = {(k, n): part for k, row in enumerate(parts) for n, part in enumerate(row)}
    found: dict[tuple[int, int], Run] = {}
    for _ in range(MOST_DOUBLINGS):
        if not left:
            break
        moved = _corrections(list(left.values()), correct)
        for key, part, shift in zip([*left], [*left.values()], moved, strict=True):
            reasonable(part.step, shift, setup)
            if np.abs(shift[1::2] - (shift[:-1:2] + shift[2::2]) / 2).max() > CHORD_TOLERANCE / 2:
                left[key] = part.finer()
                continue
            share = part.shares()
            kept = np.arange(0, len(share), 2) if part.path.pieces() > 1 else _straight(share, shift)
            found[key] = Run(share[kept], (part.path.at(share) + shift)[kept], part.came)
            del left[key]
    for part in left.values():
        part.step.block.refuse(f"a correction that bends more often than {part.count // 2} times along it", "Divide it")
    out = [[found[k, n] for n in range(len(row))] for k, row in enumerate(parts)]
    for step, runs in zip(steps, out, strict=True):
        if sum(len(r.share) for r in runs) > MOST_BLOCK_PIECES:
            step.block.refuse(f"more than {MOST_BLOCK_PIECES} pieces", "Divide it")
    return out


def _corrections(parts: Sequence[Part], correct: Correct) -> list[Array]:
    """Corrections (samples, axes) of each part, evaluated together."""
    points = [known(part.path.at(part.shares())) for part in parts]
    came = [np.tile(part.came, (len(q), 1)) for part, q in zip(parts, points, strict=True)]
    moved = correct(np.vstack(points), np.vstack(came)) - np.vstack(points)
    return np.split(moved, np.cumsum([len(q) for q in points])[:-1])


def _straight(share: Array, moved: Array) -> Array:
    """Samples to keep so that straight lines stay within `CHORD_TOLERANCE` of all (Douglas and Peucker)."""
    kept, stack = {0, len(share) - 1}, [(0, len(share) - 1)]
    while stack:
        a, b = stack.pop()
        if b - a < 2:
            continue
        part = (share[a : b + 1] - share[a]) / (share[b] - share[a])
        gap = np.abs(moved[a : b + 1] - (moved[a] + part[:, None] * (moved[b] - moved[a]))).max(axis=1)
        if gap.max() > CHORD_TOLERANCE / 2:
            middle = a + int(np.argmax(gap))
            kept.add(middle)
            stack += [(a, middle), (middle, b)]
    return np.array(sorted(kept))


def reasonable(step: Step, moved: Array, setup: Setup) -> None:
    """Raise InputError where a correction is NaN or larger than `LARGEST_CORRECTION`."""
    largest = np.abs(moved).max(axis=0)
    k = int(np.argmax(np.where(np.isfinite(largest), largest, np.inf)))
    if not largest[k] <= LARGEST_CORRECTION:
        unit = "deg" if setup.axes[k].rotary else "mm"
        found = (
            f"a correction of {setup.axes[k].name} by {largest[k]:.3f} {unit}, "
            f"and {LARGEST_CORRECTION:g} {unit} is the most"
        )
        step.block.refuse(found, "Adjust the machine first, measure and fit again")
