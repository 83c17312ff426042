"""A single file that a command writes: never over what it reads, nor over what errormodel did not write.

Which files errormodel wrote stands beside them in ``.errormodel.sha256``, a line "digest  name" each, as ``sha256sum``
writes it. A file is known by its content: one that was changed since is somebody's work, and is refused.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from errormodel.exceptions import InputError
from errormodel.files import locked, plain_mode, replacing, sha256, unwritable, write_csv, write_text_atomic

if TYPE_CHECKING:
    import pandas as pd

RECORD = ".errormodel.sha256"
LINE = re.compile(r"([0-9a-f]{64})  (.+)")
CURE = "Give another name, or move that file away"


class OutputFile:
    """One file to write.

    Parameters
    ----------
    path : Path
    mark : bytes
        What a file of this kind holds, and nobody else's: such a file may be replaced though it stands in no record, as
        earlier versions kept none.
    """

    def __init__(self, path: Path, mark: bytes = b"") -> None:
        self.path, self.mark = path, mark

    def __str__(self) -> str:
        return str(self.path)

    def covers(self, path: Path) -> bool:
        """Whether `path` is this file."""
        return same(self.path, path)

    def joins(self, folder: Path, suffixes: Collection[str]) -> bool:
        """Whether this file would be one more of those that are read together."""
        return self.path.suffix.lower() in suffixes and same(self.path.parent, folder)

    def check(self) -> None:
        """Before any work: whether it may be written.

        Raises
        ------
        InputError
            There is something else than a plain file, or a file that errormodel did not write, or one changed since.
        """
        try:
            if plain_mode(self.path) is None or not self.path.stat().st_size:
                return
            written = recorded(self.path.parent).get(self.path.name)
            if written is None and not (self.mark and self.mark in self.path.read_bytes()):
                raise InputError(str(self.path), "it is there, and errormodel has no record of writing it", CURE)
            if written is not None and sha256(self.path) not in written:
                raise InputError(str(self.path), "it was changed since errormodel wrote it", CURE)
        except OSError as error:
            raise unwritable(self.path, error) from error

    @contextmanager
    def replaced(self) -> Iterator[Path]:
        """A path to write to; what is there takes the place of the file when the block ends without an error.

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
            yield part
            self.check()
            with suppress(InputError):  # in a folder of somebody else's: the file is then not replaced again
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


def same(one: Path, other: Path) -> bool:
    """Whether two paths lead to one file or folder, through links too and however they are spelled."""
    try:
        return one.samefile(other)
    except (OSError, ValueError):  # one is not there, or cannot be
        return False


def recorded(folder: Path) -> dict[str, set[str]]:
    """Digests of the files in `folder` that errormodel wrote, by their names."""
    known: dict[str, set[str]] = {}
    try:
        text = (folder / RECORD).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return known
    for found in filter(None, map(LINE.fullmatch, text.splitlines())):
        known.setdefault(found[2], set()).add(found[1])
    return known


def record(path: Path, digest: str) -> None:
    """Add what is about to be written to the record of its folder; of files that are gone nothing stays.

    The digest of the file that is still there stays, as a run that is killed now leaves it.
    """
    known = {name: digests for name, digests in recorded(path.parent).items() if (path.parent / name).exists()}
    here = {sha256(path)} if path.exists() else set()
    known[path.name] = (known.get(path.name, set()) & here) | {digest}
    lines = [f"{d}  {name}\n" for name in sorted(known) for d in sorted(known[name])]
    write_text_atomic("".join(lines), path.parent / RECORD)
