"""Atomic writing and reading of folders of results: built beside their place, listed in a manifest, then exchanged.

After a crash at any point either the old or the new results are there. Files of other commands in the folder stay:
tables in a folder of their own, the history of a monitored machine, an unfinished chain. Foreign files are refused.
"""

from __future__ import annotations

import os
import secrets
import shutil
import stat
import sys
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from errormodel.exceptions import InputError
from errormodel.files import flush, locked, plain_mode, taken, unwritable, write_text_atomic
from identification.results import manifest
from identification.results.folder_contents import kept_of, outdated
from identification.results.output_file import same

OTHER_FOLDER_CURE = "Choose another folder, or move that one away"


class ResultsFolder:
    """A folder to be written.

    Parameters
    ----------
    path : Path
    holds : such as "model" or "tables"
        A folder of one kind never replaces one of the other.
    """

    def __init__(self, path: Path, holds: str = "model") -> None:
        self.path, self.holds = path, holds
        self.notes: tuple[str, ...] = ()  # notes on files that stayed and belong to earlier results

    def __str__(self) -> str:
        return str(self.path)

    def covers(self, path: Path) -> bool:
        """Whether `path` is this folder or lies in it."""
        return any(same(self.path, place) for place in (path, path.absolute().parent, *_parents(path)))

    def joins(self, folder: Path, suffixes: Collection[str]) -> bool:
        """Always False: a folder is not read as a file of another one."""
        return False

    def check(self) -> list[str]:
        """Check before any work whether the folder may be written; return what stays in it.

        Raises
        ------
        InputError
            The folder holds files that errormodel did not write or that were changed since, or cannot be exchanged.
        """
        try:
            recover(self.path)
            if not self.path.exists():
                plain_mode(self.path)  # a dangling link
                return []
            mounted = os.path.ismount(self.path)  # `Path.is_mount` is not there on Windows before Python 3.12
            if self.path.resolve() in (Path.cwd(), *Path.cwd().parents) or mounted:
                where = "a mount point" if mounted else "the folder that the command runs in, or one above"
                found = f"{where}, which cannot be exchanged as a whole"
                raise InputError(str(self.path), found, f"Give a folder in it, such as {self.path / 'results'}")
            old = manifest.read(self.path)
            if old is not None and old.holds != self.holds:
                found = f"it holds what `errormodel {old.command}` wrote, which is no earlier result of this command"
                raise InputError(str(self.path), found, OTHER_FOLDER_CURE)
            return kept_of(self.path, old)
        except OSError as error:
            raise unwritable(self.path, error) from error

    def workspace(self, name: str) -> Path:
        """Subfolder in which a command keeps unfinished work (see `folder_contents`)."""
        return self.path / name

    @contextmanager
    def replaced(self) -> Iterator[Path]:
        """Empty folder to write to; it replaces this one when the block ends without an error.

        Raises
        ------
        InputError
            See `check`; or the place cannot be written to.
        """
        self.check()
        target = self.path.resolve()  # a link to a folder is kept
        part, handle = None, None
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            with locked(target.parent):
                _clear(target)
                part = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
                part.mkdir()
                handle = _held(part)
            yield part
            text = manifest.written(part, self.holds)
            write_text_atomic(_json(text), part / manifest.NAME)
            with locked(target.parent):
                kept = self.check()
                self.notes = tuple(outdated(target, kept, text["files"]))
                for name in kept:
                    _carry(target / name, part / name)
                _like(target, part)
                for folder in (p for p in part.rglob("*") if p.is_dir()):
                    flush(folder)
                flush(part)
                _exchange(part, target)
                flush(target.parent)
        except OSError as error:
            raise unwritable(self.path, error) from error
        finally:
            if part is not None:
                shutil.rmtree(part, ignore_errors=True)
                if handle is not None:
                    _let_go(part, handle)


def _parents(path: Path) -> Sequence[Path]:
    try:
        return path.resolve().parents
    except (OSError, ValueError, RuntimeError):  # not a valid file name
        return ()


