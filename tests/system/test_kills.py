"""A killed command leaves the old results or the new ones, touches nothing else, and the next run works.

A few points of three kinds of output; `python -m tests.benchmarks.kills 200` kills every command that writes at many.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from errormodel.files import clear_parts, replacing
from identification.results.output_file import OutputFile
from tests.helpers.commands import write

pytestmark = pytest.mark.skipif(not hasattr(os, "fork") or sys.platform == "darwin", reason="forks with threads")


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from tests.helpers.kills import prepare

    place = tmp_path_factory.mktemp("prepared")
    prepare(place)
    return place


@pytest.mark.parametrize(("name", "count"), [("predict", 5), ("fit", 3), ("monitor", 3)])
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")  # Python 3.12, of forks with threads
def test_results_are_the_old_or_the_new_ones(name: str, count: int, prepared: Path) -> None:
    from tests.helpers.kills import killed

    for when, faults in killed(name, prepared, count):
        assert not faults, when


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
