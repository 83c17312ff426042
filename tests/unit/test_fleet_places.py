"""Inputs of a fleet that lie in stores."""

from __future__ import annotations

import os
import time
import zipfile
from pathlib import Path

import pytest

from identification.fleets.places import Base, fetched
from identification.runtime.parallel import parallel_map


def test_a_store_that_is_not_asynchronous_is_read_by_one_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its memory hands out a file as one object: of two threads that read it at once, one got a part of it."""
    from fsspec.implementations.memory import MemoryFileSystem

    store, copy, inside, most = MemoryFileSystem(), MemoryFileSystem.get_file, [], []
    store.pipe("/turns/a.csv", b"x" * 100_000)

    def get_file(*arguments: object) -> None:
        inside.append(1)
        time.sleep(0.02)
        most.append(len(inside))
        copy(*arguments)
        inside.pop()

    def read() -> int:
        with fetched(Base.of("memory://turns/list.csv"), "a.csv") as path:
            return path.stat().st_size

    monkeypatch.setattr(MemoryFileSystem, "get_file", get_file)
    monkeypatch.setattr(os, "cpu_count", lambda: 4)
    assert parallel_map([read] * 4) == [100_000] * 4
    assert max(most) == 1


def test_a_list_in_an_archive_names_what_is_beside_it_there(tmp_path: Path) -> None:
    """Addresses of fsspec within another one; the path is what stands before the second."""
    with zipfile.ZipFile(tmp_path / "fleet.zip", "w") as archive:
        archive.writestr("2026/list.csv", "machine,survey\n")
        archive.writestr("2026/data/a.csv", "X\n1\n")
        archive.writestr("b.csv", "X\n2\n")
    for around in (str(tmp_path), f"file://{tmp_path.as_posix()}"):
        base = Base.of(f"zip://2026/list.csv::{around}/fleet.zip")
        assert base.last == "list.csv"
        for entry, text in (("data/a.csv", "X\n1\n"), ("../b.csv", "X\n2\n")):
            with fetched(base, entry) as path:
                assert path.read_text() == text
    assert Base.of("memory://list.csv").place("a.csv") == "memory://a.csv"
    assert Base.of("s3://shop/x/list.csv").place("../a.csv") == "s3://shop/a.csv"
    assert Base.of("simplecache::s3://shop/list.csv").place("a.csv") == "simplecache::s3://shop/a.csv"
