"""Commands that make and look at surveys: import, check, template."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from errormodel.exceptions import InputError
from identification.command_line.console import (
    ANY,
    FILE,
    OUT_FILE,
    OUT_SURVEY,
    command,
    read_model,
    say,
    show_notes,
    working,
)

if TYPE_CHECKING:
    from identification.results.output_file import OutputFile
    from identification.results.results_folder import ResultsFolder


@command
@click.argument("raw", type=FILE, nargs=-1, required=True)
@click.option("--machine", required=True, help="machine.yaml, or the name of a machine of the library.")
@click.option("--commands", type=FILE, help="NC programme, plan, log or table with the commanded positions.")
@click.option(
    "--match",
    type=click.Choice(["auto", "name", "order", "nearest", "time"]),
    default="auto",
    show_default=True,
    help="How readings find their commands.",
)
@click.option("--out", type=OUT_SURVEY, required=True, help="Folder for survey.yaml, the raw files and a picture.")
@click.option(
    "--columns", multiple=True, metavar="OURS=THEIRS,...", help="Of RAW: mx=East,my=-North; or point,mx,my,mz."
)
@click.option(
    "--units",
    multiple=True,
    metavar="COLUMN=UNIT,...",
    help="Of RAW, where it states none: mx=m, length=inch or X=diameter.",
)
@click.option("--command-columns", multiple=True, metavar="OURS=THEIRS,...", help="The same of --commands.")
@click.option("--command-units", multiple=True, metavar="COLUMN=UNIT,...", help="The same of --commands.")
@click.option("--format", "form", default="", help="Raw format of RAW. [default: recognised]")
@click.option("--command-format", default="", help="Raw format of --commands. [default: recognised]")
@click.option("--sheet", default="", help="Of a workbook. [default: the first that is no cover sheet]")
@click.option("--dates", type=click.Choice(["day-first", "month-first"]), help="Where a file does not show it.")
@click.option("--joint", default="", help="Joint of a file of readings of one joint.")
@click.option(
    "--dialect", default="auto", help="Of G-code: auto, iso, fanuc, fanuc-calculator, fanuc-increments or printer."
)
@click.option("--offset", "offsets", multiple=True, help="Of a programme: X.. or G54=X..,Y.. or H1=Z.. (mm, deg).")
@click.option("--at", "after", multiple=True, help="Where axes stand in a programme: start=X0,Y0 or G28=Z0 (mm, deg).")
@click.option(
    "--observation",
    multiple=True,
    metavar="[LABEL=]TYPE[, KEY: VALUE, ...]",
    help="What single readings of RAW are, in one line as in survey.yaml: its type, and 'axis: [0, 1, 0]' or the like; "
    "of one file or column with its name before: 'A=TYPE, near: [0, 0, 500]'.",
)
@click.option(
    "--axes",
    type=click.Choice(["reference", "tool"]),
    default="reference",
    show_default=True,
    help="Of mx my mz: tool, of a nest in the spindle that reads along its own axes.",
)
@click.option(
    "--frame",
    type=click.Choice(["shared", "per-run", "per-file", "fixed"]),
    help="Rows that share a measuring frame. [default: as the points fit]",
)
@click.option("--leave-out", multiple=True, metavar="[RAW:]ROWS", help="Rows that count for nothing: 27,41-45.")
@click.option("--no-dwells", is_flag=True, help="Every row is a reading: no dwells are looked for.")
@click.option("--log-offset", type=float, default=0.0, help="Seconds to add to the times of a temperature log.")
@click.option("--centre", multiple=True, metavar="JOINT=..,...", help="Of a ballbar's circle: X=0,Y=0,Z=300 (mm, deg).")
@click.option("--plane", default="", help="Of a ballbar's circle, such as XY. [default: as the file says]")
@click.option("--radius", type=float, help="Of a ballbar's circle, mm. [default: as the file says]")
@click.option("--start", type=float, default=0.0, help="Degrees to add to the angles of a ballbar's file.")
def import_(
    raw: tuple[Path, ...],
    machine: str,
    commands: Path | None,
    match: Literal["auto", "name", "order", "nearest", "time"],
    out: ResultsFolder,
    columns: tuple[str, ...],
    units: tuple[str, ...],
    command_columns: tuple[str, ...],
    command_units: tuple[str, ...],
    form: str,
    command_format: str,
    sheet: str,
    dates: Literal["day-first", "month-first"] | None,
    joint: str,
    dialect: str,
    offsets: tuple[str, ...],
    after: tuple[str, ...],
    observation: tuple[str, ...],
    axes: Literal["reference", "tool"],
    frame: Literal["shared", "per-run", "per-file", "fixed"] | None,
    leave_out: tuple[str, ...],
    no_dwells: bool,
    log_offset: float,
    centre: tuple[str, ...],
    plane: str,
    radius: float | None,
    start: float,
    seed: int,
) -> None:
    """Take in RAW files as instruments wrote them, join them with their commands, and prove the join.

    The folder is a survey: `errormodel fit MACHINE FOLDER`. Raw files are kept byte for byte; survey.yaml says how they
    are read, and a correction is a line there.
    """
    from identification import api

    result = api.import_survey(
        raw, read_model(machine), commands=commands, match=match, columns=columns,
        units=_pairs(units, "--units"), command_columns=command_columns,
        command_units=_pairs(command_units, "--command-units"), format=form, command_format=command_format,
        sheet=sheet, dates=dates or "", joint=joint, offsets=offsets, at=after, dialect=dialect,
        observation=observation, axes=axes, frame=frame or "", leave_out=leave_out, dwells=not no_dwells,
        log_offset=log_offset, centre=_positions(centre), plane=plane, radius=radius, start=start, seed=seed,
        progress=working,
    )  # fmt: skip
    show_notes(result.notes)
    result.save(out)
    show_notes(out.notes)
    say(result.summary())
    say(f"\nSurvey: {out.path}; next: errormodel check {machine} {out.path}")


def _pairs(texts: tuple[str, ...], option: str) -> dict[str, str]:
    out: dict[str, str] = {}
    for part in (p.strip() for text in texts for p in text.split(",") if p.strip()):
        name, equal, unit = (p.strip() for p in part.partition("="))
        if not equal or not name or not unit or name in out:
            raise InputError(option, f"'{part}'", "Write each once, such as mx=m or length=inch")
        out[name] = unit
    return out


def _positions(texts: tuple[str, ...]) -> dict[str, float] | None:
    """Positions of joints, such as ``X=0,Y=0,Z=300``; None where none are given."""
    if not texts:
        return None
    out = {}
    for name, text in _pairs(texts, "--centre").items():
        try:
            out[name] = float(text)
        except ValueError as error:
            raise InputError("--centre", f"'{name}={text}'", "Write numbers, such as X=0,Y=0,Z=300") from error
    return out


@command
@click.argument("machine")
@click.argument("survey", type=ANY)
def check(machine: str, survey: Path) -> None:
    """Say all that can be said of a SURVEY before a fit: what it holds, mistakes in it, what its poses determine."""
    from identification import api

    result = api.check(read_model(machine), survey, progress=working)
    show_notes(result.notes)
    say(result.summary())


@command
@click.argument("machine")
@click.option("--joint", default="", help="For error motions of that joint. [default: for measured points]")
@click.option("--out", type=OUT_FILE, help="CSV to write. [default: printed]")
def template(machine: str, joint: str, out: OutputFile | None) -> None:
    """Write a table to fill in for a survey of MACHINE: its columns with units, and one example."""
    from identification import api

    text = api.template(read_model(machine), joint=joint)
    if out is None:
        say(text.rstrip())
        return
    out.write_text(text)
    say(f"written to {out}; filled in: errormodel import {out} --machine {machine} --out survey")
