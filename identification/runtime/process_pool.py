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
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

if TYPE_CHECKING:
    from multiprocessing.context import ForkProcess

T = TypeVar("T")
Place = tuple[int, tuple[int, ...], str]  # of an array: bytes from the start, shape, kind of number

ALIGNED = 64  # bytes: every array begins at a multiple
NO_RESERVE = 0x4000  # Linux: take no memory before it is written to
MOST_DEALT = 10_000  # jobs: their numbers fit into a pipe
PATIENCE = 60.0  # s: a worker that has done nothing for so long, after all else is done, has been lost


class Ground:
    """Memory that this process and its workers see alike, in as many parts as there are jobs.

    It is the system's only as far as it is written to. What finds no room on it is laid elsewhere, and travels.
    """

    def __init__(self, size: int, parts: int) -> None:
        self._memory = np.empty(0, np.uint8)
        if parts > 1 and cores() > 1:
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
        return self.at((start, shape, np.dtype(kind).str))

    def place(self, array: NDArray[Any]) -> Place | None:
        """Where an array lies; None where that is elsewhere."""
        start = array.ctypes.data - self._memory.ctypes.data
        inside = start >= 0 and start + array.nbytes <= len(self._memory)
        return (start, array.shape, array.dtype.str) if inside and array.flags.c_contiguous and array.nbytes else None

    def at(self, place: Place) -> NDArray[Any]:
        """The array of a place."""
        start, shape, kind = place
        return np.ndarray(shape, kind, self._memory, start)


NO_GROUND = Ground(0, 1)


def side_by_side(jobs: Sequence[Callable[[], T]], ground: Ground = NO_GROUND) -> list[T]:
    """What each job returns, in their order; what a job changes may be lost with its worker, but for the ground.

    Workers are for Linux, where a fork is safe and cheap, and not for processes that are workers themselves (a pool's,
    Dask's); elsewhere all is done here, one after the other. What a worker did not bring is done here too: an exception
    rises where it can be seen.
    """
    if not jobs:
        return []
    deck, end = os.pipe()
    try:
        # a pipe hands each number to one reader: who is done early takes more, and no lock is lost with a worker
        os.write(end, np.arange(1, min(len(jobs), MOST_DEALT), dtype=np.uint16).tobytes())
        os.close(end)
        workers = [_started(jobs, deck, ground) for _ in range(min(len(jobs), cores()) - 1)]
        try:
            done = {0: jobs[0](), **dict(_dealt(jobs, deck))}
            for worker in workers:
                done |= _received(worker, ground)
        finally:
            for process, _ in filter(None, workers):
                process.kill()
                process.join()
    finally:
        os.close(deck)
    return [done[k] if k in done else jobs[k]() for k in range(len(jobs))]


def _dealt(jobs: Sequence[Callable[[], T]], deck: int) -> Iterator[tuple[int, T]]:
    """Jobs that nobody has taken yet, done: their numbers and what they return."""
    while number := os.read(deck, np.dtype(np.uint16).itemsize):
        k = int(np.frombuffer(number, np.uint16)[0])
        yield k, jobs[k]()


def cores() -> int:
    """Processes that may work at the same time, this one among them."""
    if sys.platform != "linux" or multiprocessing.current_process().daemon:
        return 1
    return len(os.sched_getaffinity(0))


def _started(jobs: Sequence[Callable[[], Any]], deck: int, ground: Ground) -> tuple[ForkProcess, Connection] | None:
    """A worker, and where its results come from; None where the system has no room for one."""
    here, there = multiprocessing.get_context("fork").Pipe(duplex=False)
    process = forked(_work, (jobs, deck, ground, there))
    there.close()
    return (process, here) if process else None


def forked(target: Callable[..., None], arguments: tuple[Any, ...], daemon: bool = True) -> ForkProcess | None:
    """A fork of this process at work; None where the system has no room for one. A daemon may have none itself."""
    process = multiprocessing.get_context("fork").Process(target=target, args=arguments, daemon=daemon)
    with warnings.catch_warnings():
        # the threads that a library keeps are not forked: nothing of theirs is waited for in what workers do
        warnings.filterwarnings("ignore", ".*multi-threaded.*fork", DeprecationWarning)
        try:
            process.start()
        except OSError:
            return None
    return process


def _work(jobs: Sequence[Callable[[], Any]], deck: int, ground: Ground, results: Connection) -> None:
    with suppress(Exception):  # the parent meets it again, with all its handlers
        message = io.BytesIO()
        _Sender(message, ground).dump(dict(_dealt(jobs, deck)))
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


def _received(worker: tuple[ForkProcess, Connection] | None, ground: Ground) -> dict[int, Any]:
    """A worker's results by the jobs' numbers; none of one that failed or was lost."""
    if worker is None:
        return {}
    process, results = worker
    spent = -1
    try:
        while not results.poll(PATIENCE):
            before, spent = spent, _ticks(process.pid)
            if spent == before:
                return {}
        return dict(_Receiver(io.BytesIO(results.recv_bytes()), ground).load())
    except (EOFError, OSError):
        return {}


def _ticks(process: int | None) -> int:
    """Processor time that a process has used, in ticks of the system's clock."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
    return int(fields[11]) + int(fields[12])  # in user mode and in the kernel's
