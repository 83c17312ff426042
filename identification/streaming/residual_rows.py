"""Residuals of every row of a streamed fit, in a further pass over the rows, as Parquet."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from errormodel.arrays import Array
from errormodel.channels import root
from errormodel.files import write_parquet_blocks
from errormodel.simulation import outward
from errormodel.survey_rows import SurveyRows, ranges_of
from identification.estimation.result import Fit, Spread, residuals_of
from identification.observation.models import PositionView, View
from identification.streaming.expansion import KIND
from identification.streaming.fit import BEFORE_LAST_STEP
from identification.streaming.totals import Sizes
from identification.streaming.work import BLOCK_ROWS, views_of

NAMES = ("nominal", "residual", "heldout")


def write_residuals(fit: Fit, rows: SurveyRows, path: Path, report: Callable[[float, str], None]) -> Fit:
    """Write nominal, fitted and held-out residual of every row, um, in the measuring frame.

    Returns
    -------
    Fit
        With the statistics of these residuals, which are exact for the mean and the largest as well.
    """
    sizes = {name: Sizes() for name in NAMES}
    write_parquet_blocks(_tables(fit, rows, sizes, report), path)
    before, after, without = (_spread(sizes[name]) for name in NAMES)
    assert fit.streamed is not None
    notes = tuple(note for note in fit.notes if not note.startswith(BEFORE_LAST_STEP))
    streamed = replace(fit.streamed, moved_mm=0.0)
    return replace(fit, nominal=before, fitted=after, heldout=without, streamed=streamed, notes=notes)


def _tables(
    fit: Fit, rows: SurveyRows, sizes: dict[str, Sizes], report: Callable[[float, str], None]
) -> Iterator[pd.DataFrame]:
    chain, problem, solution = fit.chain, fit.problem, fit.solution
    wanted = ("file", "row", "run", *chain.channels, *map(root, chain.channels))
    for start, stop in ranges_of(len(rows), BLOCK_ROWS):
        survey = rows.survey((start, stop))
        views = views_of(chain, survey, problem.frames, KIND in problem.declared)
        zero, place, count = np.zeros(len(chain.ids)), problem.place(), len(survey)
        found = {
            "nominal": residuals_of(views, {}, np.zeros(0), zero, count),
            "residual": residuals_of(views, place, solution.values, zero, count),
            "heldout": _without_own_fold(fit, views, start, count),
        }
        table = outward(survey.table, chain.machine)
        table = table[[c for c in dict.fromkeys(wanted) if c in table]].copy()
        for name, values in found.items():
            table[[f"{name}_{axis}_um" for axis in "xyz"]] = 1e3 * values
            seen = np.isfinite(values).any(axis=1)
            sizes[name].add(Sizes.of(np.sqrt(np.nansum(np.square(values[seen]), axis=1))))
        yield table
        report(stop / len(rows), f"{stop} rows")


def _without_own_fold(fit: Fit, views: Sequence[View], start: int, count: int) -> Array:
    """Residuals (rows, 3) of rows from number `start` on, each by the fit without its block of rows."""
    assert fit.streamed is not None
    edges, steps = fit.streamed.edges, fit.streamed.steps
    out = np.full((count, 3), np.nan)
    fold = np.searchsorted(edges, np.arange(start, start + count), side="right") - 1
    for number in np.unique(fold):
        own = fold == number
        parts = [v.part(own[v.index]) for v in views if isinstance(v, PositionView)]
        values = fit.solution.values + steps[number]
        part = residuals_of(
            [v for v in parts if len(v)], fit.problem.place(), values, np.zeros(len(fit.chain.ids)), count
        )
        out[own] = part[own]
    return out


def _spread(sizes: Sizes) -> Spread:
    rms = float(np.sqrt(sizes.square / sizes.count))
    return Spread(1e3 * rms, 1e3 * sizes.total / sizes.count, 1e3 * sizes.largest, sizes.count)
