"""Verification of a corrected programme: it is executed from its text and compared with the original.

The written positions less the correction at each point must follow the original path in its order, with the same
words, feeds, rapids, extrusion and times. Positions in mm and deg.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from errormodel.arrays import Array
from errormodel.controllers.setup import Setup
from errormodel.gcode.codes import STOP_CODES
from errormodel.gcode.divide import CHORD_TOLERANCE, LARGEST_CORRECTION, Correct, directions, known, parts_of
from errormodel.gcode.extruder import INCH_MM
from errormodel.gcode.paths import ARC_CHORD_MM, Line
from errormodel.gcode.rewrite import PATH_CODES, PATH_WORDS, TAKE_UP_TOLERANCE
from errormodel.gcode.steps import Step

CHECK_SHARES = np.array([0.0, 0.23, 0.5, 0.81, 1.0])  # shares of each written piece at which it is compared
CHECK_STEPS = 4  # fixed-point steps from a written position to the original one; corrections change by less than 1 %
EXTRUSION_TOLERANCE_MM = 3e-5  # mm: permitted difference of the extrusion of a piece, the rounding of its last digit
REVERSAL_DISTANCE_MM = 0.05  # mm from a reversal of an axis, within which the direction of approach is ambiguous
LENGTH_TOLERANCE = 0.01  # permitted relative change of the length of a corrected path; by judgement
TIME_TOLERANCE = 1e-6  # permitted relative difference of the times of G93, which have nine digits


@dataclass(frozen=True)
class Deviation:
    """Largest differences between the original and the written programme, and where they occur."""

    path: float = 0.0  # mm or deg
    line: int = 0
    ends: float = 0.0
    extrusion: float = 0.0  # mm
    time: float = 0.0  # relative
    cuts: int = 0
    pieces: int = 0
    rapids: int = 0

    def with_other(self, other: Deviation) -> Deviation:
        """Element-wise maximum, of the programme with its optional blocks and without."""
        worst = self if self.path >= other.path else other
        return replace(
            worst,
            ends=max(self.ends, other.ends),
            extrusion=max(self.extrusion, other.extrusion),
            time=max(self.time, other.time),
            cuts=self.cuts,
            pieces=self.pieces,
            rapids=self.rapids,
        )

    def text(self, name: str) -> str:
        """One line of text for the operator."""
        where = f" (line {self.line})" if self.line else ""
        return (
            f"{name}: {self.rapids} rapids, {self.cuts} cuts in {self.pieces} pieces; executed and compared: "
            f"largest deviation of the path {1e3 * self.path:.2f} um{where}, of rapids' ends {1e3 * self.ends:.2f} um, "
            f"of extrusion {self.extrusion:.5f} mm, of feed {100 * self.time:.4f} %"
        )


def checked(
    asked: Sequence[Step], written: Sequence[Step], sizes: Sequence[int], setup: Setup, correct: Correct, figures: int
) -> Deviation:
    """Compare the written programme with the original and return the largest deviations.

    Parameters
    ----------
    asked, written : steps of both programmes; `sizes[k]` of the written ones replace the k-th original one.
    figures : digits after the decimal point, of mm and degrees.

    Raises
    ------
    InputError
        The programmes do not agree.
    """
    groups, at = [], 0
    for size in sizes:
        groups.append(written[at : at + size])
        at += size
    pairs = list(zip(asked, groups, strict=True))
    for step, group in pairs:
        _words(step, group)
    rapids = [(s, g[0]) for s, g in pairs if s.kind == "rapid"]
    cuts = [(s, g) for s, g in pairs if s.kind == "feed"]
    ends = _rapids(rapids, setup, correct, figures)
    path, line = _paths(cuts, setup, correct, figures)
    extrusion = max((_extrusion(s, g) for s, g in cuts), default=0.0)
    time = max((_time(s, g) for s, g in cuts), default=0.0)
    return Deviation(path, line, ends, extrusion, time, len(cuts), sum(len(g) for _, g in cuts), len(rapids))


def _disagree(step: Step, found: str) -> None:
    step.block.refuse(
        f"what would be written does not agree with it: {found}", "Report this programme; nothing is written"
    )


def _words(step: Step, group: Sequence[Step]) -> None:
    """Compare words and their order, except those of the path."""
    if step.kind == "as it is":
        if [g.block.text for g in group] != [step.block.text] or group[0].kind != "as it is":
            _disagree(step, "a line that should stay")
        return
    axes = {w.letter for s in (step, *group) for w in s.block.words if w.letter in "XYZABCUVW"}
    divided = len(group) > 1

    def others(steps: Sequence[Step]) -> list[str]:
        return [
            str(w)
            for s in steps
            for w in s.block.words
            if w.letter not in axes | PATH_WORDS | {"E"}
            and w.code not in PATH_CODES | STOP_CODES
            and not (w.letter == "F" and divided and step.modes.feed == "G93")
        ]

    if others([step]) != others(group):
        _disagree(step, "its words")
    stops = [[w.code for w in s.block.words if w.letter == "M" and w.code in STOP_CODES] for s in (step, *group)]
    if stops[0] != stops[-1] or any(stops[1:-1]):
        _disagree(step, "its stop")
    if [c for s in group for c in s.block.comments] != [*step.block.comments]:
        _disagree(step, "its comments")
    if {s.block.optional for s in group} != {step.block.optional} or group[0].block.label != step.block.label:
        _disagree(step, "its block delete or number")
    last = group[-1].modes
    if {s.kind for s in group} != {step.kind} or replace(last, motion=step.modes.motion) != step.modes:
        _disagree(step, "rapid, feed or modal state")
    if (last.motion == "G0") != (step.modes.motion == "G0") or any(type(s.path) is not Line for s in group):
        _disagree(step, "its motion")


def _rapids(pairs: Sequence[tuple[Step, Step]], setup: Setup, correct: Correct, figures: int) -> float:
    if not pairs:
        return 0.0
    asked = np.array([s.q for s, _ in pairs])
    places = known(asked)
    start = np.array([s.q if s.path is None else s.path.start for s, _ in pairs])
    came = np.array([directions(s.came, known(q - a)) for (s, _), q, a in zip(pairs, asked, start, strict=True)])
    wanted = asked + correct(places, came) - places
    largest = 0.0
    for (step, sent), goal in zip(pairs, wanted, strict=True):
        gap = np.abs(sent.q - goal)[[*step.named]].max()
        largest = max(largest, float(gap))
        if sent.named != step.named or not gap <= 1.01 * _quantum(step, figures) + 1e-9:
            _disagree(step, f"a rapid that ends {1e3 * gap:.2f} um beside")
    return largest


def _quantum(step: Step, figures: int) -> float:
    """Half a unit of the last digit, mm or deg."""
    return float(max(0.5 * 10.0**-figures, 0.5 * 10.0 ** -(figures + 1) * INCH_MM if step.modes.inch else 0.0))


def _paths(
    pairs: Sequence[tuple[Step, Sequence[Step]]], setup: Setup, correct: Correct, figures: int
) -> tuple[float, int]:
    """Largest distance (mm or deg) of a written cut, less its correction, from the original path."""
    movers = np.array([n in setup.movers for n in setup.names])
    samples = [_samples(step, group, movers) for step, group in pairs]
    if not samples:
        return 0.0, 0
    sent, before, behind, free = (np.vstack([s[k] for s in samples]) for k in range(4))
    either = (before != behind).any(axis=1)
    back = _back(sent, before, free, correct)
    other = back.copy()
    other[either] = _back(sent[either], behind[either], free[either], correct)
    worst, line, at, count = 0.0, 0, 0, np.sqrt(len(movers))
    for (step, group), part in zip(pairs, samples, strict=True):
        rows = slice(at, at := at + len(part[0]))
        gap = _gap(step, group, [back[rows], other[rows]] if either[rows].any() else [back[rows]])
        limit = (
            count * (CHORD_TOLERANCE + max(TAKE_UP_TOLERANCE, 2.5 * _quantum(step, figures)) + _quantum(step, figures))
            + 1e-6
        )
        limit += ARC_CHORD_MM if step.path is not None and step.path.pieces() > 1 else 0.0
        if not gap <= limit:
            _disagree(step, f"a path that runs {1e3 * gap:.2f} um beside")
        if gap > worst:
            worst, line = gap, step.block.number
    return worst, line


def _back(sent: Array, came: Array, free: Array, correct: Correct) -> Array:
    """Positions before correction of written ones, by fixed-point iteration."""
    stands = known(sent)
    q = stands.copy()
    for _ in range(CHECK_STEPS if len(q) else 0):
        q = stands - np.where(free, correct(q, came) - q, 0.0)
    return q


def _samples(step: Step, group: Sequence[Step], movers: Array) -> tuple[Array, Array, Array, Array]:
    """Positions along the written pieces, two arrays of directions of approach, and the corrected axes.

    Near a reversal of an axis both of its directions are valid: the two arrays differ there.
    """
    paths = [s.path for s in group if s.path is not None]
    starts, steps = np.array([p.start for p in paths]), np.array([p.end - p.start for p in paths])
    points = (starts[:, None] + CHECK_SHARES[:, None] * steps[:, None]).reshape(-1, len(movers))
    parts, sizes = parts_of(step), _sizes(paths)
    along = _along(sizes)
    middle, near = (along[1:] + along[:-1]) / 2, REVERSAL_DISTANCE_MM / max(float(sizes.sum()), REVERSAL_DISTANCE_MM)
    ends = [part.ends[1] for part in parts[:-1]]
    before, behind = (
        np.repeat(
            np.array([parts[w].came for w in np.searchsorted(ends, middle + side * near)]), len(CHECK_SHARES), axis=0
        )
        for side in (-1, 1)
    )
    free = np.asarray(movers, bool) & np.isin(np.arange(len(movers)), step.movable)
    return points, before, behind, np.tile(free, (len(points), 1))


def _sizes(paths: Sequence[Line]) -> Array:
    """Lengths of written pieces."""
    return np.asarray(
        np.linalg.norm(known(np.array([p.end for p in paths]) - np.array([p.start for p in paths])), axis=1)
    )


def _along(sizes: Array) -> Array:
    """Shares of the written length at the ends of its pieces."""
    length = np.concatenate([[0.0], np.cumsum(sizes)])
    return np.asarray(length / length[-1] if length[-1] > 0 else np.linspace(0, 1, len(length)))


def _gap(step: Step, group: Sequence[Step], candidates: Sequence[Array]) -> float:
    """Largest distance from the path, its order and its ends."""
    path = step.path
    if path is None:
        raise ValueError("a cut has a path")
    plain = replace(path, start=known(path.start), end=known(path.end))
    stands = np.isfinite(path.end) & np.isfinite(path.start)
    pieces, n = len(group), len(CHECK_SHARES)
    sizes = _sizes([s.path for s in group if s.path is not None])
    along = _along(sizes)
    near = (along[:-1, None] + np.diff(along)[:, None] * CHECK_SHARES).ravel()
    found = []
    for candidate in candidates:
        back = np.where(stands, candidate, plain.start)
        share = plain.nearest(back, near)
        gaps = np.linalg.norm(back - plain.at(share), axis=1).reshape(pieces, n)
        found.append((gaps, share.reshape(pieces, n), back.reshape(pieces, n, -1)))
    better = np.argmin([gaps.max(axis=1) for gaps, _, _ in found], axis=0)
    gaps, share, back = (np.array([found[w][part][k] for k, w in enumerate(better)]) for part in range(3))
    progress = (share[:, -1] - share[:, 0]) * path.length
    moves = progress > sizes / 2
    if (~moves & (sizes > 2 * LARGEST_CORRECTION)).any() or (
        np.diff(share[moves].ravel()) * path.length < -TAKE_UP_TOLERANCE - ARC_CHORD_MM
    ).any():
        _disagree(step, "a path in another order")
    end = min(float(np.linalg.norm(f[2][-1, -1] - plain.end)) for f in found)
    begin = float(np.linalg.norm(back[moves][0, 0] - plain.start)) if moves.any() else 0.0
    return max(float(gaps[moves].max(initial=0.0)), end, begin)


def _extrusion(step: Step, group: Sequence[Step]) -> float:
    """Largest difference (mm) of the extrusion, which must grow with the path."""
    if not step.block.has("E"):
        if any(s.block.has("E") for s in group):
            _disagree(step, "an extrusion")
        return 0.0
    if len(group) == 1:
        if group[0].block.number_of("E") != step.block.number_of("E"):
            _disagree(step, "its extrusion")
        return 0.0
    unit = INCH_MM if step.modes.inch else 1.0
    whole = float(step.block.number_of("E") or 0.0) * unit
    before = step.extruded[0] if step.spread == "absolute" else 0.0
    values = np.array([float(s.block.number_of("E") or 0.0) * unit for s in group])
    done = values - before if step.spread == "absolute" else np.cumsum(values)
    sizes = _sizes([s.path for s in group if s.path is not None])
    along = _along(sizes)[1:]
    gap = float(abs(done[-1] - (whole - before)))
    shared = float(np.abs(done - (whole - before) * along).max())
    still = np.diff(done, prepend=0.0) == 0.0  # pieces of micrometres without extrusion
    loose = min(1.0, LENGTH_TOLERANCE + float(sizes[still].sum() / max(sizes.sum(), 1e-9)))
    if gap > EXTRUSION_TOLERANCE_MM * unit or shared > EXTRUSION_TOLERANCE_MM * unit + loose * abs(whole - before):
        _disagree(step, f"an extrusion that differs by {max(gap, shared):.5f} mm")
    return gap


def _time(step: Step, group: Sequence[Step]) -> float:
    """Relative difference of the time of a cut in G93; for other cuts F is compared as a word."""
    if step.modes.feed != "G93":
        return 0.0
    asked = 1 / float(step.block.number_of("F") or np.nan)
    sent = sum(1 / float(s.block.number_of("F") or np.nan) for s in group)
    gap = abs(sent / asked - 1)
    if not gap <= TIME_TOLERANCE:
        _disagree(step, f"a time that differs by {100 * gap:.4f} %")
    return gap
