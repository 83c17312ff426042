"""The command line: calls the stages in order and holds no mathematics. Heavy imports live inside the commands."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from errormodel.exceptions import ErrorModelError, InputError
from identification.command_line.console import (
    ANY,
    FILE,
    FOLDER,
    OUT_FILE,
    OUT_FOLDER,
    app,
    command,
    one_line,
    read_model,
    say,
    show_notes,
    working,
)

if TYPE_CHECKING:
    from identification.diagnosis.pipeline import Diagnosed
    from identification.estimation.result import Fit
    from identification.results.description import Description
    from identification.results.output_file import OutputFile
    from identification.results.results_folder import ResultsFolder

STOPPED = 130  # exit code of what Ctrl-C ended: 128 and the number of SIGINT
DRAWINGS = (".svg", ".png", ".pdf")
MOST_POSES = 10_000_000  # simulated in one go
MOST_PLANNED = 2000


@command
def machines() -> None:
    """List the machines that come with the tool."""
    from errormodel.machine_file import library, read_machine

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
    from identification.results import description as stage

    if drawing is not None and drawing.path.suffix.lower() not in DRAWINGS:
        found = f"a drawing of type '{drawing.path.suffix}'"
        raise InputError(f"--drawing {drawing}", found, f"Write one of {', '.join(DRAWINGS)}")
    model = read_model(machine)
    points = None
    if survey is not None:
        from errormodel.survey import read_survey

        points = read_survey(survey, model, measured=False)
        show_notes(points.notes)
    description = stage.describe(model, points)
    if json_file is not None:
        from identification.results.store import dumps

        json_file.write_text(dumps(description.as_json()))
    if drawing is not None:
        from identification.plots.chain_drawing import draw_chain

        with drawing.replaced() as part:
            draw_chain(model, part)
    _say_description(description)


def _say_description(description: Description) -> None:
    from identification.command_line.text import description_lines

    for line in description_lines(description):
        say(line)


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
    from identification.planning import run as stage
    from identification.planning.setup import Setup, noise_of, read_setup
    from identification.planning.text import plan_lines
    from identification.results.store import dumps

    model = read_model(machine)
    circumstances = Setup(errormodel=1) if setup is None else read_setup(setup, model)
    sigma = noise_of(circumstances, noise)
    result = stage.plan(model, circumstances, points, sigma, seed, worst=criterion == "worst", progress=working)
    if out is not None:
        out.write_csv(stage.as_file(result, circumstances))
    if json_file is not None:
        json_file.write_text(dumps(result.as_json()))
    for line in plan_lines(result):
        say(line)
    if out is not None:
        say(f"\n{len(result.table)} rows written to {out}")


@command
@click.argument("machine")
@click.argument("points")
@click.option("--parameters", type=FILE, help="YAML: parameters {id: value in mm, rad}, frame {translation, rotation}.")
@click.option(
    "--noise", default="0", help="Standard deviation in mm, or 'instrument': that of the survey's instrument."
)
@click.option("--out", type=OUT_FILE, required=True, help="CSV to write.")
def simulate(machine: str, points: str, parameters: Path | None, noise: str, out: OutputFile, seed: int) -> None:
    """Simulate what would be measured at POINTS (a survey's commands, or a number of random poses)."""
    from errormodel import simulation as stage
    from errormodel.chain import Chain
    from errormodel.effects.axis_blunder import marred
    from errormodel.instruments.base import Instrument
    from errormodel.instruments.plain import Plain
    from errormodel.survey import read_survey

    model = read_model(machine)
    instrument: Instrument = Plain()
    if points.isdecimal():
        table = stage.random_points(model, _count(points), seed)
    else:
        survey = read_survey(Path(points), model, measured=False)
        show_notes(survey.notes)
        table, instrument = survey.table, survey.instrument
    truth = stage.read_truth(parameters, Chain(model)) if parameters is not None else stage.Truth({})
    measured = stage.measured_at(model, table, truth, _noise(noise, instrument), seed)
    # orientations are exact, which no instrument is: those of the survey go, none take their place
    stale = ["file", "role", "row", "mrx", "mry", "mrz"]
    result = table.drop(columns=stale, errors="ignore")
    for name in measured.columns.difference(stale, sort=False):
        result[name] = measured[name]
    out.write_csv(stage.outward(marred(result, model), model))
    say(f"{len(result)} points written to {out}")


def _count(text: str) -> int:
    if not 0 < int(text[:9]) == float(text) <= MOST_POSES:
        raise InputError("POINTS", f"{text} random poses", f"Write a number from 1 to {MOST_POSES}, or name a survey")
    return int(text)


def _noise(text: str, instrument: Any) -> Any:
    if text == "instrument":
        if type(instrument).__name__ == "Plain":
            raise InputError("--noise instrument", "the survey names no instrument", "Add `instrument:` to survey.yaml")
        return instrument
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < float("inf"):
        raise InputError("--noise", f"'{text}'", "Write a standard deviation in mm (0.005), or instrument")
    return value


@command
@click.argument("machine")
@click.argument("survey", type=ANY)
@click.option("--out", type=OUT_FOLDER, required=True, help="Folder for fit.json, the tables and report.html.")
@click.option("--robust", is_flag=True, help="Weigh rows by how far they lie from the others; outliers are named.")
@click.option("--bayes", is_flag=True, help="The posterior: unknown noise, shapes of effects, with --robust outliers.")
@click.option("--priors", type=FILE, help="YAML: what is known beforehand: bounds; with --bayes priors too.")
def fit(
    machine: str, survey: Path, out: ResultsFolder, robust: bool, bayes: bool, priors: Path | None, seed: int
) -> None:
    """Fit the machine's parameters to a SURVEY: values, uncertainties, residuals, a report."""
    from errormodel.survey import read_survey
    from identification.command_line.fit_bayes import beforehand, with_posterior
    from identification.diagnosis.data_checks.gate import passed
    from identification.estimation.run import fit_machine

    model = read_model(machine)
    with working("Reading"):
        data = read_survey(survey, model)
    show_notes(data.notes)
    given, document = beforehand(priors, bayes)
    bounds = {} if bayes else given
    with working("Fitting"):
        result = passed(model, data, lambda: fit_machine(model, data, robust, bounds, document), robust)
    if bayes:
        result = with_posterior(result, lambda m: fit_machine(m, data, robust), given, document, robust, seed, out)
    show_notes(tuple(n for n in result.notes if n not in data.notes))
    _save(result, out)
    _say_fit(result, out)


def _save(result: Fit, out: ResultsFolder, diagnosed: Diagnosed | None = None) -> None:
    from errormodel.files import write_text_atomic
    from identification.report import write_report
    from identification.results import store

    with out.replaced() as part:
        with working("Writing tables"):
            store.write(result, part)
            if result.posterior is not None:
                from identification.bayes.netcdf import write_netcdf

                write_netcdf(result, result.posterior, part / "posterior.nc")
            if diagnosed is not None:
                write_text_atomic(store.dumps(diagnosed.diagnosis.as_json()), part / "diagnosis.json")
        with working("Drawing the report"):
            write_report(result, part / "report.html", diagnosed)
    show_notes(out.notes)


def _say_fit(result: Fit, out: ResultsFolder) -> None:
    from identification.command_line.text import fit_lines

    for line in fit_lines(result):
        say(line)
    say(f"\nReport: {out.path / 'report.html'}")


@command
@click.argument("machine")
@click.argument("survey", type=ANY)
@click.option(
    "--out", type=OUT_FOLDER, required=True, help="Folder for diagnosis.json, machine.yaml, the fit and report.html."
)
def diagnose(machine: str, survey: Path, out: ResultsFolder) -> None:
    """Fit, then find the physics that was left out: where, what, how sure; the fit is that of the extended machine."""
    from errormodel.survey import read_survey
    from identification.command_line.text import diagnosis_lines
    from identification.diagnosis.pipeline import diagnose as stage

    model = read_model(machine)
    with working("Reading"):
        data = read_survey(survey, model)
    show_notes(data.notes)
    result = stage(model, data, working)
    show_notes(tuple(n for n in result.diagnosis.notes if n not in data.notes))
    _save(result.final, out, result)
    for line in diagnosis_lines(result.diagnosis):
        say(line)
    say(f"\nReport: {out.path / 'report.html'}")


@command
@click.argument("folder", type=FOLDER)
@click.argument("points", type=ANY)
@click.option("--out", type=OUT_FILE, required=True, help="CSV to write.")
def predict(folder: Path, points: Path, out: OutputFile) -> None:
    """Predict at POINTS from the FOLDER of a fit: position, volumetric error, standard uncertainty."""
    from errormodel.effects.axis_blunder import marred
    from errormodel.simulation import outward
    from errormodel.survey import read_survey
    from identification.results import store
    from identification.uncertainty import prediction as stage

    stored = store.load(folder)
    machine = stored.chain.machine
    survey = read_survey(points, machine, measured=False)
    show_notes((*survey.notes, *stage.notes(stored, survey)))
    with working("Predicting"):
        result = stage.predict(stored, survey)
    table = outward(marred(survey.table, machine), machine)
    table = table.drop(columns=["file", "role", "row", *result.columns], errors="ignore")
    out.write_csv(table.join(result))
    say(f"{len(result)} predictions written to {out}")


# Importing these registers their commands, after the others.
from identification.command_line import compensate as cli_compensate  # noqa: E402, F401
from identification.command_line import monitor as cli_monitor  # noqa: E402, F401
from identification.command_line import register as cli_register  # noqa: E402, F401
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
    except click.exceptions.Abort:
        click.echo("stopped: nothing was put in place", err=True)
        sys.exit(STOPPED)
    except BrokenPipeError:
        sys.exit(1)


def _fail(message: str, code: int = 2) -> None:
    click.secho(f"error: {one_line(message)}", err=True, fg="red")
    sys.exit(code)


def entry() -> None:
    """The whole of a process: `main`, and an end without a message where the reader of its output left early."""
    try:
        try:
            main()
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        # what is still buffered goes nowhere: the interpreter would report that it cannot flush it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)


if __name__ == "__main__":
    entry()
