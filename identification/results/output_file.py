"""Output file of a command, which never replaces an input nor a file that errormodel did not write.

``.errormodel.sha256`` in the same folder lists the files that errormodel wrote, a line "digest  name" each, as written
by ``sha256sum``. Files are identified by content: one that was changed since is refused.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from errormodel.exceptions import InputError
from errormodel.files import (
    clear_parts,
    impossible_on_windows,
    locked,
    plain_mode,
    replacing_together,
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
        with replaced_together(self) as (part,):
            assert part is not None
            yield part

    def write_text(self, text: str) -> None:
        """Write UTF-8 text (see `replaced`)."""
        with self.replaced() as part:
            write_text_atomic(text, part)

    def write_json(self, data: Any) -> None:
        """Write JSON with NaN as null (see `replaced`)."""
        with self.replaced() as part:
            write_json(data, part)

    def write_csv(self, frame: pd.DataFrame) -> None:
        """Write a table (see `replaced`)."""
        with self.replaced() as part:
            write_csv(frame, part)


def write_json(data: Any, path: Path) -> None:
    """Write JSON with NaN as null."""
    from identification.results.json_text import dumps

    write_text_atomic(dumps(data), path)


@contextmanager
def replaced_together(*files: OutputFile | None) -> Iterator[tuple[Path | None, ...]]:
    """Paths to write to, None for None; they replace the files when the block ends without an error, all or none.

    Raises
    ------
    InputError
        See `OutputFile.check`; or a place cannot be written to.
    """
    written = [file for file in files if file is not None]
    for file in written:
        file.check()
        try:
            file.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unwritable(file.path, error) from error
    folders = sorted({file.path.parent.resolve() for file in written})
    with ExitStack() as stack:
        for folder in folders:
            stack.enter_context(locked(folder))
        parts = stack.enter_context(replacing_together([file.path for file in written]))
        for file in written:
            for path in (file.path, file.path.parent / RECORD_NAME):
                clear_parts(path)
        of = dict(zip(map(id, written), parts, strict=True))
        yield tuple(None if file is None else of[id(file)] for file in files)
        for file in written:
            file.check()
        for folder in folders:
            own = {f.path.name: sha256(p) for f, p in zip(written, parts, strict=True) if same(f.path.parent, folder)}
            with suppress(InputError):  # in a foreign folder: the files are then not replaced again
                record(folder, own)


def write_together(*given: tuple[OutputFile | None, Any]) -> None:
    """Write files of one run (see `replaced_together`), each with its content; those that are None are left out.

    A content is a table, a function that writes to a path, or what JSON can hold.
    """
    with replaced_together(*(file for file, _ in given)) as parts:
        for (_, content), part in zip(given, parts, strict=True):
            if part is None:
                continue
            if callable(content):
                content(part)
            elif hasattr(content, "to_csv"):
                write_csv(content, part)
            else:
                write_json(content, part)


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


def record(folder: Path, digests: Mapping[str, str]) -> None:
    """Add files, by their names, to the record of their folder; entries of missing files are dropped.

    The digests of the present files stay, since a run that is killed now leaves those files.
    """
    known = {name: old for name, old in recorded(folder).items() if (folder / name).exists()}
    for name, digest in digests.items():
        here = {sha256(folder / name)} if (folder / name).exists() else set()
        known[name] = (known.get(name, set()) & here) | {digest}
    lines = [f"{d}  {name}\n" for name in sorted(known) for d in sorted(known[name])]
    write_text_atomic("".join(lines), folder / RECORD_NAME)
