"""Fair clocks: contenders take turns within every repeat, and each one's memory is taken in a process of its own."""

from __future__ import annotations

import gc
import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
_STATUS = Path("/proc/self/status")


def interleaved(
    tasks: Mapping[str, Callable[[], Any]], repeats: int, clock: Callable[[], float] = time.perf_counter
) -> dict[str, list[float]]:
    """Seconds of each repeat of each task by a clock, after one turn that is not counted."""
    seconds: dict[str, list[float]] = {name: [] for name in tasks}
    for turn in range(repeats + 1):
        for name, task in tasks.items():
            gc.collect()
            start = clock()
            result = task()
            elapsed = clock() - start
            del result  # not on the clock
            if turn:
                seconds[name].append(elapsed)
    return seconds


def summary(seconds: list[float], poses: int) -> dict[str, float]:
    """Nanoseconds a pose: median, least and most."""
    ns = [s / poses * 1e9 for s in seconds]
    return {"median": statistics.median(ns), "min": min(ns), "max": max(ns)}


def peak_memory(module: str, function: str, poses: int) -> float | None:
    """Bytes that one call adds, at its peak, to a process that has the input and a small warm-up behind it.

    Counts everything, what libraries allocate outside Python included. None where the system does not tell (only Linux
    does), or where there was not enough memory.
    """
    command = [sys.executable, "-m", "tests.benchmarks.timing", module, function, str(poses)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return json.loads(done.stdout.splitlines()[-1]) if done.returncode == 0 else None


def _measure(module: str, function: str, poses: int) -> float | None:
    import importlib

    from tests.benchmarks import five_axis

    call = getattr(importlib.import_module(module), function)
    q = five_axis.poses(poses)
    inputs = (q,) if function != "fit" else (q, five_axis.nominal(q))
    call(*(i[:300] for i in inputs))
    gc.collect()
    if not _STATUS.exists():
        return None
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the peak starts again from here
    before = _status("VmRSS")
    result = call(*inputs)
    peak = _status("VmHWM") - before
    del result
    return peak


def _status(key: str) -> float:
    line = next(line for line in _STATUS.read_text(encoding="ascii").splitlines() if line.startswith(key))
    return float(line.split()[1]) * 1024


if __name__ == "__main__":
    print(json.dumps(_measure(sys.argv[1], sys.argv[2], int(sys.argv[3]))))
