"""Coverage-guided fuzzing of every reader with atheris: nothing but the project's own refusals, and none slow.

    pip install '.[fuzz]' && python -m tests.benchmarks.fuzz [READER] [-runs=10000] [-seed=1]

Without a reader, all of them in turn, `-runs` each. Further words go to libFuzzer. For Linux and macOS.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

DEFAULT = "-runs=600"
SHOWN = 3000  # characters of the output of a reader that failed


def fuzz(name: str, words: list[str]) -> None:
    """Fuzz one reader in this process, which ends with it."""
    import atheris

    from tests.helpers.reading import readers, tried

    with tempfile.TemporaryDirectory() as corpus:
        (Path(corpus) / "sound").write_bytes(readers()[name].sound)
        given = [sys.argv[0], "-max_len=20000", f"-artifact_prefix={corpus}/", *words, corpus]
        atheris.Setup(given, lambda data: tried(name, data) and None)
        atheris.Fuzz()


def apart(name: str, words: list[str]) -> tuple[bool, str]:
    """Fuzz one reader in a process forked from this one, whose modules are loaded: whether it is sound, its output."""
    with tempfile.TemporaryFile() as said:
        child = os.fork()
        if not child:
            os.dup2(said.fileno(), 1)
            os.dup2(said.fileno(), 2)
            try:
                fuzz(name, words)
            finally:
                os._exit(70)  # libFuzzer ends the process itself
        _, status = os.waitpid(child, 0)
        said.seek(0)
        return os.waitstatus_to_exitcode(status) == 0, said.read().decode(errors="replace")


def main() -> None:
    """Fuzz the readers that were asked for."""
    import atheris

    assert "errormodel" not in sys.modules  # what was imported before is not instrumented, and guides nothing
    with atheris.instrument_imports(include=["errormodel", "identification"]):
        from tests.helpers.reading import readers, tried

        for name, reader in readers().items():
            tried(name, reader.sound)  # which imports what this reader uses
    words = sys.argv[1:]
    names = [words.pop(0)] if words and not words[0].startswith("-") else list(readers())
    failed = 0
    for name in names:
        begun = time.monotonic()
        sound, said = apart(name, words or [DEFAULT])
        runs = next((line for line in reversed(said.splitlines()) if line.startswith("Done ")), "not finished")
        print(f"{name:28} {'sound' if sound else 'FAILED'}  {time.monotonic() - begun:6.0f} s  {runs}", flush=True)
        if not sound:
            failed += 1
            print(said[-SHOWN:])
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
