"""Record of the files that a command reads: it must not overwrite them, and results name them with their digests.

Every reader passes the paths that it opens through :func:`noted`, which does nothing outside of a command.
"""

from __future__ import annotations

import stat
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from errormodel.exceptions import InputError
from errormodel.files import sha256


class Output(Protocol):
    """A file or folder that a command will write."""

    path: Path

    def covers(self, path: Path) -> bool:
        """Whether writing here would change the existing file `path`, however either path is written."""
        ...

    def joins(self, folder: Path, suffixes: Collection[str]) -> bool:
        """Whether the output would become one more of the files of `folder` that are read together."""
        ...


@dataclass
class Run:
    """A command: name, arguments, options that change its result, outputs, and digests of the files it has read.

    Of files, arguments and options have the names.
    """

    command: str
    arguments: dict[str, Any] | None  # None: the command cannot be run again from them alone
    options: dict[str, Any]
    outputs: Sequence[Output]
    inputs: dict[Path, str] = field(default_factory=dict)

    def refuse(self, path: Path) -> None:
        """Raise InputError if an output would overwrite `path`."""
        for output in self.outputs:
            if output.covers(path):
                raise overwrites(output, path)


_run: ContextVar[Run | None] = ContextVar("run", default=None)


def current() -> Run | None:
    """The command in progress, or None."""
    return _run.get()


@contextmanager
def running(run: Run | None) -> Iterator[None]:
    """Attribute the files that are read in the block to a command, or to none."""
    token = _run.set(run)
    try:
        yield
    finally:
        _run.reset(token)


def is_unicode(text: str) -> bool:
    """Whether a text can be written as UTF-8: neither file names of other encodings nor halves of characters can."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def check_readable(path: Path) -> None:
    """Check that a path can be named in results, and leads to a file or folder if to anything.

    Reading a pipe may wait for ever, and a device may never end.

    Raises
    ------
    InputError
        It does not.
    """
    if not is_unicode(str(path)):
        shown = str(path).encode("utf-8", "backslashreplace").decode()
        raise InputError(shown, "a name that is not UTF-8, which results could not state", "Rename it")
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):  # opening the file gives the reason
        return
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        kind = "a pipe" if stat.S_ISFIFO(mode) else "a socket" if stat.S_ISSOCK(mode) else "a device"
        raise InputError(str(path), f"{kind}, which may never end", "Write what it gives to a file, and give that")


def noted(path: Path) -> Path:
    """Record the path of a file that is now read, and return it.

    Raises
    ------
    InputError
        The command would overwrite it, or it is no plain file (see `check_readable`).
    """
    check_readable(path)
    run = _run.get()
    if run is not None:
        run.refuse(path)
        with suppress(OSError):  # opening the file gives the reason
            place = path.resolve()
            if place.is_file() and place not in run.inputs:
                run.inputs[place] = sha256(place)
    return path


def noted_folder(folder: Path, suffixes: Collection[str]) -> Path:
    """Check a folder whose files with these suffixes are read together, and return its path.

    Raises
    ------
    InputError
        The command would write one more such file there.
    """
    run = _run.get()
    for output in run.outputs if run is not None else ():
        if output.joins(folder, suffixes):
            raise overwrites(output, folder)
    return folder


def overwrites(output: Output, path: Path) -> InputError:
    """Error for an output that would overwrite an input."""
    found = "this command reads it" if path == output.path else f"writing there would change {path}, which is read"
    return InputError(str(output.path), found, "Give another place for the results")
