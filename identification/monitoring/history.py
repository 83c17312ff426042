"""History of a monitored machine in an SQLite file, shared by several processes and safe against a crash.

SQLite is part of Python's standard library, locks across processes and commits a cycle whole or not at all.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from errormodel.exceptions import ErrorModelError, InputError
from errormodel.files import clear_parts, locked, replacing
from identification.monitoring.quantities import Cycle

SCHEMA = "errormodel.monitor/1"
LOCK_TIMEOUT_S = 60.0  # s to wait for another run; by judgement
CURE = "Move it away to begin a new history, or put a copy of it back"
# SQL: key-value pairs about the model, and one row per cycle
HISTORY_TABLES = """
create table about (key text primary key, value text not null) strict;
create table cycles (
  number integer primary key, digest text not null unique, source text not null, added text not null,
  status text not null, accepted integer not null, flagged text not null,
  estimates blob not null, covariance blob not null) strict;
"""


@dataclass(frozen=True)
class Record:
    """One cycle of the history.

    Attributes
    ----------
    number : from 1, in the order of storage.
    digest : SHA-256 of its rows; `source` : file of the survey.
    status : "learning", "normal" or "alarm".
    accepted : whether the user took it into the normal range in spite of an alarm.
    flagged : ids of the quantities in alarm.
    cycle : its values and covariance.
    """

    number: int
    digest: str
    source: str
    status: str
    accepted: bool
    flagged: tuple[str, ...]
    cycle: Cycle

    @property
    def normal(self) -> bool:
        return self.status != "alarm" or self.accepted


class History:
    """Cycles of one model in order, while the file is locked."""

    def __init__(self, connection: sqlite3.Connection, path: Path) -> None:
        self.connection, self.path = connection, path
        self.records = [
            self._record(row) for row in connection.execute(f"select {CYCLE_COLUMNS} from cycles order by number")
        ]

    def _record(self, row: tuple[Any, ...]) -> Record:
        number, digest, source, status, accepted, flagged, estimates, covariance = row
        values = np.frombuffer(estimates)
        shape = (len(values), len(values))
        cycle = Cycle(values, np.frombuffer(covariance).reshape(shape))
        return Record(number, digest, source, status, bool(accepted), tuple(json.loads(flagged)), cycle)

    def find(self, digest: str) -> Record | None:
        return next((r for r in self.records if r.digest == digest), None)

    def add(self, record: Record) -> Record:
        """Store a cycle under the next number."""
        record = replace(record, number=1 + max((r.number for r in self.records), default=0))
        row = (record.number, record.digest, record.source, record.status, int(record.accepted))
        numbers = (record.cycle.values.tobytes(), record.cycle.covariance.tobytes())
        self.connection.execute(
            f"insert into cycles ({CYCLE_COLUMNS}, added) values (?, ?, ?, ?, ?, ?, ?, ?, datetime())",
            (*row, json.dumps(record.flagged), *numbers),
        )
        self.records.append(record)
        return record

    def commit(self) -> None:
        """Keep what was added and accepted, whatever happens afterwards."""
        self.connection.execute("commit")

    def accept(self, record: Record) -> Record:
        """Take a cycle that raised an alarm into the normal range."""
        self.connection.execute("update cycles set accepted = 1 where number = ?", (record.number,))
        new = replace(record, accepted=True)
        self.records[self.records.index(record)] = new
        return new


# columns in the order of `Record`
CYCLE_COLUMNS = "number, digest, source, status, accepted, flagged, estimates, covariance"


@contextmanager
def opened(path: Path, model: str) -> Iterator[History]:
    """Open and lock the history at `path`, created if missing; what the block does not commit is not kept.

    Raises
    ------
    InputError
        The file is not a history, is empty or damaged, or was learned with another `model`.
    ErrorModelError
        Another run has held it for a minute.
    """
    try:
        if not path.exists():
            _begin(path, model)
        with closing(sqlite3.connect(path, timeout=LOCK_TIMEOUT_S, isolation_level=None)) as connection:
            connection.execute("begin immediate")
            try:
                _check(connection, path, model)
                history = History(connection, path)
            except (ValueError, KeyError, TypeError) as error:
                raise InputError(str(path), f"it cannot be read as a history ({error})", CURE) from error
            yield history
    except sqlite3.OperationalError as error:
        if "locked" in str(error):
            raise ErrorModelError(
                f"{path}: another run has held the history for {LOCK_TIMEOUT_S:.0f} s. Try again"
            ) from error
        found = f"it cannot be opened or written to ({error})"
        raise InputError(str(path), found, "Give a folder that can be written to, with space on its disk") from error
    except sqlite3.DatabaseError as error:
        raise InputError(str(path), f"it is damaged, or no history ({error})", CURE) from error


def _begin(path: Path, model: str) -> None:
    """Make a history without cycles, whole or not at all: an empty file is then never one that has just begun."""
    with locked(path.parent):
        if path.exists():  # another run has made it
            return
        clear_parts(path)
        with replacing(path) as part, closing(sqlite3.connect(part, isolation_level=None)) as connection:
            connection.execute("pragma journal_mode = off")  # no second file beside one that nobody knows
            connection.executescript(HISTORY_TABLES)
            connection.executemany("insert into about values (?, ?)", _about(model).items())


def _about(model: str) -> dict[str, str]:
    return {"schema": SCHEMA, "model": model}


def _check(connection: sqlite3.Connection, path: Path, model: str) -> None:
    sound = connection.execute("pragma integrity_check(1)").fetchone()[0]
    if sound != "ok":
        raise InputError(str(path), f"it is damaged ({sound})", CURE)
    tables = {name for (name,) in connection.execute("select name from sqlite_master where type = 'table'")}
    if missing := [name for name in ("about", "cycles") if name not in tables]:
        found = f"it has no table {' and no table '.join(missing)}" if path.stat().st_size else "it is an empty file"
        raise InputError(str(path), f"{found}: the cycles that were learned are not in it", CURE)
    about = dict(connection.execute("select key, value from about"))
    for key, value in _about(model).items():
        if about.get(key) != value:
            other = "another model than the fit in this folder" if key == "model" else f"the schema {about.get(key)!r}"
            found = f"its normal range was learned with {other}"
            raise InputError(str(path), found, "Move it away to begin a new history, or monitor the fit it belongs to")
