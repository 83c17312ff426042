"""Many independent jobs on several processes or computers; a job that fails, or kills its worker, stops no other.

Results come as they are ready. What a job returns must depend on the job alone: then the results are the same for every
engine and number of workers.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, suppress
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

from errormodel import __version__
from errormodel.exceptions import ErrorModelError, InputError

Engine = Literal["local", "dask"]
ENGINES: tuple[Engine, ...] = ("local", "dask")
AHEAD = 2  # jobs handed out for each worker: the next is there when one ends, and few are lost when a worker dies
MOST_DEATHS = 2  # workers that a job may kill when it runs alone, before it counts as failed
# s without any worker after which Dask's jobs fail: a worker that does not start in time is not started again
NO_WORKER_S = 300.0
CONNECT_S = 20.0  # s to wait for a scheduler; by judgement

Job = TypeVar("Job")
T = TypeVar("T")


class WorkerDiedError(ErrorModelError):
    """A job whose worker died each time."""


@dataclass(frozen=True)
class Crew:
    """Who works.

    Attributes
    ----------
    engine : "local": processes of this computer; "dask": Dask distributed.
    workers : how many; with "local" and 1, this process itself. None: one a core.
    scheduler : address of a Dask scheduler that is there; None: a cluster on this computer.
    announce : called with a sentence for the user, such as the address of the dashboard.
    """

    engine: Engine = "local"
    workers: int | None = None
    scheduler: str | None = None
    announce: Callable[[str], None] = lambda _text: None

    def check(self) -> None:
        """Check the choice before any work.

        Raises
        ------
        InputError
            The engine is not known or not installed, or an option is of another engine.
        """
        if self.engine not in ENGINES:
            raise InputError("--engine", f"'{self.engine}'", f"Write one of {', '.join(ENGINES)}")
        if self.workers is not None and self.workers < 1:
            raise InputError("--workers", str(self.workers), "Write 1 or more")
        if self.scheduler is not None and self.engine != "dask":
            raise InputError("--scheduler", "an address without --engine dask", "Write --engine dask")
        if self.scheduler is not None and self.workers is not None:
            found = "a number of workers for a cluster that has its own"
            raise InputError("--workers", found, "Leave out --workers or --scheduler")
        if self.engine == "dask":
            _distributed()

    @property
    def count(self) -> int:
        return self.workers or os.cpu_count() or 1

    def each(self, function: Callable[[Job], T], jobs: Sequence[Job]) -> Iterator[tuple[int, T | Exception]]:
        """Number and result of each job as it is ready, in any order; an exception where it failed.

        Parameters
        ----------
        function : of a module, so that other processes find it by its name.
        jobs : can be pickled.
        """
        if self.engine == "dask":
            return self._on_dask(function, jobs)
        if self.count == 1:
            return ((k, _tried(function, job)) for k, job in enumerate(jobs))
        return _on_processes(function, jobs, min(self.count, max(len(jobs), 1)))

    def _on_dask(self, function: Callable[[Job], T], jobs: Sequence[Job]) -> Iterator[tuple[int, T | Exception]]:
        distributed = _distributed()
        with closing(self._client(distributed)) as client:
            self.announce(f"Dask dashboard: {client.dashboard_link}")
            waiting, suspects = deque(range(len(jobs))), deque[int]()
            ready = distributed.as_completed()
            numbers: dict[Any, int] = {}

            def submit(k: int, key: str) -> None:
                future = client.submit(function, jobs[k], key=key, pure=False)
                numbers[future] = k
                ready.add(future)

            def hand_out() -> None:
                most = AHEAD * max(sum(client.nthreads().values()), 1)
                while waiting and len(numbers) < most:
                    k = waiting.popleft()
                    submit(k, f"errormodel-{k}")
                # Dask counts a death for all jobs that the worker held: each runs again alone, when nothing else does
                if suspects and not numbers:
                    k = suspects.popleft()
                    submit(k, f"errormodel-{k}-alone")

            hand_out()
            for future in ready:
                k = numbers.pop(future)
                lost = distributed.scheduler.KilledWorker, CancelledError  # its worker died before or after its end
                try:
                    done: T | Exception = future.result()
                except distributed.scheduler.NoWorkerError:
                    yield k, WorkerDiedError(f"no worker of Dask has started for {NO_WORKER_S:g} s")
                except lost:
                    if future.key.endswith("-alone"):
                        yield k, _died()
                    else:
                        suspects.append(k)
                except Exception as error:  # noqa: BLE001  a failure of one job is its result
                    yield k, error
                else:
                    yield k, done
                future.release()
                hand_out()

    def _client(self, distributed: Any) -> Any:
        import dask

        rules = {"allowed-failures": MOST_DEATHS - 1, "no-workers-timeout": f"{NO_WORKER_S:g}s"}
        with dask.config.set({f"distributed.scheduler.{k}": v for k, v in rules.items()}):
            if self.scheduler is None:
                cluster = distributed.LocalCluster(
                    n_workers=self.count, threads_per_worker=1, dashboard_address=":0", silence_logs=50
                )
                return _Own(distributed.Client(cluster), cluster)
        try:
            client = distributed.Client(self.scheduler, timeout=CONNECT_S)
        except (OSError, ValueError) as error:
            cure = "Start one (dask scheduler), and give the address that it prints"
            raise InputError(f"--scheduler {self.scheduler}", "no Dask scheduler answers there", cure) from error
        try:
            others = set(client.run(_version, on_error="return").values()) - {__version__}
        except Exception:
            client.close()
            raise
        if others:
            client.close()
            found = f"a worker has {sorted(map(str, others))[0]}, and this is errormodel {__version__}"
            raise InputError(f"--scheduler {self.scheduler}", found, "Install the same version on all of them")
        return client


class _Own:
    """A client of a cluster that ends with it."""

    def __init__(self, client: Any, cluster: Any) -> None:
        self._client, self._cluster = client, cluster

    def __getattr__(self, name: str) -> Any:
        return getattr(self._client, name)

    def close(self) -> None:
        self._client.close()
        self._cluster.close()


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise InputError(
            "--engine dask", "Dask is not installed", "Install it (pip install 'errormodel[fleet]'), or use local"
        ) from error
    return distributed


def _version() -> str:
    return __version__


def _tried(function: Callable[[Job], T], job: Job) -> T | Exception:
    try:
        return function(job)
    except Exception as error:  # noqa: BLE001  a failure of one job is its result
        return error


def _died() -> WorkerDiedError:
    return WorkerDiedError("its worker died each time: most likely it needs more memory than there is")


def _on_processes(
    function: Callable[[Job], T], jobs: Sequence[Job], workers: int
) -> Iterator[tuple[int, T | Exception]]:
    """Jobs on processes; those under way when one dies are run again one at a time, so that the guilty one is known."""
    waiting, suspects = deque(range(len(jobs))), deque[int]()
    deaths: Counter[int] = Counter()
    while waiting or suspects:
        alone = bool(suspects)
        queue, most = (suspects, 1) if alone else (waiting, AHEAD * workers)
        running: dict[Future[T], int] = {}
        with closing(_Pool(1 if alone else min(workers, len(queue)))) as pool:
            try:
                while queue or running:
                    while queue and len(running) < most:
                        running[pool.submit(function, jobs[queue[0]])] = queue[0]
                        queue.popleft()
                    ready, _ = wait(running, return_when=FIRST_COMPLETED)
                    for future in ready:
                        error = future.exception()
                        if isinstance(error, BrokenProcessPool):
                            raise error
                        k = running.pop(future)
                        yield k, error if isinstance(error, Exception) else future.result()
            except BrokenProcessPool:
                for k in sorted(running.values()):
                    deaths[k] += alone
                    if deaths[k] < MOST_DEATHS:
                        suspects.append(k)
                    else:
                        yield k, _died()


class _Pool:
    """Processes that are started anew, as on every system, and end with this one however it ends."""

    def __init__(self, workers: int) -> None:
        self._others = set(multiprocessing.active_children())
        # spawned: a process that is forked from one with threads may hang
        context = multiprocessing.get_context("spawn")
        self._executor = ProcessPoolExecutor(workers, context, initializer=_begin)

    def submit(self, function: Callable[[Job], T], job: Job) -> Future[T]:
        return self._executor.submit(function, job)

    def close(self) -> None:
        """End all of them; what they were at is lost."""
        self._executor.shutdown(wait=False, cancel_futures=True)
        for child in set(multiprocessing.active_children()) - self._others:
            child.terminate()
        self._executor.shutdown(wait=True)


def _begin() -> None:
    """The start of a worker: Ctrl-C and a closed terminal are the parent's, and the worker does not outlive it."""
    for name in ("SIGINT", "SIGHUP"):  # Windows lacks the second
        with suppress(ValueError, AttributeError):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:

        def follow() -> None:
            parent.join()
            os._exit(1)

        threading.Thread(target=follow, daemon=True).start()
