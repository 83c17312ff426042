"""What all commands of the command line share: the group, options that every command has, and how they print."""

from __future__ import annotations

import functools
import inspect
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from errormodel import __version__
from errormodel.exceptions import InputError
from errormodel.inputs import Run, check_readable, is_unicode, running
from identification.command_line.memory import check_limit
from identification.results.output_file import OutputFile, check_name, doubts_on_name
from identification.results.results_folder import ResultsFolder
from identification.results.terminal import one_line

if TYPE_CHECKING:
    from errormodel import Machine
    from identification.results.fit_result import FitResult

FOLDER = click.Path(path_type=Path, file_okay=False)  # to read
FILE = click.Path(path_type=Path, dir_okay=False)
ANY = click.Path(path_type=Path)
LARGEST_NOISE_MM = 1e4  # of a simulated recording: beyond the size of machines
DRAWINGS = (".svg", ".png", ".pdf")  # types of a figure


class _Out(click.Path):
    """A place to write to, as the one object through which a command may write there."""

    def __init__(self, make: Callable[[Path], OutputFile | ResultsFolder], **kinds: bool) -> None:
        super().__init__(path_type=Path, **kinds)
        self.make = make

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if not str(value):
            raise InputError(str(param.opts[0] if param else "--out"), "an empty name", "Give a name")
        if not is_unicode(os.fsdecode(value)):
            found = f"{os.fsencode(value)!r}, a name that is not UTF-8"
            raise InputError(str(param.opts[0] if param else "--out"), found, "Give a name in UTF-8")
        path = Path(os.fsdecode(super().convert(value, param, ctx)))
        check_name(path)
        return self.make(path)


OUT_FILE = _Out(OutputFile, dir_okay=False)
OUT_FOLDER = _Out(ResultsFolder, file_okay=False)  # a fit
OUT_SURVEY = _Out(partial(ResultsFolder, holds="survey"), file_okay=False)
OUT_TABLES = _Out(partial(ResultsFolder, holds="tables"), file_okay=False)
OUT_EVALUATION = _Out(partial(ResultsFolder, holds="evaluation"), file_okay=False)
OUT_FLEET = _Out(partial(ResultsFolder, holds="fleet"), file_okay=False)


class MannerOption(click.Option):
    """An option that says how a result is reached, and does not change it: no manifest has it."""


def crew_options(function: Callable[..., None], what: str = "Processes. [default: one a core]") -> Callable[..., None]:
    """The options that say who works: --engine, --scheduler, --workers."""
    engine = click.option(
        "--engine", cls=MannerOption, type=click.Choice(["local", "dask"]), default="local", show_default=True,
        help="Processes of this computer, or Dask distributed.",
    )  # fmt: skip
    scheduler = click.option(
        "--scheduler", cls=MannerOption, metavar="ADDRESS",
        help="With dask: its scheduler. [default: a cluster on this computer]",
    )  # fmt: skip
    workers = click.option("--workers", cls=MannerOption, type=click.IntRange(1), help=what)
    return engine(scheduler(workers(function)))