def recover(path: Path) -> None:
    """Restore an old folder that a killed run was about to exchange (see `_exchange`)."""
    target = path.resolve()
    if not target.exists() and _aside(target).is_dir():
        with locked(target.parent):
            if not target.exists() and _aside(target).is_dir():
                _aside(target).rename(target)


@contextmanager
def whole(folder: Path) -> Iterator[None]:
    """Context in which a folder of results is read: its files belong together, and are not exchanged meanwhile.

    Raises
    ------
    InputError
        A file was changed or is of another result.
    """
    with suppress(OSError):
        recover(folder)
    with locked(folder.resolve().parent):
        try:
            yield
        except InputError as error:
            # the reader explains best what is wrong with a file, its digest which of two contradicting files is wrong
            if not any(error.where.startswith(str(folder / name)) for name in manifest.wrong(folder)):
                manifest.check_whole(folder)
            raise
        manifest.check_whole(folder)


def _json(data: object) -> str:
    import json

    return json.dumps(data, indent=1, ensure_ascii=False, default=str) + "\n"


def _exchange(part: Path, target: Path) -> None:
    """Put `part` in the place of `target`; the old content is then `part`, or removed."""
    if not target.exists():
        part.rename(target)
    elif not _swapped(part, target):
        aside = _aside(target)
        target.rename(aside)
        try:
            part.rename(target)
        except BaseException:
            aside.rename(target)
            raise
        shutil.rmtree(aside, ignore_errors=True)


def _aside(target: Path) -> Path:
    return target.with_name(f".{target.name}.old")


def _swapped(part: Path, target: Path) -> bool:
    """Exchange two folders atomically where the system supports it."""
    if sys.platform != "linux":
        return False
    import ctypes

    here, exchange = -100, 2  # AT_FDCWD, RENAME_EXCHANGE
    try:
        call = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError):
        return False
    return bool(call(here, os.fsencode(part), here, os.fsencode(target), exchange) == 0)


def _carry(old: Path, new: Path) -> None:
    """Put the same file in the new folder, as a link if possible, since a history may be open."""
    if old.is_dir():
        new.mkdir()
        for entry in old.iterdir():
            _carry(entry, new / entry.name)
        shutil.copystat(old, new)
        return
    if new.exists():
        raise InputError(str(old), "it is in the way of a result of that name", "Move it away")
    try:
        os.link(old, new, follow_symlinks=False)
    except OSError:
        shutil.copy2(old, new, follow_symlinks=False)


def _like(target: Path, part: Path) -> None:
    """Give the new folder and its files the permissions of the old ones."""
    if target.exists():
        part.chmod(stat.S_IMODE(target.stat().st_mode))
        for new in (p for p in part.rglob("*") if p.is_file()):
            mode = plain_mode(target / new.relative_to(part))
            if mode is not None:
                new.chmod(mode)


def _clear(target: Path) -> None:
    """Remove leftovers of killed runs beside a folder."""
    if target.exists():
        shutil.rmtree(_aside(target), ignore_errors=True)
    beside = [p for p in target.parent.iterdir() if p.name.startswith(f".{target.name}.")]
    parts = {p for p in beside if p.suffix == ".part" and p.is_dir()}
    if sys.platform == "win32":  # a lock may be left alone
        parts |= {p.with_suffix("") for p in beside if p.name.endswith(".part.lock")}
    for old in parts:
        handle = _held(old)
        if handle is not None:
            shutil.rmtree(old, ignore_errors=True)
            _let_go(old, handle)


def _held(part: Path) -> int | None:
    """Lock a folder for the life of this process; None if another one holds it."""
    if sys.platform == "win32":  # where a folder cannot be opened, nor renamed while a file in it is
        handle = os.open(_lock_beside(part), os.O_RDWR | os.O_CREAT)
    else:
        handle = os.open(part, os.O_RDONLY)
    if taken(handle):
        return handle
    os.close(handle)
    return None


def _let_go(part: Path, handle: int) -> None:
    os.close(handle)
    with suppress(OSError):  # another process looks whether it is locked
        _lock_beside(part).unlink(missing_ok=True)


def _lock_beside(part: Path) -> Path:
    return part.with_name(f"{part.name}.lock")
