"""The command line as tests call it: in this process, with what it printed and how it ended."""

from __future__ import annotations

import io
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

from identification.command_line.main import main

FIVE = "five_axis_table_quill"
MILL = "vertical_three_axis"
XYZ = ["mx", "my", "mz"]
Fill = Callable[[Path], Path]  # puts something into a folder, and returns it


@dataclass(frozen=True)
class Done:
    """How a command ended: exit code, and the text on its two streams."""

    code: int
    out: str
    err: str


def run(*arguments: object) -> Done:
    """Run ``errormodel <arguments>``; what is no wrong input raises here as it would end a process."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    with redirect_stdout(out), redirect_stderr(err):
        try:
            main([str(a) for a in arguments])
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
    return Done(code, out.getvalue(), err.getvalue())


def done(*arguments: object) -> Done:
    """Like :func:`run`, for a command that must succeed."""
    result = run(*arguments)
    assert result.code == 0, result.err
    return result


def tree(folder: Path) -> dict[str, bytes]:
    """Every file below a folder, by its path there."""
    files = (p for p in sorted(folder.rglob("*")) if p.is_file())
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in files}


def write(path: Path, content: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def fitted_mill(folder: Path) -> Path:
    """A small machine's survey with noise, and its fit: ``s.csv fit/``."""
    done("simulate", MILL, 60, "--noise", 0.002, "--out", folder / "s.csv")
    done("fit", MILL, folder / "s.csv", "--out", folder / "fit")
    return folder
