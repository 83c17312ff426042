"""The machines that come with the tool."""

from __future__ import annotations

from pathlib import Path

import errormodel


def machine_names() -> list[str]:
    """Names of the machines that come with the tool.

    Returns
    -------
    list of str, in alphabetical order; `read_machine` takes them.
    """
    return list(library())


def library() -> dict[str, Path]:
    """Files of the machines that come with the tool.

    Returns
    -------
    dict of Path by name, in alphabetical order.
    """
    folder = Path(errormodel.__file__).parent.parent / "machines"
    return {file.stem: file for file in sorted(folder.glob("*.yaml"))}
