"""Coverage-guided fuzzing of every reader with atheris: nothing but the project's own refusals, and none slow.

    pip install '.[fuzz]' && python -m tests.benchmarks.fuzz [READER] [-runs=10000] [-seed=1]

Without a reader, all of them in turn. Further words go to libFuzzer.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from tests.helpers.reading import readers, tried


def fuzz(name: str, words: list[str]) -> None:
    """Fuzz one reader in this process, which ends with it."""
    import atheris

    with atheris.instrument_imports(include=["errormodel", "identification"]):
        tried(name, readers()[name].sound)
    with tempfile.TemporaryDirectory() as corpus:
        (Path(corpus) / "sound").write_bytes(readers()[name].sound)
        atheris.Setup([sys.argv[0], *words, "-max_len=20000", corpus], lambda data: tried(name, data) and None)
        atheris.Fuzz()


def main() -> None:
    """Fuzz the readers that were asked for."""
    words = sys.argv[1:]
    if words and words[0] in readers():
        fuzz(words[0], words[1:])
        return
    given = words or ["-runs=600"]
    failed = []
    for name in readers():
        done = subprocess.run(
            [sys.executable, "-m", "tests.benchmarks.fuzz", name, *given], capture_output=True, text=True, check=False
        )
        print(f"{name:16} {'sound' if done.returncode == 0 else 'FAILED'}", flush=True)
        if done.returncode:
            failed.append(name)
            print(done.stderr[-3000:])
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
