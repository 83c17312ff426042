"""Output file of a command, which never replaces an input nor a file that errormodel did not write.

``.errormodel.sha256`` in the same folder lists the files that errormodel wrote, a line "digest  name" each, as written
by ``sha256sum``. Files are identified by content: one that was changed since is refused.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from errormodel.exceptions import InputError
from errormodel.files import (
    clear_parts,
    impossible_on_windows,
    locked,
    plain_mode,
    replacing,
    sha256,
    unwritable,
    write_csv,
    write_text_atomic,
)
from identification.results import manifest

if TYPE_CHECKING:
    import pandas as pd

WINDOWS = sys.platform == "win32"
RECORD_NAME = ".errormodel.sha256"  # list of written files with digests, in the same folder
CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]")  # characters that break the lines of that list, and of any other
RECORD_LINE = re.compile(r"([0-9a-f]{64})  (.+)")  # digest and name, as written by sha256sum
CURE = "Give another name, or move that file away"


class OutputFile:
    """One file to be written.

    Parameters
    ----------
    path : Path
    mark : bytes
        Bytes that identify a file of this kind: it may be replaced without being recorded, since earlier versions kept
        no record.
    """

    def __init__(self, path: Path, mark: bytes = b"") -> None:
        self.path, self.mark = path, mark

    def __str__(self) -> str:
        return str(self.path)

    def covers(self, path: Path) -> bool:
        """Whether `path` is this file."""
        return same(self.path, path)

    def joins(self, folder: Path, suffixes: Collection[str]) -> bool:
        """Whether this file would be read together with the files of `folder`."""
        return self.path.suffix.lower() in suffixes and same(self.path.parent, folder)

    def check(self) -> None:
        """Check before any work whether the file may be written.

        Raises
        ------
        InputError
            The path is no plain file, or a file that errormodel did not write, or one changed since.
        """
        try:
            if plain_mode(self.path) is None or not self.path.stat().st_size:
                return
            written = recorded(self.path.parent).get(self.path.name)
            if written is None and not (self.mark and self.mark in self.path.read_bytes()):
                if manifest.lists(self.path):
                    found = "it is one of the results in that folder, which are replaced as a whole only"
                    raise InputError(str(self.path), found, "Give another name")
                raise InputError(str(self.path), "it is there, and errormodel has no record of writing it", CURE)
            if written is not None and sha256(self.path) not in written:
                raise InputError(str(self.path), "it was changed since errormodel wrote it", CURE)
        except OSError as error:
            raise unwritable(self.path, error) from error

    @contextmanager
    def replaced(self) -> Iterator[Path]:
        """Path to write to; it replaces the file when the block ends without an error.

        Raises
        ------
        InputError
            See `check`; or the place cannot be written to.
        """
        self.check()
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unwritable(self.path, error) from error
        with locked(self.path.parent), replacing(self.path) as part:
            for path in (self.path, self.path.parent / RECORD_NAME):
                clear_parts(path)
            yield part
            self.check()
            with suppress(InputError):  # in a foreign folder: the file is then not replaced again
                record(self.path, sha256(part))

    def write_text(self, text: str) -> None:
        """Write UTF-8 text (see `replaced`)."""
        with self.replaced() as part:
            write_text_atomic(text, part)

    def write_json(self, data: Any) -> None:
        """Write JSON with NaN as null (see `replaced`)."""
        from identification.results.json_text import dumps

        self.write_text(dumps(data))

    def write_csv(self, frame: pd.DataFrame) -> None:
        """Write a table (see `replaced`)."""
        with self.replaced() as part:
            write_csv(frame, part)


def check_name(path: Path) -> None:
    """Check that this system can have a file or folder of this name, in one line; InputError where it cannot."""
    new = (path, *(folder for folder in path.parents if not folder.exists()))
    if found := CONTROL.search("".join(p.name for p in new)):
        raise InputError(ascii(str(path)), f"a name with the control character {found[0]!a}", "Give another name")
    reasons = map(impossible_on_windows, path.relative_to(path.anchor).parts) if WINDOWS else ()
    if reason := next(filter(None, reasons), None):
        raise InputError(str(path), reason, "Give another name")


def doubts_on_name(path: Path) -> tuple[str, ...]:
    """A note where Windows cannot have a file or folder of this name, though this system can."""
    reason = impossible_on_windows(path.name)
    return (f"{path}: {reason}: it cannot be copied to a computer with Windows",) if reason else ()


def same(one: Path, other: Path) -> bool:
    """Whether two paths lead to the same file or folder, links included."""
    try:
        return one.samefile(other)
    except (OSError, ValueError):  # one is missing or inaccessible
        return False


def recorded(folder: Path) -> dict[str, set[str]]:
    """Digests of the files in `folder` that errormodel wrote, by their names."""
    known: dict[str, set[str]] = {}
    try:
        text = (folder / RECORD_NAME).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return known
    for found in filter(None, map(RECORD_LINE.fullmatch, text.splitlines())):
        known.setdefault(found[2], set()).add(found[1])
    return known


def record(path: Path, digest: str) -> None:
    """Add a file to the record of its folder; entries of missing files are dropped.

    The digest of the present file stays, since a run that is killed now leaves that file.
    """
    known = {name: digests for name, digests in recorded(path.parent).items() if (path.parent / name).exists()}
    here = {sha256(path)} if path.exists() else set()
    known[path.name] = (known.get(path.name, set()) & here) | {digest}
    lines = [f"{d}  {name}\n" for name in sorted(known) for d in sorted(known[name])]
    write_text_atomic("".join(lines), path.parent / RECORD_NAME)
