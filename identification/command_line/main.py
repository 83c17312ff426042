"""The command line: reads, calls the public functions, prints and saves. Heavy imports live inside the commands."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NoReturn

import click

from errormodel.exceptions import ErrorModelError, InputError
from identification.command_line.console import (
    ANY,
    DRAWINGS,
    FILE,
    FOLDER,
    OUT_FILE,
    OUT_FOLDER,
    app,
    command,
    count_of,
    counting,
    crew_options,
    noise_of,
    read_model,
    save,
    say,
    show_notes,
    working,
)
from identification.command_line.interruption import exit_code, interruption_behind, kept_of, last_word, unless_gone
from identification.results.terminal import counted, one_line

if TYPE_CHECKING:
    from errormodel import Survey
    from identification.results.output_file import OutputFile
    from identification.results.results_folder import ResultsFolder
    from identification.results.stored_fit import Axes

NO_MEMORY = (
    "memory: there is too little for this input; nothing was put in place. "
    "Give fewer rows or a machine with fewer parameters, or raise the limit"
)
# what a library that cannot be loaded, and a thread that cannot be started, say of it
NO_MEMORY_WORDS = ("failed to map segment", "annot allocate memory", "can't start new thread")
MOST_POSES = 10_000_000  # simulated in one go
MOST_PLANNED = 2000


@command
def machines() -> None:
    """List the machines that come with the tool."""
    from errormodel import library, read_machine

    for name, path in library().items():
        say(f"{name:24} {read_machine(path).name}")


@command
@click.argument("machine")
@click.argument("survey", type=ANY, required=False)
@click.option("--json", "json_file", type=OUT_FILE, help="Write the description as JSON.")
@click.option("--drawing", type=OUT_FILE, help="Draw the chain (.svg or .png).")
def describe(machine: str, survey: Path | None, json_file: OutputFile | None, drawing: OutputFile | None) -> None:
    """Show the chain, its parameters, and which of them can be identified.

    Without a SURVEY: by random poses over the travels with one tool, seen from a known measuring frame. With one: by
    its poses and tools, also when the measuring frame is unknown.
    """
    from identification import api
    from identification.results.output_file import write_together

    if drawing is not None and drawing.path.suffix.lower() not in DRAWINGS:
        found = f"a drawing of type '{drawing.path.suffix}'"
        raise InputError(f"--drawing {drawing}", found, f"Write one of {', '.join(DRAWINGS)}")
    model = read_model(machine)
    points = None
    if survey is not None:
        from errormodel import read_survey

        points = read_survey(survey, model, measured=False)
        show_notes(points.notes)
    description = api.describe(model, points)
    write_together((json_file, description.as_json()), (drawing, description.draw))
    say(description.summary())


@command
@click.argument("machine")
@click.option("--points", type=click.IntRange(1, MOST_PLANNED), required=True, help="Rows to plan, repeats included.")
@click.option("--setup", type=FILE, help="YAML: what may be reached and seen, tools, instrument.")
@click.option("--noise", type=float, help="Standard uncertainty of a coordinate in mm. [default: 0.001]")
@click.option(
    "--criterion",
    type=click.Choice(["worst", "determinant"]),
    default="worst",
    show_default=True,
    help="Largest predicted uncertainty in the volume, or determinant of the information (D-optimal).",
)
@click.option("--out", type=OUT_FILE, help="CSV of the rows to measure, in order.")
@click.option("--json", "json_file", type=OUT_FILE, help="Write the plan's figures and verdicts as JSON.")
def plan(
    machine: str,
    points: int,
    setup: Path | None,
    noise: float | None,
    criterion: str,
    out: OutputFile | None,
    json_file: OutputFile | None,
    seed: int,
) -> None:
    """Plan poses by optimal design: how sure they make the model, and which physics they would show.

    SETUP may hold travels {joint: [low, high]}, tools [[x, y, z], ...], boxes to avoid, sight {station, facing,
    incidence}, instrument, frame, pace and sensors; mm, degrees and seconds.
    """
    from identification import api
    from identification.results.output_file import write_together

    model = read_model(machine)
    result = api.plan(
        model, points, setup=setup, noise=noise, criterion=criterion, seed=seed, progress=working
    )  # fmt: skip
    write_together((out, result.poses), (json_file, result.as_json()))
    say(result.summary())
    if out is not None:
        say(f"\n{len(result.poses)} rows written to {out}")


@command
@click.argument("machine")
@click.argument("points")
@click.option("--parameters", type=FILE, help="YAML: parameters {id: value}, frame, observations (mm, rad).")
@click.option(
    "--noise", default="0", help="Standard deviation in mm, or 'instrument': that of the survey's instrument."
)
@click.option("--out", type=OUT_FILE, required=True, help="CSV to write.")
@click.option(
    "--stream", is_flag=True, help="A block of rows at a time, as Parquet: for more rows than fit the memory."
)
def simulate(
    machine: str, points: str, parameters: Path | None, noise: str, out: OutputFile, stream: bool, seed: int
) -> None:
    """Simulate what would be measured at POINTS (a survey's commands, or a number of random poses)."""
    from errormodel import read_survey
    from errormodel import simulate as simulated

    model = read_model(machine)
    if stream:
        from identification.command_line.streams import simulate_stream

        return simulate_stream(model, points, parameters, noise, out, seed)
    survey = None
    if not points.isdecimal():
        survey = read_survey(Path(points), model, measured=False)
        show_notes(survey.notes)
    given = count_of(points, MOST_POSES) if survey is None else survey
    result = simulated(model, given, parameters, noise=_noise(noise, survey), seed=seed)
    show_notes(result.attrs["notes"])
    out.write_csv(result)
    say(f"{len(result)} points written to {out}")
    return None


def _noise(text: str, survey: Survey | None) -> float | Literal["instrument"]:
    if text == "instrument":
        if survey is None or (not survey.instrument.stated and not survey.observations):
            cure = "Add `instrument:` with its uncertainties to survey.yaml"
            raise InputError("--noise instrument", "the survey names no instrument with uncertainties", cure)
        return "instrument"
    return noise_of(text)


@command
@click.argument("machine")
@click.argument("survey", type=ANY)
@click.option("--out", type=OUT_FOLDER, required=True, help="Folder for fit.json, the tables and report.html.")
@click.option("--robust", is_flag=True, help="Weigh rows by how far they lie from the others; outliers are named.")
@click.option("--bayes", is_flag=True, help="The posterior: unknown noise, shapes of effects, with --robust outliers.")
@click.option("--priors", type=FILE, help="YAML: what is known beforehand: bounds; with --bayes priors too.")
@click.option(
    "--stream", is_flag=True, help="In one pass, a block of rows at a time: for more rows than fit the memory."
)
@click.option("--residuals", is_flag=True, help="With --stream: residuals.parquet of all rows, in a further pass.")
@click.option("--dwells", is_flag=True, help="Find the dwells of a continuous log, and fit the mean of each.")
@partial(crew_options, what="Processes of --stream and --dwells. [default: 1]")
def fit(
    machine: str,
    survey: Path,
    out: ResultsFolder,
    robust: bool,
    bayes: bool,
    priors: Path | None,
    stream: bool,
    residuals: bool,
    dwells: bool,
    engine: Literal["local", "dask"],
    scheduler: str | None,
    workers: int | None,
    seed: int,
) -> None:
    """Fit the machine's parameters to a SURVEY: values, uncertainties, residuals, a report."""
    from identification import api
    from identification.command_line import streams
    from identification.results.folder_contents import CHAIN

    model = read_model(machine)
    streams.check(stream, residuals, dwells, robust, bayes, engine, workers)
    crew = {"engine": engine, "scheduler": scheduler, "workers": workers}
    if stream:
        return streams.fit_stream(model, survey, out, priors, residuals, crew)
    data = streams.read(model, survey, dwells, crew)
    show_notes(data.notes)
    result = api.fit(
        model, data, robust=robust, bayes=bayes, priors=priors, seed=seed, checkpoint=out.workspace(CHAIN),
        progress=working, steps=counting,
    )  # fmt: skip
    if result.fit.posterior is not None:
        say(result.fit.posterior.statement)
        show_notes(result.fit.posterior.notes)
    show_notes(tuple(n for n in result.notes if n not in data.notes))
    save(result, out)
    return None


@command
@click.argument("machine")
@click.argument("survey", type=ANY)
@click.option(
    "--out", type=OUT_FOLDER, required=True, help="Folder for diagnosis.json, machine.yaml, the fit and report.html."
)
def diagnose(machine: str, survey: Path, out: ResultsFolder) -> None:
    """Fit, then find the physics that was left out: where, what, how sure; the fit is that of the extended machine."""
    from errormodel import read_survey
    from identification import api

    model = read_model(machine)
    with working("Reading"):
        data = read_survey(survey, model)
    show_notes(data.notes)
    result = api.diagnose(model, data, progress=working)
    show_notes(tuple(n for n in result.notes if n not in data.notes))
    save(result, out)


@command
@click.argument("folder", type=FOLDER)
@click.argument("points", type=ANY)
@click.option("--out", type=OUT_FILE, required=True, help="CSV to write.")
@click.option(
    "--stream", is_flag=True, help="A block of rows at a time, as Parquet: for more rows than fit the memory."
)
@click.option(
    "--axes",
    type=click.Choice(["measured", "machine"]),
    default="measured",
    help="Of ex ey ez and ux uy uz: axes of the measuring frame (a tracker's, however it is turned), or x y z of "
    "machine.yaml.  [default: measured]",
)
def predict(folder: Path, points: Path, out: OutputFile, stream: bool, axes: Axes) -> None:
    """Predict at POINTS from the FOLDER of a fit: position, volumetric error, standard uncertainty.

    All are along the axes of the measuring frame; --axes machine gives errors along those of the machine.
    """
    from errormodel import read_survey
    from identification import api

    if stream:
        from identification.command_line.streams import predict_stream

        return predict_stream(folder, points, out, axes)

    saved = api.load(folder)
    commands = read_survey(points, saved.machine, measured=False)
    show_notes(saved.notes_on(commands, axes))
    table = api.predict(saved, commands, axes=axes, progress=working)
    out.write_csv(table)
    say(f"{counted(len(table), 'prediction')} written to {out}")
    return None


# Importing these registers their commands, after the others.
from identification.command_line import compensate as cli_compensate  # noqa: E402, F401
from identification.command_line import explain as cli_explain  # noqa: E402, F401
from identification.command_line import fleet as cli_fleet  # noqa: E402, F401
from identification.command_line import importing as cli_importing  # noqa: E402, F401
from identification.command_line import iso as cli_iso  # noqa: E402, F401
from identification.command_line import machine_files as cli_machine_files  # noqa: E402, F401
from identification.command_line import monitor as cli_monitor  # noqa: E402, F401
from identification.command_line import register as cli_register  # noqa: E402, F401
from identification.command_line import rerun as cli_rerun  # noqa: E402, F401
from identification.command_line import thermal as cli_thermal  # noqa: E402, F401
from identification.command_line import verify as cli_verify  # noqa: E402, F401


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command: one message and exit code 2 for wrong input, never a traceback for it."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # a code page that lacks a letter of somebody's machine
        sys.stdout.reconfigure(errors="replace")
    try:
        app(arguments, prog_name="errormodel", standalone_mode=False)
    except InputError as error:
        _fail(str(error))
    except ErrorModelError as error:
        _fail(str(error), code=1)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        sys.exit(2)
    except click.ClickException as error:
        context = error.ctx if isinstance(error, click.UsageError) else None
        name = context.command_path if context is not None else "errormodel"
        found = error.format_message().rstrip(".")
        _fail(f"{name}: {found}{'' if found.endswith('?') else '.'} See {name} --help")
    except click.exceptions.Abort as error:
        _stopped(interruption_behind(error))
    except BrokenPipeError:
        sys.exit(1)
    except MemoryError:
        _fail(NO_MEMORY)
    except (ImportError, RuntimeError) as error:
        if not _from_lack_of_memory(error):
            raise
        _fail(NO_MEMORY)
    except OSError as error:  # a full disk, a device that fails
        if error.filename is None:  # such as standard output, after results were put in place
            _fail(f"the output: {error.strerror}. Free space there, or send it elsewhere", code=1)
        place, cure = str(error.filename), "Nothing was put in place; free space there, or give another place"
        _fail(f"{place}: {error.strerror}. {cure}", code=1)


def _from_lack_of_memory(error: BaseException | None) -> bool:
    """Whether an error, or what caused it, says that memory is short."""
    if error is None:
        return False
    return any(words in str(error) for words in NO_MEMORY_WORDS) or _from_lack_of_memory(error.__cause__)


def _stopped(interruption: KeyboardInterrupt | None) -> NoReturn:
    last_word(f"stopped: {kept_of(interruption)}")
    sys.exit(exit_code(interruption))


def _fail(message: str, code: int = 2) -> None:
    if interruption := interruption_behind(sys.exception()):  # a terminal was closed, and takes no output more
        _stopped(interruption)
    with unless_gone():
        click.secho(f"error: {one_line(message)}", err=True, fg="red")
    sys.exit(code)


def entry() -> None:
    """The whole of a process: `main`, and an end without a traceback where nobody takes its output."""
    try:
        try:
            main()
        finally:
            sys.stdout.flush()
    except OSError as error:  # the reader left, or the disk of a redirected output is full
        # what is still buffered goes nowhere: the interpreter would report that it cannot flush it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        ended = error.__context__
        sys.exit((isinstance(ended, SystemExit) and ended.code) or 1)


if __name__ == "__main__":
    entry()
