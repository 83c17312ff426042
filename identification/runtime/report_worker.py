"""A second process that loads what a command needs at its end while the command is still at its beginning.

Where a fork is not safe or there is no core for it, the command does all itself.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from identification.runtime.process_pool import cores, forked

if TYPE_CHECKING:
    from multiprocessing.context import ForkProcess


class Ahead:
    """A context: loads at once, then does one job beside the command, and ends with it.

    A job has a result and no other effect, so that it may be given up at any time.
    """

    def __init__(self, load: Callable[[], object]) -> None:
        self._process: ForkProcess | None = None
        self._job: Callable[[], Any] | None = None
        self._sent = False
        self._line, there = multiprocessing.Pipe()
        if cores() > 1:
            self._process = forked(_serve, (load, self._line, there), daemon=False)
        there.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._line.close()
        if self._process is not None:
            self._process.kill()
            self._process.join()

    def begin(self, job: Callable[[], Any], there: bool = True) -> None:
        """Start a job, `there` or at the `finish` here."""
        self._job, self._sent = job, False
        if self._process is not None and there:
            # whatever a job is made of may refuse to travel: it is done here then
            with suppress(Exception):
                self._line.send_bytes(pickle.dumps(job, pickle.HIGHEST_PROTOCOL))
                self._sent = True

    def finish(self) -> Any:
        """The job's result; what was not done there is done here: an exception rises where it can be seen."""
        assert self._job is not None
        if self._sent:
            with suppress(EOFError, OSError):
                return self._line.recv()
        return self._job()


def _serve(load: Callable[[], object], there: Connection, here: Connection) -> None:
    there.close()  # the command's end: when the command is gone, so is this process
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        load()
        while True:
            job: Callable[[], Any] = pickle.loads(here.recv_bytes())
            here.send(job())
    except BaseException:  # noqa: BLE001  the command notices that nothing came, and meets the error itself
        os._exit(1)
