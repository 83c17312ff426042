"""Random programmes, rewritten and executed beside the plain ones by a control that shares no code with the package.

``python -m tests.benchmarks.gcode [--programmes 10000] [--first 0] [--processes 2] [--rs274 PATH]``

Prints how many were written, what they held, and the largest distance of a path from the one that was asked for. With
``--rs274``, the stand-alone interpreter of LinuxCNC reads every milling programme, too, plain and rewritten, and its
ends of motions have to be those of the control here.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from errormodel.exceptions import InputError
from tests.benchmarks.rs274 import agree
from tests.helpers.gcode_trial import trial

CHUNK = 50


def chunk(first: int, count: int, rs274: str) -> tuple[Counter[str], float, list[str]]:
    """Trials of some programmes: what they held, the largest distance, and what went wrong."""
    seen: Counter[str] = Counter()
    worst, wrong = 0.0, []
    for seed in range(first, first + count):
        try:
            worst = max(worst, trial(seed, seen))
            seen["programmes"] += 1
            if rs274 and seed % 4 != 3:
                seen["motions as in LinuxCNC"] += agree(seed, Path(rs274))
        except (AssertionError, InputError) as error:
            wrong.append(f"{seed}: {type(error).__name__} {str(error)[:300]}")
    return seen, worst, wrong


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--programmes", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--rs274", default="")
    asked = parser.parse_args()
    start, seen, worst, wrong = time.perf_counter(), Counter[str](), 0.0, list[str]()
    firsts = range(asked.first, asked.first + asked.programmes, CHUNK)
    with ProcessPoolExecutor(asked.processes) as pool:
        for found, gap, bad in pool.map(chunk, firsts, [CHUNK] * len(firsts), [asked.rs274] * len(firsts)):
            seen += found
            worst, wrong = max(worst, gap), [*wrong, *bad]
            for line in bad:
                print(line, flush=True)
            if not seen["programmes"] % 500:
                print(f"{seen['programmes']} programmes, {time.perf_counter() - start:.0f} s", flush=True)
    print(f"{seen['programmes']} programmes as asked, {len(wrong)} not; largest distance {1e3 * worst:.2f} um")
    print(", ".join(f"{n} {what}" for what, n in sorted(seen.items())))
    print(f"{time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
