"""The rows of a survey that stand for all of it: short stretches spread evenly, and the middle ones as they follow.

They depend on the number of rows alone. The fit begins with them, its rank is decided on them, and reports draw them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import pandas as pd

from errormodel.survey import Survey
from errormodel.survey_rows import SurveyRows
from identification.estimation.noise import MOST_NOISE_ROWS

SAMPLE_ROWS = 1 << 16  # by judgement: uncertainties of 1/256 of the noise; a second to fit
STRETCHES = 256  # into which the sample is divided
MOST_HELD_OUT_ROWS = 1_000_000  # of files that are held out, which are read as a whole


def sample_of(rows: SurveyRows, most: int = SAMPLE_ROWS) -> tuple[Survey, list[int]]:
    """About `most` of the rows, of each file some, and the files that are held out; and the rows' numbers, from 0."""
    places: list[tuple[int, int]] = []
    for start, stop in zip(rows.starts, rows.starts[1:], strict=False):
        share = max(round(most * (stop - start) / len(rows)), min(stop - start, most // STRETCHES))
        places += stretches(start, stop, share, max(1, STRETCHES * share // most))
    sample, held_out = rows.survey(*joined(places)), rows.held_out()
    whole = sample if held_out is None else together([sample, held_out])
    return rows.looked_over(whole), [k for start, stop in places for k in range(start, stop)]


def stretches(start: int, stop: int, count: int, parts: int) -> Iterator[tuple[int, int]]:
    """Ranges that make up `count` of the rows from `start` to before `stop`, evenly spread; all where it is all."""
    if count >= stop - start:
        yield start, stop
        return
    for k in range(parts):
        size = count * (k + 1) // parts - count * k // parts
        middle = start + (stop - start) * (2 * k + 1) // (2 * parts)
        low = min(max(middle - size // 2, start), stop - size)
        yield low, low + size


def middle_of(rows: SurveyRows) -> Survey:
    """Rows of the middle of each file as they follow each other, in all as many as correlated noise is judged by."""
    share = min(1.0, MOST_NOISE_ROWS / len(rows))
    places = []
    for start, stop in zip(rows.starts, rows.starts[1:], strict=False):
        middle, half = (start + stop) / 2, share * (stop - start) / 2
        places.append((int(middle - half), max(int(middle + half), int(middle - half) + 1)))
    return rows.survey(*joined(places))


def joined(places: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Ranges in their order, those that touch as one."""
    out: list[tuple[int, int]] = []
    for start, stop in places:
        if out and out[-1][1] == start:
            out[-1] = out[-1][0], stop
        else:
            out.append((start, stop))
    return out


def together(surveys: Sequence[Survey]) -> Survey:
    """Surveys of parts of the rows as one."""
    table = pd.concat([s.table for s in surveys], ignore_index=True)
    notes = dict.fromkeys(note for s in surveys for note in s.notes)
    return replace(surveys[0], table=table, notes=tuple(notes))
