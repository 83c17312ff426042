"""What a power failure may leave: the old results or the new ones, by the order of writes and renames.

A file system may lose, after a failure, whatever was not flushed (fsync), and may do a rename before it writes the
content of what was renamed. So before a file or folder is put in place, all its content and entries are flushed, and
the folder that it is in afterwards. Then at any moment the disk holds the old content under the name, or all of the new
one.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from identification.results import results_folder
from tests.helpers.commands import MILL, done, fitted_mill
from tests.helpers.nightly import first_of

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="flushes with fsync, exchanges with renameat2")


class Disk:
    """What was flushed so far, and the renames that came too early."""

    def __init__(self) -> None:
        self.flushed: set[tuple[int, int, int]] = set()  # inode, time of the last change of content, size
        self.early: list[str] = []
        self.unsettled: dict[Path, str] = {}  # folders whose entries a rename changed, not flushed since
        self.renames = 0

    @staticmethod
    def mark(status: os.stat_result) -> tuple[int, int, int]:
        return status.st_ino, status.st_mtime_ns, status.st_size

    def flush(self, handle: int) -> None:
        self.flushed.add(self.mark(os.fstat(handle)))
        for folder in [p for p in self.unsettled if p.exists() and os.path.samestat(p.stat(), os.fstat(handle))]:
            del self.unsettled[folder]

    def rename(self, source: Path, target: Path) -> None:
        """Check a rename that is about to happen."""
        self.renames += 1
        for path in (source, *(source.rglob("*") if source.is_dir() else ())):
            if self.mark(path.stat()) not in self.flushed:
                self.early.append(f"{path} is not on the disk when {source} becomes {target}")
        self.unsettled[target.parent] = f"the folder of {target} is not flushed after it was put in place"


@contextmanager
def watched(monkeypatch: pytest.MonkeyPatch) -> Iterator[Disk]:
    disk = Disk()
    fsync, swapped = os.fsync, results_folder._swapped

    def flush(handle: int) -> None:
        fsync(handle)
        disk.flush(handle)

    def renaming(original: Callable[..., Any]) -> Callable[..., Any]:
        def call(source: str | Path, target: str | Path, *more: Any, **options: Any) -> Any:
            disk.rename(Path(source), Path(target))
            return original(source, target, *more, **options)

        return call

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", flush)
        for name in ("replace", "rename"):
            patch.setattr(os, name, renaming(getattr(os, name)))
        patch.setattr(results_folder, "_swapped", renaming(swapped))
        yield disk


COMMANDS = {
    "carried": (("predict", "fit", "s.csv", "--out", "fit/p.csv"), ("fit", MILL, "s.csv", "--out", "fit")),
    "simulate": (("simulate", MILL, 5, "--out", "made.csv"),),
    "fit": (("fit", MILL, "s.csv", "--out", "new"), ("fit", MILL, "s.csv", "--seed", 3, "--out", "new")),
    "posterior": (("fit", MILL, "s.csv", "--robust", "--bayes", "--out", "new"),),
    "tables": (("compensate", "fit", "--controller", "siemens-cec", "--points", 4, "--out", "tables"),),
    "certificate": (("iso", "230-1", "fit", "--out", "certificate"),),
    "monitor": (("monitor", "fit", "s.csv"),),
}


@pytest.mark.parametrize("name", first_of(COMMANDS))
def test_content_is_on_the_disk_before_it_has_its_name(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with watched(monkeypatch) as disk:
        fitted_mill(tmp_path)
        for words in COMMANDS[name]:
            done(*words)
    assert disk.renames > 4
    assert disk.early == []
    assert list(disk.unsettled.values()) == []


def test_what_is_not_flushed_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with watched(monkeypatch) as disk:
        (tmp_path / "a").write_text("x")
        (tmp_path / "a").replace(tmp_path / "b")
    assert len(disk.early) == 1
    assert len(disk.unsettled) == 1
