"""Inputs of a fleet that lie in stores."""

from __future__ import annotations

import os
import time

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
