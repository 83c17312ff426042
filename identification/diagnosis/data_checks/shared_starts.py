"""Distances from one start pose that are all off by the same amount: the start, or a calibrated length, was wrong.

Errors of a machine take a distance the farther off the longer it is: of a line through the gaps of a set-up over its
lengths, they make the slope. A wrong start adds the same to all readings, and makes the intercept. Intercepts of all
set-ups are compared; the others say how large errors of this machine make one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from errormodel.arrays import Array, Index
from errormodel.survey import Survey
from identification.diagnosis.data_checks.blunder import length, listed
from identification.observation.readings import ReadingView

FEWEST_STARTS = 3  # set-ups, of which one may stand out
FEWEST = 4  # readings of a set-up, for a line
SPREAD = 0.3  # of the longest length must those of a set-up span, for its intercept
FAR = 10.0  # times the median of the other intercepts, and
CERTAIN = 6.0  # times its own standard uncertainty
LEAST = 0.005  # mm: a smaller offset is no mistake worth a sentence
SAME = 1e-3  # mm, and 1e-3 degrees: start poses that are one


@dataclass(frozen=True)
class WrongStart:
    """Readings of one start pose (places in the view), and by how much they are off in common, mm."""

    places: Index
    offset: float


def wrong_starts(view: ReadingView, gap: Array) -> tuple[WrongStart, ...]:
    """Set-ups of distances between two poses whose common offset stands far beside those of the others.

    Parameters
    ----------
    gap : (n,) measured minus nominal, mm.
    """
    if view.observation.poses < 2:
        return ()
    machine = view.chain.machine
    unit = [np.radians(SAME) if j.type == "rotary" else SAME for j in machine.joints]
    start = np.column_stack([np.broadcast_to(c, len(view)) for c in view.rows[: len(machine.joints)]]) / unit
    _, group = np.unique(np.round(start), axis=0, return_inverse=True)
    longest = float(np.abs(view.measured).max())
    found: list[tuple[Index, float, float]] = []
    for k in range(int(group.max()) + 1):
        places = np.flatnonzero(group.ravel() == k)
        lengths = view.measured[places]
        if len(places) < FEWEST or np.ptp(lengths) < SPREAD * longest:
            continue
        design = np.column_stack([np.ones(len(places)), lengths])
        line = np.linalg.lstsq(design, gap[places], rcond=None)[0]
        noise = float(np.sum((gap[places] - design @ line) ** 2)) / (len(places) - 2)
        found.append((places, float(line[0]), float(np.sqrt(noise * np.linalg.inv(design.T @ design)[0, 0]))))
    if len(found) < FEWEST_STARTS:
        return ()
    size = np.abs([offset for _, offset, _ in found])
    out = []
    for k, (places, offset, uncertain) in enumerate(found):
        usual = float(np.median(np.delete(size, k)))
        if size[k] > max(FAR * usual, CERTAIN * uncertain, LEAST):
            out.append(WrongStart(places, offset))
    return tuple(out)


def start_lines(survey: Survey, label: str, index: Index, starts: tuple[WrongStart, ...]) -> Iterator[str]:
    """What was found, a sentence a set-up, with the rows of the file."""
    rows, file = (survey.table[c].to_numpy()[index] for c in ("row", "file"))
    for start in starts:
        off = f"{length(1e3 * abs(start.offset))} too {'long' if start.offset > 0 else 'short'}"
        yield (
            f"{label}: the {len(start.places)} readings from one start pose, rows "
            f"{listed(rows[start.places].tolist())} of {file[start.places[0]]}, are all {off}, whatever their length, "
            "and those from other starts are not: the start or a calibrated length of this set-up was wrong. See to "
            "it, or leave these rows out"
        )
