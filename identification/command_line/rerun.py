"""The command that makes results anew and says whether they come out the same."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import click

from errormodel import __version__
from errormodel.exceptions import ErrorModelError, InputError
from identification.command_line.console import ANY, FOLDER, app, command, say


@command
@click.argument("folder", type=FOLDER)
@click.option("--inputs", type=ANY, help="Folder with the inputs, or above them. [default: here, and beside FOLDER]")
def rerun(folder: Path, inputs: Path | None) -> None:
    """Make the results in FOLDER anew, in a temporary folder, and say whether they differ.

    The inputs are found by their names and digests. Ends with 1 where results differ.
    """
    from identification.results import manifest
    from identification.results.rerun import differences

    made = manifest.read(folder)
    if made is None:
        raise InputError(str(folder), f"it holds no {manifest.NAME}", "Give a folder that `errormodel` wrote")
    manifest.check_complete(folder, made)
    known = app.commands.get(made.command)
    if made.arguments is None or known is None:
        found = f"its {manifest.NAME} does not say how to make it anew (errormodel {made.version} wrote it)"
        raise InputError(str(folder), found, "Run its command again with this version")
    places = [Path.cwd(), folder.resolve().parent] if inputs is None else [inputs]
    words = [made.command, *_words(known, made, places), "--quiet"]
    with tempfile.TemporaryDirectory() as space:
        again = Path(space) / "results"
        app.main([*words, "--out", str(again)], prog_name="errormodel", standalone_mode=False)
        new = manifest.read(again)
        if new is None:
            raise ErrorModelError(f"`errormodel {made.command}` wrote no results this time")
        apart = list(differences(folder, again, made, new))
    if apart:
        by = f" (made by errormodel {made.version}; this is {__version__})" if made.version != __version__ else ""
        raise ErrorModelError(f"{folder}: made anew, it differs{by}: {'; '.join(apart)}")
    say(f"{folder}: made anew by `errormodel {made.command}`, all {len(made.files)} files are the same, byte for byte")


def _words(known: click.Command, made: Any, places: list[Path]) -> list[str]:
    """Arguments and options of the command as they would be typed."""
    from errormodel import library
    from identification.results.rerun import found_input

    out = list[str]()
    for param in known.params:
        if isinstance(param, click.Argument):
            value = made.arguments.get(param.name)
            if value is not None:
                known_machine = param.name == "machine" and value in library()
                out.append(value if known_machine else str(found_input(value, made, places)))
            continue
        value = made.options.get(param.name)
        if value is None or value is False or not isinstance(param, click.Option):
            continue
        if isinstance(param.type, click.Path):
            value = str(found_input(value, made, places))
        if param.is_flag:
            out.append(param.opts[0])
        elif param.multiple:
            out += [word for one in value for word in (param.opts[0], str(one))]
        else:
            out += [param.opts[0], *map(str, value if isinstance(value, list) else [value])]
    return out
