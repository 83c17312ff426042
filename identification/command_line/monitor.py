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
    from errormodel.files import locked
    from errormodel.survey import read_survey
    from identification.monitoring.history import SCHEMA
    from identification.monitoring.run import monitored
    from identification.monitoring.text import monitor_lines
    from identification.observation.frames import rotation_notes
    from identification.report.monitor import monitor_page
    from identification.results import store
    from identification.results.output_file import OutputFile

    if not 0 < rate < 0.5:
        raise InputError("--rate", f"{rate:g}", "Write a share of cycles between 0 and 0.5, such as 0.01")
    figures = OutputFile(folder / "monitor.json", mark=f'"schema": "{SCHEMA}"'.encode())
    shown = OutputFile(folder / "monitor.html", mark=b'<p class="kind">Monitor: the machine beside its')
    figures.check()
    shown.check()
    stored = store.load(folder)
    with working("Reading"):
        data = read_survey(survey, stored.chain.machine)
    show_notes((*data.notes, *rotation_notes(stored.frames)))
    # a fit that exchanges the folder waits until the history is closed
    with working("Fitting"), locked(folder.resolve().parent), monitored(folder, stored, data, rate, accept) as result:
        figures.write_text(store.dumps(result.as_json()))
        shown.write_text(monitor_page(result))
    for line in monitor_lines(result):
        say(line)
    say(f"\nReport: {folder / 'monitor.html'}")
    if result.record.status == "alarm" and not result.record.accepted:
        sys.exit(ALARM)
