"""Traces of a bar along a commanded circle: their entries of ``observations:``, and what can be said of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.exceptions import InputError
from errormodel.observations import registry
from errormodel.raw_formats.commanded_circle import CommandedCircle
from identification.importing.sources import SourceFile
from identification.importing.trace_proof import Circle, common_ball, refuse_exchanged, refuse_shifted, row_places

FOREIGN = 0.02  # of the radius: a ball further off its centre, or a deviation as large, is no test; by judgement


MANY = 30  # readings, to compare both ways
COPIED = 0.7  # of them alike to the last digit: with noise a few are
COMPLETE = 350.0  # degrees: an export may leave out the ends of a turn


@dataclass(frozen=True)
class Trace:
    """A trace with its place in a survey.

    Attributes
    ----------
    source : the file.
    label : name of its entry of ``observations:``.
    plane, radius : of the commanded circle, mm.
    both : whether it was run both ways.
    off_um : how far the ball was from the centre; span_um : peak to peak of the radial deviation from the ball.
    ball : place of the ball along the two axes of the plane, mm from the centre.
    centre : commanded position of every joint there.
    copied : that one sense is a copy of the other, in words; empty where it is not.
    says : what else was seen of its readings.
    """

    source: SourceFile
    label: str
    plane: str
    radius: float
    both: bool
    off_um: float
    span_um: float
    ball: dict[str, float]
    centre: dict[str, float]
    copied: str = ""
    says: tuple[str, ...] = ()

    @property
    def entry(self) -> dict[str, Any]:
        """Its entry of ``observations:``."""
        recording = self.source.recording
        word, kind = next((w, k) for w, k in registry().items() if k.trace == recording.trace)
        return {"type": word, **kind.traced(recording.reach)}

    @property
    def line(self) -> str:
        """What is said of it."""
        ways = "both ways" if self.both else "one way only: backlash hides in the ball's place"
        return (
            f"{self.source.raw.path.name}: observation {self.label}, a circle of {self.radius:g} mm in {self.plane}, "
            f"{ways}; the ball {self.off_um:.3g} um off its centre, around it {self.span_um:.3g} um peak to peak"
            f"{''.join(f'; {s}' for s in self.says)}"
        )


def circle_of(
    centre: Mapping[str, float] | None, plane: str, radius: float | None, start: float
) -> CommandedCircle | None:
    """The circle that the user states; None where no centre is given.

    Raises
    ------
    InputError
        Something is said of a circle without its centre, or a value is none.
    """
    if centre is None:
        if plane or radius is not None or start:
            raise InputError("--plane, --radius, --start", "no centre of the circle", "Give --centre X=..,Y=..,Z=..")
        return None
    try:
        return CommandedCircle(centre=dict(centre), plane=plane, radius=radius, start=start)
    except ValueError as error:
        found = f"plane {plane or 'of the file'}, radius {radius}, start {start}"
        raise InputError("--centre", found, "Write --plane XY, --radius above 0 in mm, --start in degrees") from error


def traces_of(sources: Sequence[SourceFile]) -> list[Trace]:
    """The traces among the files, each with a name of its own: that of the plane, or of the file where two share it.

    Raises
    ------
    InputError
        What was read is no deviation along a circle of that radius.
    """
    own = [s for s in sources if s.what == "readings"]
    planes = [_plane(s) for s in own]
    labels = [p if planes.count(p) == 1 else Path(s.raw.path.name).stem for s, p in zip(own, planes, strict=True)]
    return [_trace(s, label, plane) for s, label, plane in zip(own, labels, planes, strict=True)]


def _plane(source: SourceFile) -> str:
    return "".join(str(c)[4:] for c in source.recording.frame if str(c).startswith("dir_"))


def _trace(source: SourceFile, label: str, plane: str) -> Trace:
    circle = source.entry.circle
    assert circle is not None
    at = np.column_stack([source.column(a) - circle.centre[a] for a in plane])
    radius = float(np.hypot(*at.T).mean())
    length = source.column("length")
    seen = np.isfinite(length)
    if seen.sum() < 4:
        raise InputError(source.raw.name, f"{int(seen.sum())} lengths", "A circle needs hundreds")
    # to first order a ball off the centre adds the component of its place along the bar
    columns = np.column_stack([at[seen] / radius, np.ones(seen.sum())])
    found = np.linalg.lstsq(columns, length[seen], rcond=None)[0]
    left = length[seen] - columns @ found
    off = float(np.hypot(*found[:2]))
    if max(off, float(np.ptp(left))) > FOREIGN * radius:
        size = f"the ball {off:.3g} mm off, {np.ptp(left):.3g} mm peak to peak around it"
        cure = "Look for another unit of the deviations, or another radius"
        raise InputError(source.raw.name, f"deviations that are none of a circle of {radius:g} mm: {size}", cure)
    rows = np.flatnonzero(seen)
    angle = np.unwrap(np.arctan2(at[rows, 1], at[rows, 0]))
    ball = dict(zip(plane, (-found[:2]).tolist(), strict=True))
    run = Circle(angle, _senses(source, plane, angle, rows), length[rows], row_places(rows, source.recording.lines))
    both = len({*run.sense.tolist()}) > 1
    says = (
        copied := _copied(run),
        *_singles(refuse_exchanged(run, source.raw.name)),
        *_parts(run),
        *[refuse_shifted(run, source.raw.name)],
    )
    return Trace(
        source, label, plane, radius, both, 1e3 * off, 1e3 * float(np.ptp(left)), ball, dict(circle.centre),
        copied, tuple(s for s in says if s),
    )  # fmt: skip


def _senses(source: SourceFile, plane: str, angle: Array, rows: Index) -> Array:
    """1 where the angle grew on the way to a reading, else -1, (n,): from the sides that the axes came from."""
    first, second = (source.column(f"dir_{axis}")[rows] for axis in plane)
    grows = second * np.cos(angle) - first * np.sin(angle)
    return np.asarray(np.where(grows >= 0, 1.0, -1.0))


def _copied(run: Circle) -> str:
    """That one sense repeats the other, in words; empty where it does not."""
    one, other = (run.length[run.sense == sense] for sense in (1.0, -1.0))
    if not MANY <= len(one) == len(other) or max(np.mean(one == other), np.mean(one == other[::-1])) <= COPIED:
        return ""
    return "both ways hold the same readings to the last digit: one is a copy of the other, which hides backlash"


def _singles(count: int) -> Iterator[str]:
    """Readings off their neighbours, in words."""
    if count:
        yield f"{count} single reading{'s' * (count > 1)} far off {'their' if count > 1 else 'its'} neighbours"


def _parts(run: Circle) -> Iterator[str]:
    """What of the circle was not measured, in words."""
    for sense, way in ((1.0, "counter-clockwise"), (-1.0, "clockwise")):
        reach = run.reach(sense)
        if 0 < reach < COMPLETE:
            yield f"{way} {reach:.0f} of 360 degrees only: an arc, from which ball, scale and squareness part badly"
        for size, at in run.gaps(sense):
            yield f"{way} a gap of {size:.3g} degrees at {at:.4g}"


def ball_notes(traces: Sequence[Trace]) -> tuple[str, str]:
    """What circles about one commanded centre, in different planes, say of their ball: a sentence, and a warning."""
    if len({t.plane for t in traces}) < len(traces) or any(t.centre != traces[0].centre for t in traces):
        return "", ""
    return common_ball({t.label: t.ball for t in traces})


def trace_lines(traces: Sequence[Trace]) -> Iterator[str]:
    """What is said of all of them."""
    yield from (t.line for t in traces)
    says, warning = ball_notes(traces)
    if says and not warning:
        yield says
    if traces:
        yield "where the angle starts and which way it counts, a circle cannot prove: see circle: in survey.yaml"
    bare = [t for t in traces if not t.source.recording.calibrated]
    if bare:
        of = ", ".join(dict.fromkeys(f"{t.source.recording.reach:g}" for t in bare))
        yield (
            f"no file states a calibrated length: readings count from {of} mm, as if the bar had been calibrated to "
            "that; the common scale of the axes follows from it. If it was not, write calibrated: unknown (survey.yaml)"
        )
