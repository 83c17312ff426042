"""Predictions and simulated surveys of any length, a block of rows at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from errormodel.machine import Machine
from errormodel.simulation import simulate
from errormodel.survey_rows import SurveyRows, ranges_of
from identification.results.predictions import predicted
from identification.results.stored_fit import StoredFit
from identification.streaming.work import BLOCK_ROWS

MOST_NOTED_BLOCKS = 3  # blocks of rows whose notes are kept


class Noted:
    """Notes of the first blocks that have any of their own."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._seen: set[str] = set()
        self._blocks = 0

    def add(self, start: int, stop: int, notes: tuple[str, ...]) -> None:
        """Take in the notes of the rows from `start` (from 0) to before `stop`."""
        fresh = [note for note in notes if note not in self._seen]
        self._seen |= set(fresh)
        self._blocks += bool(fresh)
        if fresh and self._blocks <= MOST_NOTED_BLOCKS:
            self._lines += [f"rows {start + 1} to {stop}: {note}" for note in fresh]

    @property
    def notes(self) -> tuple[str, ...]:
        more = self._blocks - MOST_NOTED_BLOCKS
        return (*self._lines, *([f"and notes like these on {more} more blocks of rows"] if more > 0 else []))


def predictions(
    stored: StoredFit, rows: SurveyRows, noted: Noted, report: Callable[[float, str], None]
) -> Iterator[pd.DataFrame]:
    """Tables of predictions, block by block; see `identification.results.predictions.predicted`."""
    for start, stop in ranges_of(len(rows), BLOCK_ROWS):
        table = predicted(stored, rows.survey((start, stop)))
        noted.add(start, stop, tuple(n for n in table.attrs.pop("notes") if n not in stored.unlisted))
        table.attrs.clear()
        yield table
        report(stop / len(rows), f"{stop} rows")


def simulated(
    machine: Machine,
    points: int | SurveyRows,
    parameters: dict[str, float] | str | Path | None,
    noise: Any,
    seed: int,
    report: Callable[[float, str], None],
) -> Iterator[pd.DataFrame]:
    """Tables of a simulated survey, block by block; each block draws random numbers from a seed of its own."""
    count = points if isinstance(points, int) else len(points)
    for number, (start, stop) in enumerate(ranges_of(count, BLOCK_ROWS)):
        own = int(np.random.SeedSequence([seed, number]).generate_state(1, np.uint64)[0] >> np.uint64(1))
        given = stop - start if isinstance(points, int) else points.survey((start, stop))
        yield simulate(machine, given, parameters, noise=noise, seed=own)
        report(stop / count, f"{stop} rows")
