"""What the command under way reads, so that it never writes over any of it and can say what a result was made from.

Every reader passes the paths that it opens through :func:`noted`. Outside of a command that does nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from errormodel.exceptions import InputError
from errormodel.files import sha256


class Output(Protocol):
    """A file or a folder that a command is to write."""

    path: Path

    def covers(self, path: Path) -> bool:
        """Whether writing here would change `path`, however either is spelled; not where there is no such file."""
        ...

    def joins(self, folder: Path, suffixes: Collection[str]) -> bool:
        """Whether what is written would be one more of the files of `folder` that are read together."""
        ...


@dataclass
class Run:
    """A command: its name, its options as they change the result, what it writes, and digests of what it has read."""

    command: str
    options: dict[str, Any]
    outputs: Sequence[Output]
    inputs: dict[Path, str] = field(default_factory=dict)

    def refuse(self, path: Path) -> None:
        """InputError if an output would write over `path`."""
        for output in self.outputs:
            if output.covers(path):
                raise overwrites(output, path)


_run: ContextVar[Run | None] = ContextVar("run", default=None)


def current() -> Run | None:
    """The command under way."""
    return _run.get()


@contextmanager
def running(run: Run | None) -> Iterator[None]:
    """Note what is read in the block as read by a command, or by none."""
    token = _run.set(run)
    try:
        yield
    finally:
        _run.reset(token)


def noted(path: Path) -> Path:
    """The path of a file that is now read.

    Raises
    ------
    InputError
        The command would write over it.
    """
    run = _run.get()
    if run is not None:
        run.refuse(path)
        with suppress(OSError):  # reading it says why
            place = path.resolve()
            if place.is_file() and place not in run.inputs:
                run.inputs[place] = sha256(place)
    return path


def noted_folder(folder: Path, suffixes: Collection[str]) -> Path:
    """The path of a folder whose files with these suffixes are read together.

    Raises
    ------
    InputError
        The command would put one more there.
    """
    run = _run.get()
    for output in run.outputs if run is not None else ():
        if output.joins(folder, suffixes):
            raise overwrites(output, folder)
    return folder


def overwrites(output: Output, path: Path) -> InputError:
    """What to say where a command would write over what it reads."""
    found = "this command reads it" if path == output.path else f"writing there would change {path}, which is read"
    return InputError(str(output.path), found, "Give another place for the results")
