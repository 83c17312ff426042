"""The command for many surveys of many machines."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Literal

import click

from identification.command_line.console import (
    OUT_FLEET,
    command,
    counting,
    crew_options,
    say,
    show_notes,
    working,
)

if TYPE_CHECKING:
    from identification.results.results_folder import ResultsFolder

FAILED = 1  # exit code: all results are written, and not all surveys are among them


@command
@click.argument("listing", metavar="LIST")
@click.option(
    "--command", "name", type=click.Choice(["fit", "diagnose", "monitor", "iso"]), default="fit", show_default=True,
    help="What is done to each survey.",
)  # fmt: skip
@click.option("--out", type=OUT_FLEET, required=True, help="Folder for the tables, fleet.html and the parts.")
@click.option("--rate", type=float, default=0.01, show_default=True, help="Share of false ones among machines found.")
@click.option("--standard", default="all", show_default=True, help="With iso: which standards.")
@click.option("--reports", is_flag=True, help="Write the report of each part, too.")
@crew_options
def fleet(
    listing: str,
    name: Literal["fit", "diagnose", "monitor", "iso"],
    out: ResultsFolder,
    rate: float,
    standard: str,
    reports: bool,
    engine: Literal["local", "dask"],
    scheduler: str | None,
    workers: int | None,
) -> None:
    """Run a command on every survey of a fleet; say what is normal of a type, which machine is out, what is common.

    LIST is a CSV or Parquet file with the columns machine and survey (paths relative to it, or addresses such as
    s3://...), and if wanted id, type, date and labels. What an earlier run finished in the folder is taken up. Ends
    with 1 where surveys failed: they are named, and all others are done.
    """
    from identification import api

    result = api.fleet(
        listing, out, command=name, engine=engine, scheduler=scheduler, workers=workers, rate=rate, standard=standard,
        reports=reports, announce=say, warn=lambda text: show_notes((text,)), progress=working, steps=counting,
    )  # fmt: skip
    show_notes(out.notes)
    if result.taken:
        say(f"{result.taken} parts were finished before, and taken up")
    say(result.summary())
    say(f"\nPage: {out.path / 'fleet.html'}")
    if not result.complete:
        sys.exit(FAILED)
