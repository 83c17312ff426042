"""Parts of a fleet: one piece of work each, whose results are a folder that its manifest seals.

A part that was finished is taken up again when its files are as they were written, and what it was made from is as it
was: the same bytes read, the same command, options and version.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from errormodel import __version__
from errormodel.exceptions import ErrorModelError, InputError
from errormodel.files import sha256, write_bytes_atomic
from errormodel.formats import SUFFIXES
from errormodel.inputs import Run, running
from identification.fleets.listing import Row, name_part
from identification.fleets.places import Base, fetched
from identification.results import manifest
from identification.results.folder_contents import PARTS
from identification.results.json_text import dumps
from identification.results.results_folder import ResultsFolder
from identification.results.versions import read_json

RECORD, SCHEMA = "part.json", "errormodel.fleet-part/1"
HOLDS = "part"
CURE = "Remove the folder; it is made anew"


@dataclass(frozen=True)
class Options:
    """What a command of a fleet is given beside machine and survey."""

    standard: str = "all"  # of `iso`
    rate: float = 0.01  # false alarms a cycle, of `monitor`
    reports: bool = False  # whether each part has a report


@dataclass(frozen=True)
class Task:
    """One part: a command on a machine and one survey, or on a machine and all its cycles.

    Attributes
    ----------
    rows : of the list, in the order of the cycles.
    """

    command: str
    base: Base
    rows: tuple[Row, ...]
    options: Options

    @property
    def machine(self) -> str:
        return self.rows[0].machine

    @property
    def key(self) -> str:
        """Its folder below that of all parts: labels may change, what it is made from may not."""
        made_from = [self.command, asdict(self.options), self.rows[0].id, self.machine, [r.survey for r in self.rows]]
        digest = hashlib.sha256(json.dumps(made_from).encode()).hexdigest()[:8]
        survey = self.rows[0].survey.rstrip("/").rpartition("/")[2]
        return f"{name_part(self.rows[0].id)}/{name_part(survey.partition('.')[0])}-{digest}"


@dataclass(frozen=True)
class Source:
    """A file that was read: of the machine (-1) or of a survey (its number), its path from there, and its digest."""

    of: int
    path: str
    sha256: str


@dataclass(frozen=True)
class Made:
    """What a worker hands back: the files of the part, what it read, and the record for the whole fleet."""

    files: Mapping[str, bytes]
    sources: tuple[Source, ...]
    record: dict[str, Any]


@dataclass(frozen=True)
class Failure:
    """Why a part could not be made; `wrong_input` unless it is a mistake of the program or of the computer."""

    message: str
    wrong_input: bool = True


@dataclass
class Opened:
    """Inputs of a task on this computer, for the time of a block."""

    task: Task
    machine: str | Path = ""
    surveys: list[Path] = field(default_factory=list)
    stack: ExitStack = field(default_factory=ExitStack)

    def __enter__(self) -> Opened:
        task = self.task
        try:
            self.machine = self._machine()
            self.surveys = [self.stack.enter_context(fetched(task.base, r.survey, with_folder=True)) for r in task.rows]
        except BaseException:
            self.stack.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stack.close()

    def _machine(self) -> str | Path:
        from errormodel import library

        local = Path(self.task.base.place(self.task.machine))
        if not local.exists() and self.task.machine in library():
            return self.task.machine
        return self.stack.enter_context(fetched(self.task.base, self.task.machine))

    def folder(self, of: int) -> Path:
        """Folder that the paths of files of the machine (-1) or of a survey are relative to."""
        from errormodel import library

        place = self.machine if of < 0 else self.surveys[of]
        path = library()[place] if isinstance(place, str) else place
        return path if path.is_dir() else path.parent

    def sources(self, inputs: Mapping[Path, str]) -> tuple[Source, ...]:
        """What was read, relative to the inputs: a file belongs to the deepest of them that it lies in."""
        roots = [(of, self.folder(of).resolve()) for of in range(-1, len(self.surveys))]

        def of(path: Path) -> tuple[int, Path]:
            inside = [(len(root.parts), -number, number, root) for number, root in roots if path.is_relative_to(root)]
            return max(inside)[2:] if inside else roots[-1]

        found = []
        for path, digest in inputs.items():
            number, root = of(path)
            found.append(Source(number, Path(os.path.relpath(path, root)).as_posix(), digest))
        return tuple(sorted(found, key=lambda s: (s.of, s.path)))

    def listed(self) -> list[list[str]]:
        """Tables in each survey that is a folder: one more is another survey."""
        out = []
        for path in self.surveys:
            names = [p.name for p in path.iterdir()] if path.is_dir() else []
            out.append(sorted(n for n in names if Path(n).suffix.lower() in SUFFIXES and n[:1] not in "._"))
        return out

    def plain(self, message: str) -> str:
        """A message with the entries of the list in place of where they were on this computer."""
        for entry, path in [(self.task.machine, self.machine), *zip(self._entries, self.surveys, strict=False)]:
            if isinstance(path, Path):
                message = message.replace(str(path), entry)
        return message

    @property
    def _entries(self) -> list[str]:
        return [r.survey for r in self.task.rows]


def folder_of(out: Path, task: Task) -> Path:
    """Folder of a part below that of the fleet."""
    return out / PARTS / task.key


def seal_of(out: Path, task: Task) -> str:
    """SHA-256 of a part's manifest, which has the digests of all its files and of what they were made from."""
    return sha256(folder_of(out, task) / manifest.NAME)


