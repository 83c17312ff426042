"""The command from point clouds to a joint's thermal error motions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from identification.command_line.console import FILE, FOLDER, OUT_FILE, command, say, show_notes, working

if TYPE_CHECKING:
    from identification.results.output_file import OutputFile


@command
@click.argument("cold", type=FOLDER)
@click.argument("warm", type=FOLDER, nargs=-1, required=True)
@click.option("--profiler", type=FILE, required=True, help="YAML: joint, positions, lever, mount or calibration.")
@click.option("--out", type=OUT_FILE, required=True, help="CSV to write: a survey of the joint's error motions.")
def register(cold: Path, warm: tuple[Path, ...], profiler: Path, out: OutputFile) -> None:
    """Register point clouds of artefacts: from a COLD and each WARM folder to six thermal error motions.

    Each folder has one cloud an artefact (csv, xyz, ply, pcd), x y z in mm in the sensor's frame. A time in the name of
    a WARM folder (t_030min, 90s, 1.5h) becomes the column time.
    """
    from identification import api

    result = api.register(cold, warm, profiler, progress=working)
    show_notes(result.notes)
    out.write_csv(result.table)
    say(result.summary())
    say(f"\n{len(result.table)} rows written to {out}")
