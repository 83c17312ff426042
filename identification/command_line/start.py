"""The start of a process: Ctrl-C and SIGTERM end it with a word at any moment, while modules load too.

Exit codes are 130 and 143: 128 and the number of the signal. Standard streams that are closed are as the null device.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from types import FrameType

PATIENCE_S = 5.0  # s after a signal; a library may have lost the interruption, or a thread goes on; by judgement
WORD = "stopped: what was not finished was not put in place"


def entry() -> None:
    """Run the command line as a process of its own."""
    try:
        # a parent that ignores interruptions, such as nohup, goes before
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, _interrupted)
        if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
            signal.signal(signal.SIGTERM, _interrupted)
        _open_closed_streams()
        from identification.command_line.main import entry as run

        run()
    except KeyboardInterrupt as error:
        _say_so(error)
    except Exception as error:
        interruption = interruption_behind(error)
        if interruption is None:
            raise
        _say_so(interruption)


def _say_so(interruption: KeyboardInterrupt) -> None:
    print(f"\n{WORD}", file=sys.stderr)  # noqa: T201  click may not be loaded yet
    sys.exit(exit_code(interruption))


def interruption_behind(error: BaseException | None) -> KeyboardInterrupt | None:
    """The interruption behind an error, if any: a library that calls back into Python turns it into its own."""
    if error is None or isinstance(error, KeyboardInterrupt):
        return error
    return interruption_behind(error.__cause__ or error.__context__)


def exit_code(interruption: KeyboardInterrupt | None) -> int:
    """128 and the number of the signal, SIGINT where an interruption does not state it."""
    return 128 + int(interruption.args[0] if interruption is not None and interruption.args else signal.SIGINT)


def _open_closed_streams() -> None:
    """Open standard streams that are closed (``>&-``) as the null device.

    Python has None for them, and the next file to be opened would take their number.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            handle = os.open(os.devnull, os.O_RDWR)
            if handle != number:
                os.dup2(handle, number)
                os.close(handle)
            setattr(sys, name, os.fdopen(number, "w" if number else "r", encoding="utf-8", closefd=False))


def _interrupted(signum: int, frame: FrameType | None) -> None:
    timer = threading.Timer(PATIENCE_S, _end, (128 + signum,))
    timer.daemon = True
    timer.start()
    raise KeyboardInterrupt(signum)


def _end(code: int) -> None:
    """End the process: results are exchanged whole or not at all, whenever that happens."""
    os.write(2, f"\n{WORD}\n".encode())
    os._exit(code)


if __name__ == "__main__":
    entry()
