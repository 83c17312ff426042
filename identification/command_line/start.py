"""The start of a process: Ctrl-C, SIGTERM and a terminal that is closed (SIGHUP) end it at any moment, with a word.

So they do while modules load: this module and the packages around it import next to nothing, and all else comes after
the handlers. What happens before is the start of Python itself, which has its own way to end. Exit codes are 130, 143
and 129: 128 and the number of the signal. Standard streams that are closed are as the null device.
"""

from __future__ import annotations

import _thread  # as `time` part of Python itself, so that a handler can use them while other modules load
import os
import signal
import sys
import time

from identification.command_line.signalled import interrupted_by

TYPE_CHECKING = False  # what type checkers take for true; `typing` takes longer than all of this

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType

PATIENCE_S = 5.0  # s after a signal; a library may have lost the interruption, or a thread goes on; by judgement
ENDING = ("SIGINT", "SIGTERM", "SIGHUP")  # signals, of which Windows lacks the last
WORD = "stopped: what was not finished was not put in place"


def entry() -> None:
    """Run the command line as a process of its own."""
    try:
        _handle_all(_interrupted)
        _open_closed_streams()
        from identification.command_line.main import entry as run

        run()
    except KeyboardInterrupt as error:
        _say_so(error)
    except Exception as error:
        from identification.command_line.interruption import interruption_behind

        interruption = interruption_behind(error)
        if interruption is None:
            raise
        _say_so(interruption)


def _handle_all(handler: Callable[[int, FrameType | None], None] | signal.Handlers) -> None:
    for name in ENDING:
        number = getattr(signal, name, None)
        # a parent that ignores one of them, such as nohup, goes before
        if number is not None and signal.getsignal(number) not in (signal.SIG_IGN, None):
            signal.signal(number, handler)


def _say_so(interruption: KeyboardInterrupt) -> None:
    from identification.command_line.interruption import exit_code, last_word

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
    _handle_all(signal.SIG_IGN)  # who presses Ctrl-C twice would break off what puts things in order
    _thread.start_new_thread(_end_later, (128 + signum,))
    raise interrupted_by(signum)


def _end_later(code: int) -> None:
    """End the process: results are exchanged whole or not at all, whenever that happens."""
    time.sleep(PATIENCE_S)
    try:  # noqa: SIM105  contextlib may be half loaded
        os.write(2, f"\n{WORD}\n".encode())
    except OSError:  # a terminal that was closed
        pass
    os._exit(code)
