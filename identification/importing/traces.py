"""Traces of a bar along a commanded circle: their entries of ``observations:``, and what can be said of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from errormodel.exceptions import InputError
from errormodel.observations import registry
from identification.importing.sources import SourceFile

FOREIGN = 0.02  # of the radius: a ball further off its centre, or a deviation as large, is no test; by judgement


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
    """

    source: SourceFile
    label: str
    plane: str
    radius: float
    both: bool
    off_um: float
    span_um: float

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
        )


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
    turning = np.sign(at[:-1, 0] * at[1:, 1] - at[1:, 0] * at[:-1, 1])
    both = bool((turning > 0).any() and (turning < 0).any())
    return Trace(source, label, plane, radius, both, 1e3 * off, 1e3 * float(np.ptp(left)))


def trace_lines(traces: Sequence[Trace]) -> Iterator[str]:
    """What is said of all of them."""
    yield from (t.line for t in traces)
    if traces:
        yield "where the angle starts and which way it counts, a circle cannot prove: see circle: in survey.yaml"
    bare = [t for t in traces if not t.source.recording.calibrated]
    if bare:
        of = ", ".join(dict.fromkeys(f"{t.source.recording.reach:g}" for t in bare))
        yield (
            f"no file states a calibrated length: readings count from {of} mm, as if the bar had been calibrated to "
            "that; the common scale of the axes follows from it. If it was not, write calibrated: unknown (survey.yaml)"
        )
