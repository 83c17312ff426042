"""Independent jobs on all cores: each worker is a fork of this process, so that only the results travel."""

from __future__ import annotations

import multiprocessing
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, TypeVar

T = TypeVar("T")

PATIENCE = 60.0  # s: a worker that is silent for longer after all else is done has been lost


def side_by_side(jobs: Sequence[Callable[[], T]]) -> list[T]:
    """What each job returns, in their order; what a job changes may be lost with its worker.

    Workers are for Linux, where a fork is safe and cheap; elsewhere all is done here, one after the other. What a
    worker did not bring is done here too: an exception rises where it can be seen.
    """
    done: dict[int, T] = {}
    helpers = min(len(jobs), _cores()) - 1 if sys.platform == "linux" else 0
    if helpers > 0:
        context = multiprocessing.get_context("fork")
        following = context.Value("i", 0)
        with warnings.catch_warnings():
            # the threads that a library keeps are not forked: nothing of theirs is waited for in what workers do
            warnings.filterwarnings("ignore", ".*multi-threaded.*fork", DeprecationWarning)
            workers = [_started(context, jobs, following) for _ in range(helpers)]
        for k in _taken(following, len(jobs)):
            done[k] = jobs[k]()
        for process, results in workers:
            done |= _received(results)
            process.kill()
            process.join()
    return [done[k] if k in done else job() for k, job in enumerate(jobs)]


def _cores() -> int:
    return len(os.sched_getaffinity(0))


def _started(context: Any, jobs: Sequence[Callable[[], T]], following: Any) -> tuple[Any, Connection]:
    """A worker, and where its results come from."""
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(jobs, following, there), daemon=True)
    process.start()
    there.close()
    return process, here


def _work(jobs: Sequence[Callable[[], T]], following: Any, results: Connection) -> None:
    done: dict[int, T] = {}
    with suppress(Exception):  # the parent meets it again, with all its handlers
        for k in _taken(following, len(jobs)):
            done[k] = jobs[k]()
    with suppress(Exception):
        results.send(done)


def _taken(following: Any, count: int) -> Iterator[int]:
    """Numbers of jobs that no other worker has taken."""
    while True:
        with following.get_lock():
            k = following.value
            following.value += 1
        if k >= count:
            return
        yield k


def _received(results: Connection) -> dict[int, Any]:
    try:
        return dict(results.recv()) if results.poll(PATIENCE) else {}
    except (EOFError, OSError):
        return {}
