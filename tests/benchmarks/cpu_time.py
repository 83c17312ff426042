"""CPU seconds of whole commands, cold start and report included: ``python -m tests.benchmarks.cpu_time [CHECKOUT...]``.

A survey of a library's machine is simulated with noise and no hidden effect. Every checkout (this one where none is
given) runs ``--help``, ``describe``, ``fit`` and ``diagnose`` on it in turn, each in a process of its own with one
thread of linear algebra. Printed are user and system seconds, those of child processes included: median, least and
most, and the ratio of the medians to those of the first checkout, which other load of the computer touches least.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NOISE = 0.001  # mm


@dataclass(frozen=True)
class Used:
    """User and system seconds of a command and of its child processes, and its largest resident memory, GB."""

    seconds: float
    gigabytes: float


def used(checkout: Path, words: list[str], folder: Path) -> Used:
    """What a command of the checkout's program uses, with one thread of linear algebra."""
    scripts = tomllib.loads((checkout / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"]
    module, name = scripts["errormodel"].split(":")
    program = f"from {module} import {name}; {name}()"
    environment = {**os.environ, "PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1"}
    # modules are compiled once, as where the program is installed
    environment |= {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(folder / "compiled" / checkout.name)}
    process = subprocess.Popen(
        [sys.executable, "-c", program, *words], env=environment, cwd=folder, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )  # fmt: skip
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, words)
    unit = 1 if sys.platform == "darwin" else 1024  # bytes
    return Used(usage.ru_utime + usage.ru_stime, usage.ru_maxrss * unit / 1e9)


def run(checkout: Path, words: list[str], folder: Path) -> float:
    """CPU seconds of a command of the checkout's program."""
    return used(checkout, words, folder).seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkouts", type=Path, nargs="*")
    parser.add_argument("--machine", default="vertical_three_axis")
    parser.add_argument("--rows", type=int, default=300)
    parser.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()
    checkouts = [c.resolve() for c in arguments.checkouts] or [ROOT]
    machine = arguments.machine
    commands = {
        "--help": ["--help"],
        "describe": ["describe", machine],
        "fit": ["fit", machine, "s.csv", "--out", "out"],
        "diagnose": ["diagnose", machine, "s.csv", "--out", "out"],
    }
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run(checkouts[0], ["simulate", machine, str(arguments.rows), "--noise", str(NOISE), "--out", "s.csv"], folder)
        for command, words in commands.items():
            seconds: list[list[float]] = [[] for _ in checkouts]
            for turn in range(arguments.repeats + 1):
                for own, checkout in zip(seconds, checkouts, strict=True):
                    took = run(checkout, words, folder)
                    if turn:  # the first compiles modules, which is not counted
                        own.append(took)
                    shutil.rmtree(folder / "out", ignore_errors=True)
            first = statistics.median(seconds[0])
            shown = "   ".join(
                f"{c.name} {statistics.median(own):5.2f} s ({min(own):.2f} to {max(own):.2f})"
                + (f" {statistics.median(own) / first:5.2f} x" if k else "")
                for k, (c, own) in enumerate(zip(checkouts, seconds, strict=True))
            )
            print(f"{command:9} {shown}", flush=True)


if __name__ == "__main__":
    main()
