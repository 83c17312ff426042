"""Atomic writing of files: written beside their destination, flushed to the disk, then moved into place."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import stat
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from errormodel.exceptions import ErrorModelError, InputError

if TYPE_CHECKING:
    import pandas as pd

LOCK_WAIT_SECONDS = 60.0  # s to wait for another process that holds the lock; by judgement
REMOVAL_SECONDS = 5.0  # s that Windows keeps a removed file which a virus scanner or an indexer looks at; by judgement
LOCK_FILE = ".errormodel.lock"  # name of the lock file, on systems where a folder itself cannot be locked
UNWRITABLE_CURE = "Give a place that can be written to"  # correction in messages about files that cannot be written
# what a spreadsheet may run, and what would read back as such; in time that grows with the length, whatever the text
_FORMULA_START = r"\s*(?:'+\s*)?[=+\-@]"
FORMULA = re.compile(_FORMULA_START)
# names that Windows keeps for devices, whatever their suffix; characters that it has no names with
_DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³]|conin\$|conout\$)\s*(\..*)?", re.IGNORECASE)
_FORBIDDEN = re.compile(r'[<>:"|?*\x00-\x1f]')
QUOTED_FORMULA = rf"^'(?={_FORMULA_START})"  # the apostrophe before it


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """Temporary path beside `path` that replaces it when the block ends without an error.

    Missing folders are made. The suffix is kept, because writers choose the format by it, and so is the mode of an
    existing file.

    Raises
    ------
    InputError
        The destination cannot be written to, or is no regular file.
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
        with suppress(OSError):  # where the folder cannot be written to, there is no file to remove
            part.unlink(missing_ok=True)


@contextmanager
def replacing_together(paths: Sequence[Path]) -> Iterator[list[Path]]:
    """Temporary paths beside `paths` that replace them when the block ends without an error: all of them or none.

    None is replaced before all are on the disk. A process that is killed while they are replaced leaves some of them
    missing, never files of two runs side by side.

    Raises
    ------
    InputError
        See `replacing`; all files are as they were.
    """
    aside: dict[Path, Path] = {}
    try:
        with ExitStack() as stack:
            parts = [stack.enter_context(replacing(path)) for path in paths]
            yield parts
            if len(paths) > 1:
                for part in parts:
                    flush(part)
                for path in filter(Path.exists, paths):
                    aside[path] = path.with_name(f".{path.stem}.{os.getpid()}.part.part{path.suffix}")
                    try:
                        path.rename(aside[path])
                    except OSError as error:
                        raise unwritable(path, error) from error
    except BaseException:
        for path, old in aside.items():
            with suppress(FileNotFoundError):  # it was not moved yet
                old.replace(path)
        raise
    for old in aside.values():
        with suppress(OSError):  # a system that does not remove open files
            old.unlink()


def clear_parts(path: Path) -> None:
    """Remove what killed processes left of writing `path`; for those that hold the lock of its folder."""
    # a part is written through a part of its own
    left = re.compile(r"\.+" + re.escape(path.stem) + r"(\.(\d+|part)){2,}" + re.escape(path.suffix))
    for old in path.parent.iterdir():
        if left.fullmatch(old.name):
            with suppress(OSError):  # a system that does not remove open files
                old.unlink()


