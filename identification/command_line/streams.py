"""What the commands do with --stream and --dwells: surveys that may be larger than memory."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from errormodel.exceptions import InputError
from identification.command_line.console import count_of, counting, noise_of, save, say, show_notes, working
from identification.results.terminal import counted

if TYPE_CHECKING:
    from errormodel import Machine, Survey
    from identification.results.output_file import OutputFile
    from identification.results.results_folder import ResultsFolder
    from identification.results.stored_fit import Axes

MOST_STREAMED_POSES = 1_000_000_000  # simulated block by block


def check(
    stream: bool, residuals: bool, dwells: bool, robust: bool, bayes: bool, engine: str, workers: int | None
) -> None:
    """Refuse options of `fit` that do not go together.

    Raises
    ------
    InputError
        What a streamed fit cannot do, or what only it does.
    """
    if stream and robust:
        found = "the weight of a row depends on all the others, which one pass does not know"
        raise InputError(
            "--robust with --stream", found, "Leave out one of the two; a sample of the rows can be robust"
        )
    if stream and bayes:
        found = "the sampler needs all rows for each draw"
        raise InputError("--bayes with --stream", found, "Leave out one of the two")
    if stream and dwells:
        found = "the dwells of a log are few enough for the memory"
        raise InputError(
            "--dwells with --stream", found, "Leave out --stream: --dwells reads the log in blocks as well"
        )
    if residuals and not stream:
        raise InputError("--residuals", "without --stream", "Leave it out: residuals.csv has all rows")
    if not (stream or dwells) and (engine != "local" or workers is not None):
        raise InputError("--engine, --workers", "without --stream or --dwells", "Add one of these, or leave them out")


def fit_stream(
    model: Machine, survey: Path, out: ResultsFolder, priors: Path | None, residuals: bool, crew: dict[str, Any]
) -> None:
    """`fit --stream`."""
    from identification import api

    result = api.fit_stream(
        model, survey, priors=priors, all_residuals=residuals, announce=say, steps=counting, **_one(crew)
    )
    show_notes(result.notes)
    save(result, out)
    say(result.pace)


def read(model: Machine, survey: Path, dwells: bool, crew: dict[str, Any]) -> Survey:
    """The survey of `fit`; with `dwells` the means of those of a log."""
    if dwells:
        from identification import api

        return api.average_dwells(model, survey, announce=say, steps=counting, **_one(crew))
    from errormodel import read_survey

    with working("Reading"):
        return read_survey(survey, model)


def _one(crew: dict[str, Any]) -> dict[str, Any]:
    """By default one process: several need the memory several times."""
    alone = crew["workers"] is None and crew["scheduler"] is None
    return crew | ({"workers": 1} if alone else {})


def predict_stream(folder: Path, points: Path, out: OutputFile, axes: Axes) -> None:
    """`predict --stream`."""
    from identification import api

    saved = api.load(folder)
    _check_parquet(out)
    with out.replaced() as part:
        count, notes = api.predict_stream(saved, points, part, axes=axes, steps=counting)
    show_notes(notes)
    say(f"{counted(count, 'prediction')} written to {out}")


def simulate_stream(
    model: Machine, points: str, parameters: Path | None, noise: str, out: OutputFile, seed: int
) -> None:
    """`simulate --stream`."""
    from identification import api

    _check_parquet(out)
    given = count_of(points, MOST_STREAMED_POSES) if points.isdecimal() else points
    level = "instrument" if noise == "instrument" else noise_of(noise)
    with out.replaced() as part:
        count = api.simulate_stream(model, given, part, parameters, noise=level, seed=seed, steps=counting)
    say(f"{count} points written to {out}")


def _check_parquet(out: OutputFile) -> None:
    if out.path.suffix.lower() not in (".parquet", ".pq"):
        raise InputError(f"--out {out}", "no Parquet file", "With --stream write a name such as predicted.parquet")
