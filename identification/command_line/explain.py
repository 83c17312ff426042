"""The command that says why a diagnosis found what it found."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from errormodel.exceptions import InputError
from identification.command_line.console import DRAWINGS, FOLDER, OUT_FILE, command, say, show_notes

if TYPE_CHECKING:
    from identification.results.output_file import OutputFile


@command
@click.argument("folder", type=FOLDER)
@click.argument("effect", required=False)
@click.option("--out", type=OUT_FILE, help="Draw the candidates by stage, and where they dropped out (.svg or .png).")
def explain(folder: Path, effect: str | None, out: OutputFile | None) -> None:
    """Say why the diagnosis in FOLDER found what it found, and where others dropped out.

    EFFECT is an effect, or one at a place (backlash@X); without it, all stages are shown in their order.
    """
    from identification import api

    if out is not None and out.path.suffix.lower() not in DRAWINGS:
        found = f"a drawing of type '{out.path.suffix}'"
        raise InputError(f"--out {out}", found, f"Write one of {', '.join(DRAWINGS)}")
    result = api.explain(folder, effect)
    show_notes(result.notes)
    if out is not None:
        with out.replaced() as part:
            result.draw(part)
    say(result.summary())
    if out is not None:
        say(f"\nFigure: {out}")
