"""A process that loads ahead: its job is done once, there or here, and errors rise here."""

from __future__ import annotations

import multiprocessing
import os
from functools import partial
from pathlib import Path

import pytest

from identification.runtime import report_worker as module
from identification.runtime.process_pool import cores
from identification.runtime.report_worker import Ahead
from tests.commands import done, tree

GANTRY = Path(__file__).parents[1] / "machines/examples/gantry"


def note(path: Path) -> int:
    with path.open("a") as file:
        file.write("done\n")
    return os.getpid()


def fail(path: Path) -> None:
    note(path)
    raise ValueError("the job says why")


def nothing() -> None:
    pass


def lost() -> None:
    raise OSError


@pytest.fixture(params=[1, 2])
def of_cores(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    if cores() > 1:  # where there is one, or no fork, there is nothing to choose from
        monkeypatch.setattr(module, "cores", lambda: request.param)
    return int(module.cores())


def test_a_job_is_done_once_and_elsewhere(tmp_path: Path, of_cores: int) -> None:
    with Ahead(nothing) as elsewhere:
        elsewhere.begin(partial(note, tmp_path / "n"))
        where = elsewhere.finish()
        children = multiprocessing.active_children()
    assert (tmp_path / "n").read_text() == "done\n"
    assert (where != os.getpid()) == (of_cores > 1)
    assert len(children) == (of_cores > 1)
    assert not multiprocessing.active_children()


def test_an_error_rises_here(tmp_path: Path, of_cores: int) -> None:
    with Ahead(nothing) as elsewhere:
        elsewhere.begin(partial(fail, tmp_path / "n"))
        with pytest.raises(ValueError, match="the job says why"):
            elsewhere.finish()
    assert len((tmp_path / "n").read_text().split()) == of_cores
    assert not multiprocessing.active_children()


@pytest.mark.usefixtures("of_cores")
def test_what_cannot_travel_or_is_too_large_is_done_here(tmp_path: Path) -> None:
    with Ahead(nothing) as elsewhere:
        elsewhere.begin(lambda: note(tmp_path / "n"))
        assert elsewhere.finish() == os.getpid()
        elsewhere.begin(partial(note, tmp_path / "n"), there=False)
        assert elsewhere.finish() == os.getpid()
    assert (tmp_path / "n").read_text() == "done\ndone\n"


@pytest.mark.usefixtures("of_cores")
def test_a_process_that_could_not_load_is_not_missed(tmp_path: Path) -> None:
    with Ahead(lost) as elsewhere:
        elsewhere.begin(partial(note, tmp_path / "n"))
        assert elsewhere.finish() == os.getpid()


@pytest.mark.skipif(cores() == 1, reason="one core, or no fork: there is no other process")
def test_a_report_is_the_same_wherever_it_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    for count in (2, 1):
        monkeypatch.setattr(module, "cores", lambda count=count: count)
        done("diagnose", GANTRY, GANTRY / "survey.csv", "--out", tmp_path / str(count))
        made.append(tree(tmp_path / str(count)))
    assert "report.html" in made[0]
    assert made[0] == made[1]
