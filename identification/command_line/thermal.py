"""The command for error motions that drift with temperature."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from identification.command_line.console import ANY, OUT_FOLDER, command, read_model, say, show_notes, working

if TYPE_CHECKING:
    from identification.results.results_folder import ResultsFolder


@command
@click.argument("machine")
@click.argument("survey", type=ANY)
@click.option("--out", type=OUT_FOLDER, required=True, help="Folder for thermal.json, machine.yaml and the fit.")
def thermal(machine: str, survey: Path, out: ResultsFolder) -> None:
    """Model how error motions drift with temperatures, and judge that on another thermal cycle.

    SURVEY holds error motions at a few positions of a joint, read again and again over a warm-up (columns joint, dx ...
    ec, time, T_<sensor>); files of another cycle have the role test.
    """
    from errormodel import read_survey
    from identification import api

    model = read_model(machine)
    with working("Reading"):
        data = read_survey(survey, model)
    show_notes(data.notes)
    result = api.thermal(model, data, progress=working)
    show_notes(result.notes)
    with working("Writing"):
        api.save(result, out)
    show_notes(out.notes)
    say(result.summary())
    say(f"\nModel: {out.path / 'machine.yaml'}; for errormodel fit, predict and compensate")
