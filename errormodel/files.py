"""Files written whole or not at all: beside their place, flushed to the disk, then moved there."""

from __future__ import annotations

import errno
import hashlib
import os
import stat
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from errormodel.exceptions import ErrorModelError, InputError

if TYPE_CHECKING:
    import pandas as pd

LOCK_WAIT_SECONDS = 60.0  # seconds to wait for another run
LOCK_FILE = ".errormodel.lock"  # where a folder itself cannot be locked
UNWRITABLE_CURE = "Give a place that can be written to"


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """A path beside `path` to write to; it takes the place of `path` when the block ends without an error.

    Folders on the way are made. The suffix is kept, since many writers go by it, and so is the mode of an old file.

    Raises
    ------
    InputError
        The place cannot be written to, or is no plain file.
    """
    path = Path(path)
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        mode = plain_mode(path)
        yield part
        if mode is not None:
            part.chmod(mode)
        flush(part)
        os.replace(part, path)  # noqa: PTH105  tests break the move here
        flush(path.parent)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        with suppress(OSError):  # where nothing can be written nothing is left behind
            part.unlink(missing_ok=True)


def write_text_atomic(text: str, path: Path | str) -> None:
    r"""Write UTF-8 text with ``\n`` line ends on every system, so that the same input gives the same bytes."""
    with replacing(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


def write_bytes_atomic(data: bytes, path: Path | str) -> None:
    """Write bytes as they are."""
    with replacing(path) as part:
        part.write_bytes(data)


def write_csv(frame: pd.DataFrame, path: Path | str) -> None:
    """Write a table without its index; every float in the shortest form that reads back as the same float.

    NaN and None become empty cells, which a survey reads as "not measured".
    """
    with replacing(path) as part:
        frame.to_csv(part, index=False, lineterminator="\n", encoding="utf-8")


def plain_mode(path: Path) -> int | None:
    """Permissions of a plain file, None where there is nothing.

    Raises
    ------
    InputError
        There is something else, which a move would destroy: a link, a device, a pipe, a folder.
    """
    try:
        mode = path.lstat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return None
    if stat.S_ISREG(mode):
        return stat.S_IMODE(mode)
    kinds = (
        (stat.S_ISLNK, "a link"),
        (stat.S_ISDIR, "a folder"),
        (stat.S_ISFIFO, "a pipe"),
        (stat.S_ISSOCK, "a socket"),
    )
    kind = next((name for test, name in kinds if test(mode)), "a device")
    raise InputError(str(path), f"{kind}, which is not replaced", "Give the name of a plain file, or a new one")


def unwritable(path: Path, error: OSError) -> InputError:
    """What to say where the system refused to write."""
    return InputError(str(path), f"cannot be written: {error.strerror or error}", UNWRITABLE_CURE)


def flush(path: Path) -> None:
    """Wait until the disk has what was written to a file, or moved into a folder: a power cut then loses nothing."""
    folder = path.is_dir()
    if folder and sys.platform == "win32":
        return  # a folder cannot be opened there
    handle = os.open(path, os.O_RDONLY if folder else os.O_RDWR)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP, errno.ENOSYS):  # file systems that cannot do it
            raise
    finally:
        os.close(handle)


def sha256(path: Path) -> str:
    """Digest of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other runs from changing what stands in `folder`, and wait for those that do.

    Raises
    ------
    ErrorModelError
        Another run has held it for a minute.
    """
    handle = None
    with suppress(OSError):  # a folder that cannot even be opened: writing there says why
        handle = _handle(folder)
    if handle is None:
        yield
        return
    try:
        until = time.monotonic() + LOCK_WAIT_SECONDS
        while not taken(handle):
            if time.monotonic() > until:
                raise ErrorModelError(f"{folder}: another run has held it for {LOCK_WAIT_SECONDS:.0f} s. Try again")
            time.sleep(0.005)
        yield
    finally:
        os.close(handle)
        with suppress(OSError):
            (folder / LOCK_FILE).unlink(missing_ok=True)


def _handle(folder: Path) -> int:
    if sys.platform == "win32":
        return os.open(folder / LOCK_FILE, os.O_RDWR | os.O_CREAT)
    return os.open(folder, os.O_RDONLY)


def taken(handle: int) -> bool:
    """Lock what `handle` has open, unless another process has; where nothing can be locked, as if it were."""
    if sys.platform == "win32":
        import msvcrt

        try:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True
    import fcntl

    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # some network drives
        return True
    return True
