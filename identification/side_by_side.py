"""Independent jobs on all cores: each worker is a fork of this process, so that only the results travel."""

from __future__ import annotations

import multiprocessing
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, TypeVar

T = TypeVar("T")

PATIENCE = 60.0  # s: a worker that is silent for longer after all else is done has been lost


def side_by_side(jobs: Sequence[Callable[[], T]]) -> list[T]:
    """What each job returns, in their order; what a job changes may be lost with its worker.

    Workers are for Linux, where a fork is safe and cheap, and not for processes that are workers themselves (a pool's,
    Dask's); elsewhere all is done here, one after the other. What a worker did not bring is done here too: an exception
    rises where it can be seen.
    """
    count = max(min(len(jobs), _cores()), 1)
    shares = [jobs[k::count] for k in range(count)]
    workers = [_started(share) for share in shares[1:]]
    brought = [[job() for job in shares[0]], *map(_received, workers)]
    parts = [done or [job() for job in share] for done, share in zip(brought, shares, strict=True)]
    return [parts[k % count][k // count] for k in range(len(jobs))]


def _cores() -> int:
    if sys.platform != "linux" or multiprocessing.current_process().daemon:
        return 1
    return len(os.sched_getaffinity(0))


def _started(jobs: Sequence[Callable[[], Any]]) -> tuple[Any, Connection] | None:
    """A worker, and where its results come from; None where the system has no room for one."""
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(jobs, there), daemon=True)
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


def _work(jobs: Sequence[Callable[[], Any]], results: Connection) -> None:
    with suppress(Exception):  # the parent meets it again, with all its handlers
        results.send([job() for job in jobs])


def _received(worker: tuple[Any, Connection] | None) -> list[Any]:
    """A worker's results; none of one that failed or was lost."""
    if worker is None:
        return []
    process, results = worker
    try:
        return list(results.recv()) if results.poll(PATIENCE) else []
    except (EOFError, OSError):
        return []
    finally:
        process.kill()
        process.join()