class Group(click.Group):
    """Commands in the order of the work, and a near name for one that does not exist."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        from errormodel.exceptions import nearest

        if args and not args[0].startswith("-") and args[0] not in self.commands:
            raise InputError("errormodel", f"there is no command '{args[0]}'", nearest(args[0], self.commands))
        return super().resolve_command(ctx, args)


@click.group(cls=Group, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(__version__, prog_name="errormodel")
def app() -> None:
    """Volumetric error models of machine tools, CMMs, gantries and arms.

    MACHINE is a machine.yaml, or the name of a machine that comes with the tool (`errormodel machines` lists them).
    SURVEY is a CSV, a survey.yaml, or a folder of CSV or Parquet parts.
    """


def command(function: Callable[..., None]) -> click.Command:
    """Register a command with the options that every command has; those that draw no random numbers ignore the seed."""
    draws = "seed" in inspect.signature(function).parameters

    @functools.wraps(function)
    def run(*args: Any, quiet: bool, seed: int, **kwargs: Any) -> None:
        global _quiet  # noqa: PLW0603  one process runs one command, or one within another
        check_limit()
        before, _quiet = _quiet, quiet
        try:
            given = kwargs | ({"seed": seed} if draws else {})
            with running(_run_of(given)):
                function(*args, **given)
        finally:
            _quiet = before

    run = click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Random seed.")(run)
    run = click.option("--quiet", is_flag=True, help="Print nothing but errors.")(run)
    return app.command(function.__name__.rstrip("_"))(run)  # `import` is a word of Python


def _run_of(given: dict[str, Any]) -> Run:
    """The command under way: what it writes is checked before it does anything.

    Raises
    ------
    InputError
        It would write over what it reads, over what errormodel did not write, or twice to one place.
    """
    context = click.get_current_context()
    outputs = [v for v in given.values() if isinstance(v, OutputFile | ResultsFolder)]
    options = {p.name: _plain(given[p.name]) for p in context.command.params if _changes_result(p, given)}
    arguments = {str(p.name): _named(given[p.name]) for p in context.command.params if isinstance(p, click.Argument)}
    run = Run(str(context.info_name), arguments, options, outputs)
    for k, output in enumerate(outputs):
        if any(output.path.absolute() == other.path.absolute() for other in outputs[:k]):
            raise InputError(str(output), "two results of this command in one file", "Give each a name of its own")
    for param in context.command.params:
        if type(param.type) is click.Path:
            several = given.get(param.name or "")
            for path in several if isinstance(several, tuple) else [several]:
                if path is not None:
                    check_readable(path)
                    run.refuse(path)
    for param in context.command.params:
        value = given.get(param.name or "")
        numbers = [v for v in (value if isinstance(value, tuple) else (value,)) if isinstance(v, float)]
        if not all(map(isfinite, numbers)):
            raise InputError(param.opts[0], " ".join(f"{v:g}" for v in numbers), "Write finite numbers")
    for output in outputs:
        output.check()
        show_notes(doubts_on_name(output.path))
    return run


def _changes_result(param: click.Parameter, given: dict[str, Any]) -> bool:
    changes = isinstance(param, click.Option) and not isinstance(param, MannerOption)
    return changes and param.name in given and not isinstance(param.type, _Out)


def _named(value: Any) -> Any:
    """An argument as a manifest has it: a machine may be given by its path as well."""
    return _plain(Path(value) if isinstance(value, str) and value else value)


def _plain(value: Any) -> Any:
    """An option or argument as a manifest has it: of a file its name, wherever it stands."""
    if isinstance(value, tuple | list):
        return [_plain(v) for v in value]
    return (value.name or value.resolve().name) if isinstance(value, Path) else value


_quiet = False


def say(text: str = "") -> None:
    """Print a line of the result."""
    if not _quiet:
        click.echo("\n".join(map(one_line, text.split("\n"))))


@contextmanager
def working(text: str) -> Iterator[None]:
    """Show what is being done: a spinner on a terminal, a plain line elsewhere."""
    if _quiet:
        yield
    elif sys.stderr.isatty():
        from rich.console import Console

        with Console(stderr=True).status(text):
            yield
    else:
        say(f"{text} ...")  # not on stderr, which is left to what needs attention
        yield


@contextmanager
def counting(text: str) -> Iterator[Callable[[float, str], None]]:
    """Show how far work is that can tell: a bar on a terminal, a plain line for each remark elsewhere."""
    if _quiet:
        yield lambda _share, _remark: None
    elif sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        parts = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
        with Progress(*parts, TimeRemainingColumn(), console=Console(stderr=True)) as progress:
            task = progress.add_task(text, total=1.0)
            yield lambda share, remark: progress.update(
                task, completed=share, description=f"{text}: {remark}" if remark else text
            )
    else:
        say(f"{text} ...")
        yield lambda share, remark: say(f"  {100 * share:3.0f} %  {remark}") if remark else None


def show_notes(notes: tuple[str, ...]) -> None:
    """Print what needs attention, on stderr."""
    for note in notes:
        if not _quiet:
            click.secho(f"note: {one_line(note)}", err=True, fg="yellow")


def read_model(machine: str) -> Machine:
    """The machine that a command was given; what in its file is hardly meant is said."""
    from errormodel import read_machine

    model = read_machine(machine)
    show_notes(model.doubts)
    return model


def save(result: FitResult, out: ResultsFolder) -> None:
    """Write a result with its report, and print it."""
    result.save(out, report=True, progress=working)
    show_notes(out.notes)
    say(result.summary())
    say(f"\nReport: {out.path / 'report.html'}")


def count_of(text: str, most: int) -> int:
    """A number of random poses; InputError beyond `most`."""
    if not 0 < int(text[:12]) == float(text) <= most:
        raise InputError("POINTS", f"{text} random poses", f"Write a number from 1 to {most}, or name a survey")
    return int(text)


def noise_of(text: str) -> float:
    """A standard deviation of simulated noise, mm; InputError where it is none."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value <= LARGEST_NOISE_MM:
        raise InputError("--noise", f"'{text}'", "Write a standard deviation in mm (0.005), or instrument")
    return value
