"""Windows' rules for files, kept on Linux: what cannot be tried on the system itself is tried by them.

Folders cannot be opened; what is open, or holds something open, cannot be renamed, replaced or removed, nor can what is
read-only be replaced or removed; a rename replaces nothing; text is written in a code page and with its line ends where
a programme does not say otherwise; functions and modules of POSIX are missing.
"""

from __future__ import annotations

import builtins
import errno
import io
import os
import shutil
import signal
import stat
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from errormodel import files
from identification.results import output_file, results_folder

MISSING = ("fork", "sync", "sched_getaffinity", "killpg", "setsid", "mkfifo", "fchmod", "O_NOFOLLOW", "O_DIRECTORY")
MISSING_MODULES = ("fcntl", "resource", "pwd", "grp", "termios")
LIBRARY = ".so"  # mapped files that are no data


def obey(patch: pytest.MonkeyPatch) -> None:
    """Keep Windows' rules from now on, as far as errormodel meets them."""
    import fcntl  # which this module, imported on every system, does without

    opening, flock, opened, removed = io.open, fcntl.flock, os.open, os.unlink
    for module in (files, results_folder):
        patch.setattr(module, "sys", SimpleNamespace(platform="win32"))
    patch.setattr(output_file, "WINDOWS", True)
    patch.setattr(Path, "is_mount", _unsupported)  # before Python 3.12
    patch.setattr(shutil, "_use_fd_functions", False)
    for name in MISSING:
        patch.delattr(os, name)
    patch.delattr(signal, "SIGHUP")
    for name in MISSING_MODULES:
        patch.setitem(sys.modules, name, None)

    def locking(handle: int, mode: int, size: int) -> None:
        try:
            flock(handle, 2 | 4)  # exclusive, without waiting
        except OSError:
            raise PermissionError(errno.EACCES, "Permission denied") from None
        if not os.fstat(handle).st_nlink:  # removed while it was open, which Windows does not do
            name = str(Path(f"/proc/self/fd/{handle}").readlink()).removesuffix(" (deleted)")
            new = opened(name, os.O_RDWR | os.O_CREAT)
            os.dup2(new, handle)
            os.close(new)
            raise PermissionError(errno.EACCES, "Permission denied")

    def remove(path: Any, **_: Any) -> None:
        _remove(path)
        if not str(path).endswith(".lock"):
            return removed(path)
        handle = opened(path, os.O_RDWR)
        try:
            locking(handle, 2, 1)  # another process has it open
            removed(path)
        finally:
            os.close(handle)

    patch.setitem(sys.modules, "msvcrt", SimpleNamespace(LK_NBLCK=2, locking=locking))
    patch.setattr(os, "remove", remove)
    patch.setattr(os, "unlink", remove)

    def ruled(name: str, check: Callable[..., None]) -> None:
        function: Callable[..., Any] = getattr(os, name)

        def call(*arguments: Any, **options: Any) -> Any:
            check(*arguments)
            return function(*arguments, **options)

        patch.setattr(os, name, call)

    for name, check in (("open", _open), ("rename", _rename), ("replace", _replace)):
        ruled(name, check)

    def text(file: Any, mode: str = "r", *more: Any, **options: Any) -> Any:
        if "b" not in mode and not isinstance(file, int) and not str(file).startswith("/proc"):
            given = dict(zip(("buffering", "encoding", "errors", "newline"), more, strict=False)) | options
            given["encoding"] = given.get("encoding") or "cp1252"
            if given.get("newline") is None and "r" not in mode:
                given["newline"] = "\r\n"
            return opening(file, mode, **given)
        return opening(file, mode, *more, **options)

    patch.setattr(io, "open", text)
    patch.setattr(builtins, "open", text)


def _unsupported(path: Path) -> bool:
    raise NotImplementedError("Path.is_mount() is unsupported on this system")


def _open(path: Any, *_: object) -> None:
    if not isinstance(path, int) and Path(os.fsdecode(path)).is_dir():
        _deny(path, "a folder is opened")


def _rename(source: Any, target: Any) -> None:
    if os.path.lexists(target):
        raise FileExistsError(errno.EEXIST, "it exists", str(target))
    _check_free(source)


def _replace(source: Any, target: Any) -> None:
    _check_free(source)
    _remove(target)


def _remove(path: Any) -> None:
    with suppress(FileNotFoundError):
        if not Path(path).lstat().st_mode & stat.S_IWUSR:
            _deny(path, "it is read-only")
        _check_free(path)


def _check_free(path: Any) -> None:
    place = os.path.realpath(os.fsdecode(path))
    names = set()
    for entry in Path("/proc/self/fd").iterdir():
        with suppress(OSError):
            names.add(str(entry.readlink()))
    for line in Path("/proc/self/maps").read_text(encoding="utf-8").splitlines():
        if "/" in line and LIBRARY not in line:
            names.add(line[line.index("/") :])
    if held := next((n for n in names if n == place or n.startswith(f"{place}/")), None):
        _deny(path, f"{held} is open")


def _deny(path: object, why: str) -> None:
    raise PermissionError(errno.EACCES, f"Access is denied: {why}", str(path))