def write_text_atomic(text: str, path: Path | str) -> None:
    r"""Write UTF-8 text with ``\n`` line ends on every system, so that the same input gives the same bytes."""
    with replacing(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


def write_bytes_atomic(data: bytes, path: Path | str) -> None:
    """Write bytes as they are."""
    with replacing(path) as part:
        part.write_bytes(data)


def write_csv(frame: pd.DataFrame, path: Path | str) -> None:
    """Write a table without its index, each float in the shortest form that reads back as the same float.

    NaN and None become empty cells, which a survey reads as "not measured". Text that a spreadsheet would take for a
    formula gets an apostrophe in front, which spreadsheets show as text and `without_apostrophes` takes away.
    """
    with replacing(path) as part:
        _plain_cells(frame).to_csv(part, index=False, lineterminator="\n", encoding="utf-8")


def append_csv(frame: pd.DataFrame, path: Path) -> None:
    """Add rows to a table as `write_csv` writes it, which others may read while it grows; a new one gets its header.

    A stop while it is written can leave half a row.

    Raises
    ------
    InputError
        The place cannot be written to.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a", encoding="utf-8", newline="") as file:
            file.write(_plain_cells(frame).to_csv(index=False, header=file.tell() == 0, lineterminator="\n"))
    except OSError as error:
        raise unwritable(path, error) from error


def forget(path: Path) -> None:
    """Remove a file that no longer says what is the case; no error where there is none.

    Raises
    ------
    InputError
        It cannot be removed.
    """
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise unwritable(path, error) from error


def _plain_cells(frame: pd.DataFrame) -> pd.DataFrame:
    text = frame.select_dtypes(exclude=["number", "bool"]).columns
    return frame.assign(**{name: frame[name].map(_inert) for name in text})


def read_csv(path: Path, **options: Any) -> pd.DataFrame:
    """Read a table that `write_csv` wrote; `options` of pandas.

    Raises
    ------
    OSError, ValueError
        It is no such table. Rows with more cells than the first line, of which pandas makes names of the rows, are
        refused: each column would stand under the name of another.
    """
    import pandas as pd

    table: pd.DataFrame = pd.read_csv(path, **options)
    if not isinstance(table.index, pd.RangeIndex):
        raise ValueError("rows with more cells than the header")
    return table


def as_numbers(column: pd.Series) -> pd.Series:
    """The cells of a column as numbers: NaN where one is none, infinite where it is too large for a float."""
    import pandas as pd

    texts = column.astype(str) if column.dtype == object else column  # Python's integers of any size raise
    return pd.to_numeric(texts, errors="coerce")


def write_parquet(frame: pd.DataFrame, path: Path | str) -> None:
    """Write a table without its index as Parquet; the same table gives the same bytes."""
    with replacing(path) as part:
        frame.to_parquet(part, index=False)


def write_parquet_blocks(tables: Iterable[pd.DataFrame], path: Path | str) -> int:
    """Write tables of the same columns one below the other as Parquet, a block at a time; return the number of rows.

    Raises
    ------
    InputError
        PyArrow is not installed.
    """
    from errormodel.extras import optional

    pa = optional("pyarrow", str(path), "a Parquet file to write")
    parquet = optional("pyarrow.parquet", str(path), "a Parquet file to write")
    count, writer = 0, None
    with replacing(path) as part:
        try:
            for table in tables:
                block = pa.Table.from_pandas(table, preserve_index=False).replace_schema_metadata(None)
                writer = parquet.ParquetWriter(part, block.schema) if writer is None else writer
                writer.write_table(block)
                count += len(table)
        finally:
            if writer is not None:
                writer.close()
    return count


def _inert(cell: object) -> object:
    if not isinstance(cell, str) or not FORMULA.match(cell):
        return cell
    try:
        float(cell)  # a sign is no formula
    except ValueError:
        return f"'{cell}"
    return cell


def without_apostrophes(text: pd.Series[str]) -> pd.Series[str]:
    """Cells as they were before `write_csv` put apostrophes before those that look like formulas."""
    return text.str.replace(QUOTED_FORMULA, "", regex=True)


def plain_mode(path: Path) -> int | None:
    """Permissions of a regular file; None where there is no file.

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
    """Error for a file that the system refused to write."""
    return InputError(str(path), f"cannot be written: {error.strerror or error}", UNWRITABLE_CURE)


def flush(path: Path) -> None:
    """Wait until the disk holds a file's content, or a folder's entries, so that a power failure loses nothing."""
    folder = path.is_dir()
    if folder and sys.platform == "win32":
        return  # a folder cannot be opened there
    handle = os.open(path, os.O_RDONLY if folder else os.O_RDWR)
    try:
        if not _past_the_cache(handle):
            os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP, errno.ENOSYS):  # file systems without this operation
            raise
    finally:
        os.close(handle)


def _past_the_cache(handle: int) -> bool:
    """Flush on macOS, whose fsync leaves data in the cache of the drive; False elsewhere, and where it cannot be."""
    if sys.platform == "darwin":
        import fcntl

        with suppress(OSError):
            fcntl.fcntl(handle, fcntl.F_FULLFSYNC)
            return True
    return False


def impossible_on_windows(name: str) -> str | None:
    """Why Windows cannot have a file or folder of this name, in words; None where it can."""
    if _DEVICE.fullmatch(name):
        return "a name that Windows keeps for a device"
    if name.strip(".") and name != name.rstrip(". "):
        return "a name that ends with a point or a space, which Windows takes away"
    if found := _FORBIDDEN.search(name):
        return f"a name with {found[0]!r}, which Windows does not allow"
    return None


def sha256(path: Path) -> str:
    """SHA-256 digest of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the lock of `folder` against other processes, waiting for those that hold it.

    Raises
    ------
    ErrorModelError
        Another process has held it for a minute.
    """
    handle = None
    with suppress(OSError):  # a folder that cannot be opened: writing there gives the reason
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
        path, until = folder / LOCK_FILE, time.monotonic() + REMOVAL_SECONDS
        while True:
            try:
                return os.open(path, os.O_RDWR | os.O_CREAT)
            except PermissionError:  # also while a file goes that another run has removed, whose lock is held no longer
                if not os.path.lexists(path) or time.monotonic() > until:
                    raise
                time.sleep(0.005)
    return os.open(folder, os.O_RDONLY)


def taken(handle: int) -> bool:
    """Lock an open file or folder unless another process holds it; True as well where locking is not supported."""
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
