"""Head of a report: the block ``test:`` of the survey, and what it lacks."""

from __future__ import annotations

from typing import NamedTuple

from errormodel.surveys.record import RecordForm


class Head(NamedTuple):
    """What is known of the test, what a certificate needs beside, and what is wrong with it."""

    lines: list[tuple[str, str]]
    missing: tuple[str, ...]
    wrong: tuple[str, ...]


def head_of(record: RecordForm | None) -> Head:
    """Head of a report on a survey with this block; None: it has none."""
    known = record or RecordForm()
    wrong = []
    if known.expired:
        due, day = known.instrument.due, known.date
        wrong.append(f"the calibration of the instrument was valid until {due}, before the test on {day}")
    return Head(list(known.lines()), known.missing(), tuple(wrong))
