"""Dwells of a continuous log that may be larger than memory: found and averaged in one pass.

What tells noise from motion is learned from stretches of the log (`identification.importing.dwells`); then each range
of rows finds the dwells that begin in it, reading on behind its end until the last of them is over.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pandas as pd

from errormodel.arrays import Array
from errormodel.exceptions import InputError
from errormodel.survey import Survey
from errormodel.survey_rows import SurveyRows, ranges_of
from errormodel.surveys.columns import MEASURED
from errormodel.surveys.gaps import filled
from identification.importing.dwells import (
    LEAST,
    MANY,
    SHORTEST,
    Scale,
    at_rest,
    scale_of,
    scatter_of,
    settled,
    stretches_of,
    turned_back,
)
from identification.runtime.engines import Crew
from identification.streaming.sample import stretches

SEGMENT_ROWS = 1 << 18  # rows of one job
LEARNED_ROWS, LEARNED_STRETCHES = 1 << 18, 16  # rows from which noise is told from motion, and stretches of them
HALO_ROWS = 1 << 12  # rows read before and behind a range, and twice as many where they do not suffice


@dataclass(frozen=True)
class Found:
    """Dwells that begin in a range of rows: their means, numbers of readings, their scatter (mm), and readings in all.

    A mean has the median of the commands, since a command may change some readings before or after the target does.
    """

    table: pd.DataFrame
    sizes: Array
    scatter: Array
    seen: int


def dwell_survey(
    rows: SurveyRows,
    *,
    crew: Crew | None = None,
    report: Callable[[float, str], None] = lambda _share, _text: None,
    segment: int = SEGMENT_ROWS,
) -> Survey:
    """The dwells of a log, a row each, as a survey; its last note says what was found.

    Raises
    ------
    InputError
        The rows are wrong, or are no continuous log.
    """
    learned = [
        rows.survey(place).measured for place in stretches(0, len(rows), LEARNED_ROWS, LEARNED_STRETCHES)
    ]  # fmt: skip
    scale = scale_of([points[np.isfinite(points).all(axis=1)] for points in learned])
    if scale is None:
        found = "no continuous log: steps from row to row are not of two kinds, noise at rest and motion"
        raise InputError(str(rows.source), found, "Leave out --dwells: each row is a measurement of its own")
    packed = pickle.dumps((rows, scale))
    jobs = [(packed, start, stop) for start, stop in ranges_of(len(rows), segment)]
    parts: list[Found | None] = [None] * len(jobs)
    done = 0
    for k, result in (crew or Crew(workers=1)).each(found_in, jobs):
        if isinstance(result, Exception):
            raise result
        parts[k], done = result, done + 1
        report(done / len(jobs), f"{min(done * segment, len(rows))} rows")
    return _together(rows, [p for p in parts if p is not None])


def _together(rows: SurveyRows, parts: Sequence[Found]) -> Survey:
    sizes = np.concatenate([p.sizes for p in parts])
    seen, kept = sum(p.seen for p in parts), sizes >= LEAST
    if kept.any():
        scatter = np.concatenate([p.scatter for p in parts])
        turning = np.zeros_like(kept)
        turning[kept] = turned_back(sizes[kept], scatter[kept])
        kept &= (sizes >= max(LEAST, SHORTEST * float(np.median(sizes[kept])))) & ~turning
    moving = seen - int(sizes[sizes >= LEAST].sum())
    usual = float(np.median(sizes[kept])) if kept.any() else 0.0
    if not kept.any() or (usual < MANY and moving <= kept.sum()):
        found = "no continuous log: a few readings of each point, and none on the way"
        raise InputError(str(rows.source), found, "Leave out --dwells: each row is a measurement of its own")
    table = pd.concat([p.table for p in parts], ignore_index=True)[kept].reset_index(drop=True)
    survey = rows.looked_over(replace(rows.survey((0, 1)), table=table))
    table, more = filled(table)
    note = (
        f"{len(table)} dwells of {usual:.0f} readings (median) in a log of {len(rows)} rows; {moving} readings on the "
        f"way left out; {int((~kept).sum())} places too short for a dwell"
    )
    return replace(survey, table=table, notes=(*survey.notes, *more, note))


@lru_cache(maxsize=2)
def _opened(packed: bytes) -> tuple[SurveyRows, Scale]:
    rows, scale = pickle.loads(packed)  # it comes from the process that started this one
    return rows, scale


def found_in(job: tuple[bytes, int, int]) -> Found:
    """Dwells that begin from a first to before a last row of a pickled log and its scale."""
    packed, start, stop = job
    rows, scale = _opened(packed)
    before = behind = HALO_ROWS
    while True:
        low, high = max(start - before, 0), min(stop + behind, len(rows))
        table = rows.survey((low, high)).table
        points = table[list(MEASURED)].to_numpy(dtype=np.float64)
        seen = np.flatnonzero(np.isfinite(points).all(axis=1))
        number = seen + low  # of the row in the log
        if (number < start).sum() <= 2 * scale.lag and low > 0:
            before *= 2
            continue
        still = at_rest(points[seen], scale) if len(seen) > scale.lag else np.zeros(len(seen), dtype=bool)
        parts = [(a, b) for a, b in stretches_of(points[seen], still, scale.step) if start <= number[a] < stop]
        # a dwell is over if enough readings follow to see that nothing more belongs to it
        if parts and high < len(rows) and parts[-1][1] + 2 * scale.lag >= len(seen):
            behind *= 2
            continue
        inside = int(((number >= start) & (number < stop)).sum())
        return _averaged(table.iloc[seen], points[seen], parts, rows, inside)


def _averaged(
    table: pd.DataFrame, points: Array, parts: Sequence[tuple[int, int]], rows: SurveyRows, seen: int
) -> Found:
    ends = [settled(points, a, b) for a, b in parts]
    sizes = np.array([b - a + 1 for a, b in ends], dtype=np.float64)
    label = np.full(len(table), -1)
    for k, (a, b) in enumerate(ends):
        label[a : b + 1] = k
    own = table[label >= 0]
    groups = own.groupby(label[label >= 0], sort=True)
    numbers = own.select_dtypes("number").columns.drop("row")
    commanded = [c for c in numbers if c in {j.name for j in rows.machine.joints} or c.startswith("dir_")]
    out = groups.first()
    out[list(numbers)] = groups[list(numbers)].mean()
    out[commanded] = groups[commanded].median()
    scatter = np.array([scatter_of(points[a : b + 1]) for a, b in ends])
    return Found(out.reset_index(drop=True), sizes, scatter, seen)
