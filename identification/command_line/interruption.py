"""Interruptions by a signal, Ctrl-C, SIGTERM or SIGHUP: found behind the errors that they became, and how each ends."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from identification.command_line.signalled import came

NOTHING_KEPT = "nothing was put in place"


def interruption_behind(error: BaseException | None) -> KeyboardInterrupt | None:
    """The interruption behind an error, if any: a library that calls back into Python turns it into its own.

    One that loses it on its way, and fails of that, leaves nothing behind the error but that a signal came before.
    """
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error or came()


def exit_code(interruption: KeyboardInterrupt | None) -> int:
    """128 and the number of the signal, SIGINT where an interruption does not state it."""
    return 128 + int(interruption.args[0] if interruption is not None and interruption.args else signal.SIGINT)


def kept_of(interruption: KeyboardInterrupt | None) -> str:
    """What is left of the work, as whoever was interrupted says it behind the number of the signal."""
    return str(interruption.args[1]) if interruption is not None and len(interruption.args) > 1 else NOTHING_KEPT


def last_word(text: str) -> None:
    """Write a line to stderr, if anyone is there."""
    with unless_gone():
        print(text, file=sys.stderr, flush=True)  # noqa: T201  click may not be loaded yet


@contextmanager
def unless_gone() -> Iterator[None]:
    """Let a block write to stderr, unless nobody is there any more: a terminal that was closed takes nothing."""
    try:
        yield
    except OSError:
        # what is still buffered goes nowhere: the interpreter would make it another exit code
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
