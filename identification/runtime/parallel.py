"""Independent jobs run on all cores: the one place that knows how.

Threads suffice: the jobs spend their time in NumPy and LAPACK, which release the interpreter's lock, and share their
arrays without copies. They work alike on Linux, macOS and Windows. Any other executor of the standard interface may
take their place, Dask's ``client.get_executor()`` among them, where jobs and results can be pickled.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from typing import TypeVar

T = TypeVar("T")
_one_core: ContextVar[bool] = ContextVar("one_core", default=False)


@contextmanager
def one_core() -> Iterator[None]:
    """Run jobs, and the threads of BLAS, on one core within the block: the others have work of their own."""
    from threadpoolctl import threadpool_limits

    token = _one_core.set(True)
    try:
        with threadpool_limits(1):
            yield
    finally:
        _one_core.reset(token)


def parallel_map(jobs: Sequence[Callable[[], T]], executor: Executor | None = None) -> list[T]:
    """Call each job and return the results in the order of the jobs.

    What a job returns must not depend on which jobs run beside it: then results are the same on any number of cores.

    Parameters
    ----------
    jobs : functions without arguments.
    executor : where they run; threads of this process, one a core, where none is given.

    Raises
    ------
    Exception
        What the first of the jobs that failed raised, by the order of `jobs`; those that have not begun are cancelled.
    """
    if executor is not None:
        return list(executor.map(_call, jobs))
    workers = 1 if _one_core.get() else min(len(jobs), os.cpu_count() or 1)
    if workers < 2:
        return [job() for job in jobs]
    # NumPy's error state is the caller's: it is part of the context
    bound = [(copy_context(), job) for job in jobs]
    with ThreadPoolExecutor(workers) as threads:
        return list(threads.map(lambda pair: pair[0].run(pair[1]), bound))


def _call(job: Callable[[], T]) -> T:
    return job()
