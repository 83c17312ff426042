"""Surveys larger than memory: fit, predict and simulate a block of rows at a time; dwells of continuous logs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from identification.runtime.progress import Steps, uncounted
from identification.sources import AnyMachine, machine_of

if TYPE_CHECKING:
    import pandas as pd

    from errormodel.survey import Survey
    from identification.api.uses import AnyFit
    from identification.results.stored_fit import Axes
    from identification.results.streamed_result import StreamedFitResult
    from identification.runtime.engines import Engine

Rows: TypeAlias = "str | Path | pd.DataFrame"


def fit_stream(
    machine: AnyMachine,
    survey: Rows,
    *,
    priors: Mapping[str, Mapping[str, float]] | str | Path | None = None,
    all_residuals: bool = False,
    engine: Engine = "local",
    scheduler: str | None = None,
    workers: int | None = 1,
    announce: Callable[[str], None] = lambda _text: None,
    steps: Steps = uncounted,
) -> StreamedFitResult:
    """Fit a survey that may be larger than memory, in one pass over its rows.

    A sample of the rows is fitted as `fit` does; the pass then sums up all rows near that solution, and the solution of
    all of them follows from the sums. Where the survey is no larger than the sample the result is that of `fit`. The
    sums are combined in a fixed tree: the result is the same whatever the parts, workers and engine.

    Parameters
    ----------
    machine : Machine, str, Path or dict
    survey : str, Path or DataFrame
        A Parquet or CSV file, a folder of them, or a survey.yaml that names such.
    priors : dict, str, Path or None
        Bounds of parameters, as of `fit`.
    all_residuals : bool
        `save` also writes ``residuals.parquet`` with the residuals of all rows, in a further pass.
    engine : {"local", "dask"}
    scheduler : str or None
        Address of a Dask scheduler; None: a cluster on this computer.
    workers : int or None
        Processes; 1: this one; None: one a core.
    announce : callable
        Called with sentences such as the address of Dask's dashboard.
    steps : callable
        Called with the name of work that knows how far it is; returns a context manager.

    Returns
    -------
    StreamedFitResult
        Its ``residuals`` and figures are of the sample.

    Raises
    ------
    InputError
        The rows are wrong, or hold what cannot be fitted in a stream: orientations, error motions, single readings,
        effects that follow from the course of all rows, or a frame for each run.
    """
    from errormodel.survey_rows import open_rows
    from identification.bayes.settings import priors_of
    from identification.results.streamed_result import StreamedFitResult
    from identification.runtime.engines import Crew
    from identification.streaming.fit import fit_rows

    model = machine_of(machine)
    crew = Crew(engine, workers, scheduler, announce)
    crew.check()
    bounds, document = priors_of(priors, bounds_only=True)
    rows = open_rows(survey, model)
    with steps("Fitting") as report:
        fit = fit_rows(model, rows, bounds, document, crew=crew, report=report)
    return StreamedFitResult(fit, rows, all_residuals, steps)


def predict_stream(
    fit: AnyFit, points: Rows, out: str | Path, *, axes: Axes = "measured", steps: Steps = uncounted
) -> tuple[int, tuple[str, ...]]:
    """Predict at commands that may be more than fit the memory, and write a Parquet file.

    Parameters
    ----------
    fit, points : as of `predict`, `points` in a file or a folder.
    out : str or Path
    axes : as of `predict`.
    steps : callable
        As of `fit_stream`.

    Returns
    -------
    tuple
        Number of rows written, and notes on what was assumed.

    Raises
    ------
    InputError
        The folder holds no fit, or the commands cannot be predicted a block at a time.
    """
    from errormodel.files import write_parquet_blocks
    from errormodel.survey_rows import open_rows
    from errormodel.surveys.columns import MEASURED
    from identification.api.uses import stored_of
    from identification.results.predictions import UNUSED
    from identification.streaming.tables import Noted, predictions

    stored, noted = replace(stored_of(fit), error_axes=axes), Noted()
    rows = open_rows(points, stored.chain.machine, measured=False)
    with steps("Predicting") as report:
        count = write_parquet_blocks(predictions(stored, rows, noted, report), out)
    unused = (UNUSED,) if rows.columns.intersection(MEASURED) else ()
    return count, (*stored.unlisted, *rows.notes, *noted.notes, *unused)


def simulate_stream(
    machine: AnyMachine,
    points: int | Rows,
    out: str | Path,
    parameters: dict[str, float] | str | Path | None = None,
    *,
    noise: Any = 0.0,
    seed: int = 0,
    steps: Steps = uncounted,
) -> int:
    """Simulate a survey of any length, and write a Parquet file; see `errormodel.simulate`.

    Random numbers are drawn from a seed of their own for each block of rows: they are not those of `simulate`.

    Parameters
    ----------
    machine, points, parameters, noise, seed : as of `errormodel.simulate`, `points` a number, a file or a folder.
    out : str or Path
    steps : callable
        As of `fit_stream`.

    Returns
    -------
    int
        Number of rows.

    Raises
    ------
    InputError
        The machine, the commands or a parameter's id cannot be read.
    """
    from errormodel.files import write_parquet_blocks
    from errormodel.survey_rows import open_rows
    from identification.streaming.tables import simulated

    model = machine_of(machine)
    given = points if isinstance(points, int) else open_rows(points, model, measured=False)
    with steps("Simulating") as report:
        return write_parquet_blocks(simulated(model, given, parameters, noise, seed, report), out)


def average_dwells(
    machine: AnyMachine,
    survey: Rows,
    *,
    engine: Engine = "local",
    scheduler: str | None = None,
    workers: int | None = 1,
    announce: Callable[[str], None] = lambda _text: None,
    steps: Steps = uncounted,
) -> Survey:
    """Dwells of a continuous log that may be larger than memory, each averaged to one row, in one pass.

    Parameters
    ----------
    machine, survey, engine, scheduler, workers, announce, steps : as of `fit_stream`.

    Returns
    -------
    Survey
        Which `fit`, `diagnose` and the like take; its last note says what was found.

    Raises
    ------
    InputError
        The rows are wrong, or no continuous log.
    """
    from errormodel.survey_rows import open_rows
    from identification.runtime.engines import Crew
    from identification.streaming.dwells import dwell_survey

    model = machine_of(machine)
    crew = Crew(engine, workers, scheduler, announce)
    crew.check()
    rows = open_rows(survey, model, every=True)
    with steps("Finding dwells") as report:
        return dwell_survey(rows, crew=crew, report=report)