def finished(out: Path, task: Task) -> dict[str, Any] | None:
    """The record of a part that is there, whole, and made from what is there now; None where it has to be made."""
    folder = folder_of(out, task)
    try:
        made = manifest.read(folder)
        if made is None or made.version != __version__:
            return None
        manifest.check_complete(folder, made)
        with running(None):
            record = read_json(folder / RECORD, SCHEMA, CURE)
        if failed_rows(task, record):
            return None  # they are tried again
        with Opened(task) as opened:
            now = [sha256(opened.folder(int(s["of"])) / s["path"]) == s["sha256"] for s in record["sources"]]
            same = all(now) and record["tables"] == opened.listed()
    except (ErrorModelError, OSError, ValueError, KeyError, TypeError, IndexError):
        return None  # whatever is wrong with it, it is made anew
    return record | {"seal": seal_of(out, task)} if same else None


def kept(out: Path, task: Task, made: Made) -> None:
    """Write a part, whole or not at all."""
    inputs = {Path(f"{s.of}/{s.path}"): s.sha256 for s in made.sources}
    folder = ResultsFolder(folder_of(out, task), HOLDS)
    with (
        running(Run("fleet", None, {"command": task.command} | asdict(task.options), (), inputs)),
        folder.replaced() as part,
    ):
        for name, data in made.files.items():
            write_bytes_atomic(data, part / name)
        write_bytes_atomic(dumps(made.record).encode(), part / RECORD)


def record_of(
    task: Task, opened: Opened, sources: Sequence[Source], surveys: list[dict[str, Any]], kind: str
) -> dict[str, Any]:
    """Record of a part.

    Parameters
    ----------
    surveys : one entry a survey (see `identification.fleets.collecting`).
    kind : name of the machine in its file, which is its type where the list names none.
    """
    return {
        "schema": SCHEMA,
        "version": __version__,
        "command": task.command,
        "machine": kind,
        "sources": [asdict(s) for s in sources],
        "tables": opened.listed(),
        "surveys": surveys,
    }


def failed_rows(task: Task, result: Mapping[str, Any] | Failure) -> list[tuple[Row, Failure]]:
    """Surveys of a part that failed: all where it could not be made, else those that its record says."""
    if isinstance(result, Failure):
        return [(row, result) for row in task.rows]
    both = zip(task.rows, result["surveys"], strict=True)
    return [(row, Failure(**survey["failure"])) for row, survey in both if "failure" in survey]


def failure_of(opened: Opened | None, error: Exception) -> Failure:
    """Why a part failed, in words."""
    known = isinstance(error, ErrorModelError)
    text = str(error) if known else f"{type(error).__name__}: {error}"
    return Failure(text if opened is None else opened.plain(text), isinstance(error, InputError))
