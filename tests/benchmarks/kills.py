"""Kill every command that writes at random points: results are the old or the new ones, and the next run works.

    python -m tests.benchmarks.kills [COUNT] [COMMAND ...]

COUNT kills of each command, 200 unless told: half at file operations, the others at moments; and disks that are full at
various files. For Linux; with OMP_NUM_THREADS=1, since processes are forked.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from tests.helpers.kills import CASES, killed, prepare


def main() -> None:
    """Kill the commands that were asked for."""
    words = sys.argv[1:]
    count = int(words.pop(0)) if words and words[0].isdigit() else 200
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        names = words or [*CASES]
        prepare(Path(folder), names)
        for name in names:
            found = 0
            for when, faults in killed(name, Path(folder), count):
                for fault in faults:
                    print(f"  {when}: {fault}", flush=True)
                found += bool(faults)
            print(f"{name:12} {count} kills, {found} with a fault", flush=True)
            wrong += found
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
