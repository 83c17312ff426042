"""The command that ends at a machine: tables for its controller."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from errormodel.exceptions import InputError
from identification.command_line.console import FILE, FOLDER, OUT_TABLES, command, say, show_notes, working

if TYPE_CHECKING:
    from identification.results.results_folder import ResultsFolder


@command
@click.argument("folder", type=FOLDER, required=False)
@click.option(
    "--controller", "name", metavar="NAME", required=True, help="Name of the controller; 'list' names them all."
)
@click.option("--out", type=OUT_TABLES, help="Folder for the controller's files, checklist.txt and compensation.json.")
@click.option("--points", type=click.IntRange(2), help="Points an axis. [default: as many as the errors need]")
@click.option("--resolution", type=float, help="Least increment of the controller in mm. [default: the format's]")
@click.option("--program", type=FILE, help="The programme (or CSV of commands) to rewrite, where NAME rewrites.")
@click.option(
    "--dialect", help="Of --program: auto, iso, fanuc, fanuc-calculator, fanuc-increments or printer. [default: auto]"
)
@click.option("--offset", "offsets", multiple=True, help="Of --program: X.. or G54=X..,Y.. or H1=Z.. (mm, deg).")
@click.option("--at", "after", multiple=True, help="Where axes stand: start=X0,Y0 or G28=Z0 or M6=stay (mm, deg).")
@click.option(
    "--probe", type=float, nargs=2, metavar="X Y", help="Probe from the nozzle, mm, where NAME corrects its readings."
)
@click.option(
    "--tool", type=float, nargs=3, metavar="X Y Z", help="Tip of the tool the tables are for. [default: machine.yaml's]"
)
@click.option(
    "--axes", metavar="JOINT=N,...", help="Axis numbers (letters) on the controller: X=1,Y=2,Z=3 or bridge=Y2,arm=X1."
)
@click.option(
    "--invert", is_flag=True, help="Write the other sign: where the check in sign_test showed that it is wanted."
)
@click.option("--allow-large", is_flag=True, help="Write corrections beyond 1 mm, or 10 mm in a metre, too.")
@click.option(
    "--kinematics", is_flag=True, help="Constant errors of rotary axes into kinematics.txt, tables for what remains."
)
@click.option("--keep-alignment", is_flag=True, help="Tables for fixtures, bed and probes that are not aligned again.")
@click.option("--max-tables", type=click.IntRange(1), help="Use this many tables at most, those that gain most.")
@click.option("--load", type=float, metavar="KG", help="Load the tables are for. [default: the survey's median]")
@click.option(
    "--x-counts",
    metavar="WORD",
    help="How the control counts X, where it is asked: radii or diameters.",
)
def compensate(
    folder: Path | None,
    name: str,
    out: ResultsFolder | None,
    points: int | None,
    resolution: float | None,
    program: Path | None,
    dialect: str | None,
    offsets: tuple[str, ...],
    after: tuple[str, ...],
    probe: tuple[float, float] | None,
    tool: tuple[float, float, float] | None,
    axes: str | None,
    invert: bool,
    allow_large: bool,
    kinematics: bool,
    keep_alignment: bool,
    max_tables: int | None,
    load: float | None,
    x_counts: str | None,
    seed: int,
) -> None:
    """Write a controller's tables from the FOLDER of a fit, and show by emulation what they leave over."""
    from identification import api

    if name == "list":
        for known, what in api.controllers().items():
            say(f"{known:16} {what}")
        return
    if folder is None or out is None:
        missing = "FOLDER" if folder is None else "--out"
        raise InputError(
            "compensate", f"{missing} is missing", "Write compensate FOLDER --controller NAME --out FOLDER2"
        )
    if resolution is not None and not 0 < resolution < 1:
        raise InputError("--resolution", f"{resolution:g} mm", "Write the least increment in mm, such as 0.001")
    result = api.compensate(
        folder, name, points=points, resolution=resolution, program=program, dialect=dialect, offsets=offsets, at=after,
        probe=probe, tool=tool, axes=axes, invert=invert, allow_large=allow_large, kinematics=kinematics,
        keep_alignment=keep_alignment, max_tables=max_tables, load=load, x_counts=x_counts, seed=seed,
        progress=working,
    )  # fmt: skip
    show_notes(result.notes)
    result.write(out)
    show_notes(out.notes)
    say(result.summary(out.path))
