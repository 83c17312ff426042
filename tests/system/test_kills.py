"""A killed command leaves the old results or the new ones, touches nothing else, and the next run works.

A few points of three kinds of output; `python -m tests.benchmarks.kills 200` kills every command that writes at many.
"""

from __future__ import annotations

import os
import re
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from errormodel import files
from errormodel.files import clear_parts, replacing
from identification.monitoring.history import History
from identification.results.output_file import OutputFile
from tests.helpers.commands import FIVE, MILL, Fill, done, run, tree, write

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="forks with threads")
def test_results_are_the_old_or_the_new_ones() -> None:
    """In a process of its own, since what others computed in threads cannot be forked."""
    command = [sys.executable, "-m", "tests.benchmarks.kills", "4", "predict", "fit", "monitor"]
    alone = {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, env=os.environ | alone)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count(" 0 with a fault;") == 3


def test_what_killed_processes_left_of_a_file_goes_with_the_next(tmp_path: Path) -> None:
    left = (".p.77.part.csv", "..p.77.part.77.part.csv", "..errormodel.77.part.sha256")
    stays = (".p.77.part.txt", ".other.77.part.csv", ".p.part.csv", "p.77.part.csv", ".pp.77.part.csv")
    for name in (*left, *stays):
        write(tmp_path / name, "x")
    OutputFile(tmp_path / "p.csv").write_text("a\n")
    assert {p.name for p in tmp_path.iterdir()} == {"p.csv", ".errormodel.sha256", *stays}


def test_a_part_that_is_being_written_is_known(tmp_path: Path) -> None:
    """The names that are removed are those under which files are written, in parts of parts too."""
    for suffix in (".csv", ""):
        target = tmp_path / f"name{suffix}"
        with replacing(target) as part, replacing(part) as inner:
            for path in (part, inner):
                write(path, "x")
            clear_parts(target)
            assert not part.exists()
            assert not inner.exists()
            for path in (part, inner):
                write(path, "x")


FULL, HELD = OSError(28, "No space left on device"), PermissionError(13, "Access is denied")
AWAY = re.compile(r"part\.part").search  # an old file, which is put back
FAILING = {
    "disk": (files, "flush", lambda path: re.search("html|svg", path.suffix), FULL),
    "place": (os, "replace", lambda part, to: to.name[0] != "." and to.suffix == ".json" and not AWAY(part.name), HELD),
    "history": (History, "commit", lambda _: True, sqlite3.OperationalError("database or disk is full")),
}


@pytest.fixture(scope="module")
def watched(with_mill: Fill, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fit with one cycle and its pages, and the survey of another."""
    folder = with_mill(tmp_path_factory.mktemp("watched"))
    done("monitor", folder / "fit", folder / "s.csv")
    done("simulate", MILL, 60, "--noise", 0.002, "--seed", 2, "--out", folder / "next.csv")
    done("describe", MILL, "--json", folder / "d.json", "--drawing", folder / "d.svg")
    return folder


@pytest.mark.long
@pytest.mark.parametrize(
    ("words", "what"),
    [*((("monitor", "fit", "next.csv"), what) for what in FAILING)]
    + [(("describe", FIVE, "--json", "d.json", "--drawing", "d.svg"), what) for what in ("disk", "place")],
    ids=lambda given: given if isinstance(given, str) else given[0],
)
def test_files_of_one_command_stay_of_one_run(
    words: tuple[str, ...], what: str, watched: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever fails: all are as they were, and the next run replaces all."""
    folder = shutil.copytree(watched, tmp_path / "w")
    monkeypatch.chdir(folder)
    before, (place, name, fails, error) = contents(folder), FAILING[what]
    function: Callable[..., object] = getattr(place, name)

    def call(*arguments: object) -> object:
        if fails(*arguments):  # type: ignore[no-untyped-call]
            raise error
        return function(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(place, name, call)
        assert run(*words).code == 2
    stored = words[0] == "monitor" and what == "place"  # only its pages could not be put in place
    changed = {"fit/monitor.sqlite"} if stored else set()
    assert differing(contents(folder), before) == changed
    assert ("which the history has already" in done(*words).out) == stored
    own = {"fit/monitor.sqlite", "fit/monitor.json", "fit/monitor.html"} if words[0] == "monitor" else {*words[3::2]}
    assert differing(contents(folder), before) == own
    done(*words)


def contents(folder: Path) -> dict[str, bytes]:
    """Files by name, without the records of what was written."""
    return {name: content for name, content in tree(folder).items() if not name.endswith(".sha256")}


def differing(one: dict[str, bytes], other: dict[str, bytes]) -> set[str]:
    return {name for name in {*one, *other} if one.get(name) != other.get(name)}
