"""The start of a process: Ctrl-C ends it with a word and exit code 130 at any moment, while modules load too."""

from __future__ import annotations

import os
import signal
import sys
import threading
from types import FrameType

STOPPED = 130  # exit code of what Ctrl-C ended: 128 and the number of SIGINT
PATIENCE_S = 5.0  # s after Ctrl-C; a library may have lost the interruption, or a thread goes on; by judgement
WORD = "stopped: what was not finished was not put in place"


def entry() -> None:
    """Run the command line as a process of its own."""
    try:
        # a parent that ignores interruptions, such as nohup, goes before
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, _interrupted)
        from identification.command_line.main import entry as run

        run()
    except KeyboardInterrupt:
        _say_so()
    except Exception as error:
        if not _from_interruption(error):
            raise
        _say_so()


def _say_so() -> None:
    print(f"\n{WORD}", file=sys.stderr)  # noqa: T201  click may not be loaded yet
    sys.exit(STOPPED)


def _from_interruption(error: BaseException | None) -> bool:
    """Whether an error comes from an interruption: a library that calls back into Python turns it into its own."""
    return error is not None and (
        isinstance(error, KeyboardInterrupt) or _from_interruption(error.__cause__ or error.__context__)
    )


def _interrupted(signum: int, frame: FrameType | None) -> None:
    timer = threading.Timer(PATIENCE_S, _end)
    timer.daemon = True
    timer.start()
    raise KeyboardInterrupt


def _end() -> None:
    """End the process: results are exchanged whole or not at all, whenever that happens."""
    os.write(2, f"\n{WORD}\n".encode())
    os._exit(STOPPED)


if __name__ == "__main__":
    entry()
