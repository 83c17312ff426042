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
    from errormodel.files import write_text_atomic
    from errormodel.survey import read_survey
    from identification.plots import style
    from identification.plots.thermal_drift import draw_thermal_drift
    from identification.report import write_report
    from identification.results import store
    from identification.thermal.run import thermal as stage
    from identification.thermal.text import thermal_lines

    model = read_model(machine)
    with working("Reading"):
        data = read_survey(survey, model)
    show_notes(data.notes)
    result = stage(model, data, working)
    show_notes(result.recordings.notes)
    with working("Writing"), out.replaced() as part:
        store.write(result.fit, part)
        write_report(result.fit, part / "report.html", thermal=result)
        write_text_atomic(store.dumps(result.as_json()), part / "thermal.json")
        style.save(draw_thermal_drift(result), part / "thermal_drift.png")
    show_notes(out.notes)
    for line in thermal_lines(result, out.path):
        say(line)
