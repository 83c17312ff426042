"""Ablation on the arm's recording: each declared curve and each constant taken out and asked for again.

``python -m tests.benchmarks.ablation FOLDER [EVERY] [WHAT ...]``: FOLDER holds ``machine.yaml`` and ``series_c.csv``,
EVERY so-many-th pose is taken, WHAT is a joint (J2) or a constant (T3.ea); all joints and two constants if not given.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from identification.diagnosis.pipeline import diagnose
from tests.helpers.arm import CURVES, arm, recorded


def main(folder: Path, every: int, what: list[str]) -> None:
    for name in what:
        machine = arm(folder, without=name)
        start = time.perf_counter()
        result = diagnose(machine, recorded(folder, machine, every))
        before, after = (fit.heldout.rms_um for fit in (result.baseline, result.final))
        seconds = time.perf_counter() - start
        sys.stdout.write(f"without {name}: held-out {before:.0f} um, after {after:.0f} um, {seconds:.0f} s\n")
        for finding in result.diagnosis.findings:
            sys.stdout.write(f"    {finding.statement}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    _, where, *rest = sys.argv
    main(Path(where), int(rest[0]) if rest else 1, rest[1:] or [*CURVES, "T2.dx", "T3.ea"])
