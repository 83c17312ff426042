"""A killed command leaves the old results or the new ones, touches nothing else, and the next run works.

A few points of three kinds of output; `python -m tests.benchmarks.kills 200` kills every command that writes at many.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from errormodel.files import clear_parts, replacing
from identification.results.output_file import OutputFile
from tests.helpers.commands import write

ROOT = Path(__file__).resolve().parents[2]


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
