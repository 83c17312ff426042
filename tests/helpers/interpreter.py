"""A process of its own for several requests in turn: to start one takes longer than most of what tests ask of it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = """
import contextlib, io, json, os, sys, traceback
answers = sys.stdout
for line in sys.stdin:
    asked, out, err, code = json.loads(line), io.StringIO(), io.StringIO(), 0
    os.chdir(asked["folder"])
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            if asked["words"] is None:
                exec(asked["python"], {"__name__": "__main__"})
            else:
                from identification.command_line.main import main
                main(asked["words"])
        except SystemExit as end:
            code = end.code or 0
        except BaseException:
            traceback.print_exc()
            code = 1
    print(json.dumps([code, out.getvalue(), err.getvalue()]), file=answers, flush=True)
"""


class Interpreter:
    """A process that runs Python or commands, one after the other, and says what they print."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def python(self, program: str, folder: Path) -> str:
        """What a program prints, in a name space of its own."""
        return self._answered(python=program, words=None, folder=str(folder))

    def command(self, *words: object, folder: Path) -> str:
        """What ``errormodel <words>`` prints."""
        return self._answered(words=[str(w) for w in words], folder=str(folder))

    def _answered(self, **asked: object) -> str:
        assert self._process.stdin
        assert self._process.stdout
        print(json.dumps(asked), file=self._process.stdin, flush=True)
        line = self._process.stdout.readline()
        assert line, "the process ended"
        code, out, err = json.loads(line)
        assert code == 0, err
        return str(out)


@contextmanager
def interpreter(*options: str, paths: tuple[Path, ...] = ()) -> Iterator[Interpreter]:
    """A process with options of Python, and with these folders before the project's own to import from."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (*paths, ROOT)))}
    with subprocess.Popen(
        [sys.executable, *options, "-c", PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env=environment,
    ) as process:  # fmt: skip
        yield Interpreter(process)
        assert process.stdin
        process.stdin.close()
        assert process.wait() == 0
