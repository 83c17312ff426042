"""The command that looks whether results are as they were written."""

from __future__ import annotations

from pathlib import Path

import click

from errormodel.exceptions import InputError
from identification.command_line.console import FOLDER, command, say, show_notes


@command
@click.argument("folder", type=FOLDER)
def verify(folder: Path) -> None:
    """Check that all files in a FOLDER of results are those that errormodel wrote there, other results in it too."""
    from identification.results import manifest
    from identification.results.folder_contents import unlisted

    made = manifest.read(folder)
    if made is None:
        found = f"it holds no {manifest.NAME}, which every folder of results has"
        raise InputError(str(folder), found, "Give a folder of results of this version or a later one")
    manifest.check_complete(folder, made)
    say(f"{folder}: all {len(made.files)} files are as `errormodel {made.command}` wrote them")
    if foreign := [*unlisted(folder, made)]:
        show_notes((f"not listed in {manifest.NAME}, and so not looked at: {', '.join(foreign)}",))
    others = [*manifest.inside(folder, made)]
    for place, other in others:
        manifest.check_complete(place, other)
    if others:
        files = sum(len(other.files) for _, other in others)
        say(f"so are the {files} files of {len(others)} other result{'s' * (len(others) > 1)} in it")
