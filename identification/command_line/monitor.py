"""The command that watches a machine from cycle to cycle."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from errormodel.exceptions import InputError
from identification.command_line.console import ANY, FOLDER, command, say, show_notes, working

ALARM = 1  # exit code: a script can stop on it


@command
@click.argument("folder", type=FOLDER)
@click.argument("survey", type=ANY)
@click.option("--accept", is_flag=True, help="Take this cycle into the normal range, alarm or not.")
@click.option("--rate", type=float, default=0.01, show_default=True, help="Share of cycles with a false alarm.")
def monitor(folder: Path, survey: Path, accept: bool, rate: float) -> None:
    """Fit one more cycle (SURVEY) with the model in the FOLDER of a fit, and say what left its normal range.

    The range is learned from the cycles before, which FOLDER/monitor.sqlite keeps; writes monitor.json and
    monitor.html there. The exit code is 1 where the cycle is in alarm and is not accepted, else 0.
    """
    from errormodel import read_survey
    from identification import api

    if not 0 < rate < 0.5:
        raise InputError("--rate", f"{rate:g}", "Write a share of cycles between 0 and 0.5, such as 0.01")
    saved = api.load(folder)
    with working("Reading"):
        data = read_survey(survey, saved.machine)
    result = api.monitor(saved, data, accept=accept, rate=rate, progress=working)
    show_notes((*data.notes, *saved.notes))
    say(result.summary())
    say(f"\nReport: {result.page}")
    if result.status == "alarm" and not result.accepted:
        sys.exit(ALARM)
