"""Every notebook (py:percent text) runs from top to bottom."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.helpers.interpreter import Interpreter, interpreter

NOTEBOOKS = sorted((Path(__file__).resolve().parents[2] / "notebooks").glob("*.py"))
OFTEN = ("01_first_fit",)  # most of the others take half a minute and more
PROGRAM = "import runpy, sys; sys.argv = [{0!r}]; runpy.run_path({0!r}, run_name='__main__')"
AFTERWARDS = "from matplotlib import pyplot; pyplot.close('all')"


@pytest.fixture(scope="module")
def reader() -> Iterator[Interpreter]:
    """A process in which warnings are errors."""
    with interpreter("-W", "error") as started:
        yield started


@pytest.mark.parametrize(
    "notebook",
    [pytest.param(n, id=n.stem, marks=[pytest.mark.long] if n.stem not in OFTEN else []) for n in NOTEBOOKS],
)
def test_notebook_runs(notebook: Path, reader: Interpreter, tmp_path: Path) -> None:
    reader.python(PROGRAM.format(str(notebook)), tmp_path)
    reader.python(AFTERWARDS, tmp_path)
