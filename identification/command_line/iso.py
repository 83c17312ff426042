"""The command for tests by standards: figures, charts, decisions, a certificate."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from errormodel.exceptions import InputError
from identification.command_line.console import ANY, OUT_EVALUATION, OUT_FILE, command, say, show_notes, working

if TYPE_CHECKING:
    from identification.results.output_file import OutputFile
    from identification.results.results_folder import ResultsFolder

LIST = "list"


@command
@click.argument("standard")
@click.argument("source", metavar="[DIR | MACHINE SURVEY]", required=False)
@click.argument("survey", metavar="", type=ANY, required=False)
@click.option(
    "--out", type=OUT_EVALUATION, help="Folder for certificate.html, evaluation.json, figures.csv and charts."
)
@click.option("--json", "json_file", type=OUT_FILE, help="Write the figures and decisions as JSON.")
@click.option(
    "--tolerance", "tolerances", multiple=True, metavar="NAME=LIMIT", help='A limit, such as "X.A=8 um"; repeatable.'
)
@click.option(
    "--decision", type=click.Choice(["guard-band", "simple"]), help="Rule. [default: the survey's, else guard-band]"
)
def iso(
    standard: str,
    source: str | None,
    survey: Path | None,
    out: ResultsFolder | None,
    json_file: OutputFile | None,
    tolerances: tuple[str, ...],
    decision: Literal["guard-band", "simple"] | None,
) -> None:
    """Evaluate a survey, or the fitted model in DIR, by a STANDARD: figures, charts, decisions, a certificate.

    STANDARD is a number such as 230-2, several with commas between, 'all' that the source allows, or 'list', which
    names them. Tolerances and the head of the certificate stand under test: in survey.yaml.
    """
    from identification import api

    if standard == LIST:
        for name, what in api.standards().items():
            say(f"{name:12} {what}")
        return
    if source is None:
        raise InputError(
            "iso", "DIR, or MACHINE and SURVEY, is missing", "Write iso STANDARD DIR or iso STANDARD MACHINE SURVEY"
        )
    given = dict(_pair(text) for text in tolerances)
    machine = source
    if survey is not None:
        from identification.command_line.console import read_model

        result = api.iso(
            standard, read_model(machine), survey, tolerance=given, decision=decision, progress=working
        )  # fmt: skip
    else:
        result = api.iso(standard, source, tolerance=given, decision=decision, progress=working)
    show_notes(result.notes)
    if json_file is not None:
        json_file.write_json(result.as_json())
    if out is not None:
        result.save(out, progress=working)
        show_notes(out.notes)
    say(result.summary())
    if out is not None:
        if result.missing:
            say(f"missing under test: in survey.yaml: {', '.join(result.missing)}")
        say(f"\nCertificate: {out.path / 'certificate.html'}")


def _pair(text: str) -> tuple[str, str]:
    name, sign, limit = text.partition("=")
    if not (name.strip() and sign and limit.strip()):
        raise InputError("--tolerance", f"'{text}'", 'Write a name and a limit with its unit, such as "X.A=8 um"')
    return name.strip(), limit.strip()
