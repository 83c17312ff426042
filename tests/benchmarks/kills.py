"""Kill every command that writes at random points: results are the old or the new ones, and the next run works.

    python -m tests.benchmarks.kills [COUNT] [COMMAND ...]

COUNT kills of each command, 200 unless told: half at file operations, the others at moments; and disks that are full at
various files. Printed are also at how many of the command's file operations it was killed, and how many different
contents that left. For Linux; with OMP_NUM_THREADS=1, since processes are forked.
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
            kills = []
            for kill in killed(name, Path(folder), count):
                for fault in kill.faults:
                    print(f"  {kill.when}: {fault}", flush=True)
                kills.append(kill)
            found = sum(bool(k.faults) for k in kills)
            at = {k.when.partition("operation ")[2] for k in kills} - {""}
            operations = f"{len(at)} of {next(iter(at)).rpartition(' ')[2]} operations"
            different = len({k.files for k in kills} - {None})
            print(f"{name:12} {count} kills, {found} with a fault; {operations}, {different} contents", flush=True)
            wrong += found
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
