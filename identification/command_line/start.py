"""The start of a process: Ctrl-C, SIGTERM and a terminal that is closed (SIGHUP) end it at any moment, with a word.

So they do while modules load. Exit codes are 130, 143 and 129: 128 and the number of the signal. Standard streams that
are closed are as the null device.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from contextlib import suppress
from types import FrameType

from identification.command_line.interruption import exit_code, interruption_behind, last_word

PATIENCE_S = 5.0  # s after a signal; a library may have lost the interruption, or a thread goes on; by judgement
ENDING = ("SIGINT", "SIGTERM", "SIGHUP")  # signals, of which Windows lacks the last
WORD = "stopped: what was not finished was not put in place"


def entry() -> None:
    """Run the command line as a process of its own."""
    try:
        # a parent that ignores one of them, such as nohup, goes before
        for name in ENDING:
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
                signal.signal(number, _interrupted)
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
    last_word(f"\n{WORD}")
    sys.exit(exit_code(interruption))


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
    with suppress(OSError):  # a terminal that was closed
        os.write(2, f"\n{WORD}\n".encode())
    os._exit(code)


if __name__ == "__main__":
    entry()
