"""Independent jobs on all cores: each worker is a fork of this process, so that only the results travel.

Large arrays need not travel either, where a job lays them on a `Ground`.
"""

from __future__ import annotations

import io
import mmap
import multiprocessing
import os
import pickle
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

T = TypeVar("T")
Place = tuple[int, tuple[int, ...], str]  # of an array: bytes from the start, shape, kind of number

ALIGNED = 64  # bytes: every array begins at a multiple
NO_RESERVE = 0x4000  # Linux: take no memory before it is written to
PATIENCE = 60.0  # s: a worker that is silent for longer after all else is done has been lost


class Ground:
    """Memory that this process and its workers see alike, in as many parts as there are jobs.

    It is the system's only as far as it is written to. What finds no room on it is laid elsewhere, and travels.
    """

    def __init__(self, size: int, parts: int) -> None:
        self._memory = np.empty(0, np.uint8)
        if parts > 1 and _cores() > 1:
            with suppress(OSError, ValueError):
                flags = mmap.MAP_SHARED | mmap.MAP_ANONYMOUS | NO_RESERVE
                self._memory = np.frombuffer(mmap.mmap(-1, size, flags=flags), np.uint8)
        step = len(self._memory) // parts // ALIGNED * ALIGNED
        self._free = [k * step for k in range(parts)]
        self._end = [k * step + step for k in range(parts)]

    def empty(self, part: int, shape: tuple[int, ...], kind: DTypeLike) -> NDArray[Any]:
        """An array of anything, on the part of a job."""
        size = int(np.prod(shape)) * np.dtype(kind).itemsize
        start = self._free[part]
        if start + size > self._end[part]:
            return np.empty(shape, kind)
        self._free[part] += -(-size // ALIGNED) * ALIGNED
        return self._memory[start : start + size].view(kind).reshape(shape)

    def place(self, array: NDArray[Any]) -> Place | None:
        """Where an array lies; None where that is elsewhere."""
        start = array.ctypes.data - self._memory.ctypes.data
        inside = start >= 0 and start + array.nbytes <= len(self._memory)
        return (start, array.shape, array.dtype.str) if inside and array.flags.c_contiguous and array.nbytes else None

    def at(self, place: Place) -> NDArray[Any]:
        """The array of a place."""
        start, shape, kind = place
        return self._memory[start : start + int(np.prod(shape)) * np.dtype(kind).itemsize].view(kind).reshape(shape)


NO_GROUND = Ground(0, 1)


def side_by_side(jobs: Sequence[Callable[[], T]], ground: Ground = NO_GROUND) -> list[T]:
    """What each job returns, in their order; what a job changes may be lost with its worker, but for the ground.

    Workers are for Linux, where a fork is safe and cheap, and not for processes that are workers themselves (a pool's,
    Dask's); elsewhere all is done here, one after the other. What a worker did not bring is done here too: an exception
    rises where it can be seen.
    """
    count = max(min(len(jobs), _cores()), 1)
    shares = [jobs[k::count] for k in range(count)]
    workers = [_started(share, ground) for share in shares[1:]]
    brought = [[job() for job in shares[0]], *(_received(worker, ground) for worker in workers)]
    parts = [done or [job() for job in share] for done, share in zip(brought, shares, strict=True)]
    return [parts[k % count][k // count] for k in range(len(jobs))]


def _cores() -> int:
    if sys.platform != "linux" or multiprocessing.current_process().daemon:
        return 1
    return len(os.sched_getaffinity(0))


def _started(jobs: Sequence[Callable[[], Any]], ground: Ground) -> tuple[Any, Connection] | None:
    """A worker, and where its results come from; None where the system has no room for one."""
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(jobs, ground, there), daemon=True)
    with warnings.catch_warnings():
        # the threads that a library keeps are not forked: nothing of theirs is waited for in what workers do
        warnings.filterwarnings("ignore", ".*multi-threaded.*fork", DeprecationWarning)
        try:
            process.start()
        except OSError:
            return None
        finally:
            there.close()
    return process, here


def _work(jobs: Sequence[Callable[[], Any]], ground: Ground, results: Connection) -> None:
    with suppress(Exception):  # the parent meets it again, with all its handlers
        message = io.BytesIO()
        _Sender(message, ground).dump([job() for job in jobs])
        results.send_bytes(message.getbuffer())


class _Sender(pickle.Pickler):
    def __init__(self, message: io.BytesIO, ground: Ground) -> None:
        super().__init__(message, pickle.HIGHEST_PROTOCOL)
        self._ground = ground

    def persistent_id(self, obj: Any) -> Place | None:
        return self._ground.place(obj) if isinstance(obj, np.ndarray) else None


class _Receiver(pickle.Unpickler):
    def __init__(self, message: io.BytesIO, ground: Ground) -> None:
        super().__init__(message)
        self._ground = ground

    def persistent_load(self, pid: Any) -> NDArray[Any]:
        return self._ground.at(pid)


def _received(worker: tuple[Any, Connection] | None, ground: Ground) -> list[Any]:
    """A worker's results; none of one that failed or was lost."""
    if worker is None:
        return []
    process, results = worker
    try:
        return list(_Receiver(io.BytesIO(results.recv_bytes()), ground).load()) if results.poll(PATIENCE) else []
    except (EOFError, OSError):
        return []
    finally:
        process.kill()
        process.join()
