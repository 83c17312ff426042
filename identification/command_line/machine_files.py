"""Commands for descriptions of machines in the formats of others: machine, export."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from errormodel.exceptions import InputError
from identification.command_line.console import FILE, OUT_FILE, command, say, show_notes, working

if TYPE_CHECKING:
    from identification.results.output_file import OutputFile

LIST = "list"


@command
@click.argument("file", type=FILE)
@click.option("--out", type=OUT_FILE, help="machine.yaml to write. [default: printed]")
@click.option("--format", "form", default="", help="Format of FILE. [default: recognised]")
@click.option("--base", default="", help="First link of the chain, of a tree. [default: its root]")
@click.option("--tip", default="", help="Last link of the chain, of a tree. [default: its only end]")
@click.option(
    "--tool",
    type=float,
    nargs=3,
    metavar="X Y Z",
    default=(0.0, 0.0, 0.0),
    help="Functional point in the last frame, mm.",
)
@click.option("--joints", default="", metavar="NAME,...", help="Names of the joints. [default: those of FILE]")
@click.option("--name", default="", help="Name of the machine. [default: that of FILE]")
def machine(
    file: Path,
    out: OutputFile | None,
    form: str,
    base: str,
    tip: str,
    tool: tuple[float, float, float],
    joints: str,
    name: str,
) -> None:
    """Make a machine.yaml of a robot's description: a URDF, a Denavit-Hartenberg table, a calibration.yaml.

    `errormodel export list` names the formats.
    """
    from identification import api

    result = api.import_machine(file, format=form, base=base, tip=tip, tool=tool, joints=joints, name=name)
    show_notes(result.notes)
    if out is None:
        say(result.text.rstrip())
        return
    result.write(out)
    say(result.summary())
    say(f"\nwritten to {out}; next: errormodel describe {out}")


@command
@click.argument("source", metavar="[DIR | MACHINE]")
@click.option("--format", "form", default="", help="Format to write; 'export list' names them all.")
@click.option("--out", type=OUT_FILE, help="File to write; of tables .csv or .yaml.")
@click.option("--hash", "identity", default="", help="The robot's own identifier, where the format has one.")
@click.option("--into", type=FILE, help="The robot's own URDF: OUT is this file with other origins of its joints.")
@click.option("--base", default="", help="First link of the chain in --into. [default: its root]")
@click.option("--tip", default="", help="Last link of the chain in --into. [default: its only end]")
@click.option("--load", type=float, metavar="KG", help="Load the constants are for. [default: the survey's median]")
def export(
    source: str,
    form: str,
    out: OutputFile | None,
    identity: str,
    into: Path | None,
    base: str,
    tip: str,
    load: float | None,
    seed: int,
) -> None:
    """Describe the calibrated machine in the folder DIR of a fit, or the nominal MACHINE, in a format of others.

    The file is read back and compared with the machine. What it cannot hold is said, with its size.
    """
    from identification import api

    if source == LIST and not form:
        for known, what in api.machine_formats().items():
            say(f"{known:16} {what}")
        return
    if into is None and (base or tip):
        raise InputError(
            "--base" if base else "--tip", "no --into, whose links it names", "Leave it out, or give --into"
        )
    if not form or out is None:
        missing = "--format" if not form else "--out"
        raise InputError("export", f"{missing} is missing", "Write export DIR --format NAME --out FILE")
    result = api.export(
        source, form, suffix=out.path.suffix.lower(), identity=identity, into=into, base=base, tip=tip, load=load,
        seed=seed, progress=working,
    )  # fmt: skip
    show_notes(result.notes)
    result.write(out)
    say(result.summary())
    say(f"\nwritten to {out}")
