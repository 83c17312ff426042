"""The run of a fleet: parts that are finished are taken up, the others made, and all of them compared."""

from __future__ import annotations

import json
import re
import signal
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from errormodel.files import append_csv, forget
from identification.fleets.collecting import collected, failures_of, tasks_of
from identification.fleets.comparison import compare
from identification.fleets.listing import Row, read_list
from identification.fleets.parts import (
    HOLDS,
    RECORD,
    Failure,
    Made,
    Options,
    Task,
    failed_rows,
    finished,
    folder_of,
    kept,
    seal_of,
)
from identification.results.fleet_result import FleetResult
from identification.results.folder_contents import FAILURES, PARTS
from identification.results.json_text import dumps
from identification.results.results_folder import ResultsFolder
from identification.runtime.engines import Crew, WorkerDiedError
from identification.runtime.parallel import parallel_map
from identification.runtime.progress import Steps

OFTEN_S = 5.0  # s between two words on how far it is
BY_MACHINE = ("monitor",)  # commands whose surveys of one machine depend on one another
AT_ONCE = 512  # parts that are looked at together, between two words on how far it is


def run_fleet(
    source: str | Path,
    folder: ResultsFolder,
    command: str,
    crew: Crew,
    work: Callable[[Task], Made | Failure],
    rate: float,
    standard: str,
    reports: bool,
    warn: Callable[[str], None],
    steps: Steps,
) -> FleetResult:
    """Run a command on all surveys of a list.

    Parameters
    ----------
    work : makes one part, in whatever process.
    rate : see `identification.fleets.comparison.compare`.
    warn : called with the first failure of each kind as it happens.

    Raises
    ------
    InputError
        The list is wrong, or the folder may not be written.
    KeyboardInterrupt
        With the number of the signal, and what is kept.
    """
    listing = read_list(source)
    folder.check()
    options = Options(standard=standard, reports=reports)
    tasks = tasks_of(listing, partial(Task, command, listing.base, options=options), command in BY_MACHINE)
    results: dict[int, dict[str, Any] | Failure] = {}
    with steps("Looking for finished parts") as far:
        for start in range(0, len(tasks), AT_ONCE):
            some = range(start, min(start + AT_ONCE, len(tasks)))
            jobs = [partial(finished, folder.path, tasks[k]) for k in some]
            found = zip(some, parallel_map(jobs), strict=True)
            results |= {k: record for k, record in found if record is not None}
            far(some.stop / len(tasks), "")
    taken = len(results)
    left = [k for k in range(len(tasks)) if k not in results]
    for k in left:  # a part that is there and was edited is refused before any work
        ResultsFolder(folder_of(folder.path, tasks[k]), HOLDS).check()
    if left:
        word = f"{command} on {len(left)} of {len(tasks)} parts{f', {taken} taken up' if taken else ''}"
        try:
            with steps(word) as far:
                _made(folder, crew, work, {k: tasks[k] for k in left}, results, warn, far)
        except KeyboardInterrupt as error:
            count = sum(
                (folder_of(folder.path, task) / RECORD).exists() for task in tasks
            )  # also of jobs not yet returned
            said = (
                f"{count} of {len(tasks)} parts are kept in {folder.path / PARTS}, and the same command goes on there"
            )
            failed = sum(len(failed_rows(tasks[k], r)) for k, r in results.items())
            said += f"; {failed} failed, named in {folder.path / PARTS / FAILURES}" if failed else ""
            raise KeyboardInterrupt(error.args[0] if error.args else signal.SIGINT, said) from error
    whole = collected(command, listing, tasks, results)
    with steps("Comparing machines"):
        return FleetResult(whole, compare(whole, rate), taken)


def _made(
    folder: ResultsFolder,
    crew: Crew,
    work: Callable[[Task], Made | Failure],
    tasks: dict[int, Task],
    results: dict[int, dict[str, Any] | Failure],
    warn: Callable[[str], None],
    far: Callable[[float, str], None],
) -> None:
    """Make parts, and put what came of each into `results`."""
    pace, kinds = _Pace(len(tasks), far), set[str]()
    numbers = list(tasks)
    failures = folder.path / PARTS / FAILURES
    forget(failures)  # those of a run that was stopped: its surveys are tried again
    for number, outcome in crew.each(work, list(tasks.values())):
        k = numbers[number]
        if isinstance(outcome, Made):
            kept(folder.path, tasks[k], outcome)
            read = json.loads(dumps(outcome.record))  # as it is when it is taken up
            results[k] = read | {"seal": seal_of(folder.path, tasks[k])}
        else:
            results[k] = _failure(outcome)
        failed = failed_rows(tasks[k], results[k])
        if failed:
            append_csv(failures_of(failed), failures)
            row, failure = failed[0]
            kind = _kind(failure.message, row)
            if kind not in kinds:
                warn(f"row {row.number}, {row.id}: {failure.message}")
            kinds.add(kind)
        pace.step(bool(failed))


def _failure(outcome: Failure | Exception) -> Failure:
    if isinstance(outcome, Failure):
        return outcome
    known = isinstance(outcome, WorkerDiedError)
    return Failure(str(outcome) if known else f"{type(outcome).__name__}: {outcome}", False)


def _kind(message: str, row: Row) -> str:
    """What a failure is, whatever file, row, column or cell."""
    for name in (row.survey, row.machine):
        message = message.replace(name, "")
    where, _, found = message.partition(": ")
    return re.sub(r"'[^']*'|\d+", "", (found or where).partition(". ")[0])


class _Pace:
    """How far it is, and how long it will take."""

    def __init__(self, count: int, far: Callable[[float, str], None]) -> None:
        self.count, self.far = count, far
        self.done = self.failed = 0
        self.begun = self.said = time.monotonic()

    def step(self, failed: bool) -> None:
        self.done += 1
        self.failed += failed
        now = time.monotonic()
        remark = ""
        if now - self.said >= OFTEN_S or self.done == self.count:
            self.said = now
            left = (now - self.begun) / self.done * (self.count - self.done)
            remark = f"{self.done} of {self.count}{f', {self.failed} failed' if self.failed else ''}"
            remark += f", {_spoken(left)} left" if left else ""
        self.far(self.done / self.count, remark)


def _spoken(seconds: float) -> str:
    if seconds < 90:
        return f"about {seconds:.0f} s"
    return f"about {seconds / 60:.0f} min" if seconds < 5400 else f"about {seconds / 3600:.1f} h"
