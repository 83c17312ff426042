"""Interruptions by a signal, Ctrl-C or SIGTERM: found behind the errors that they became, and the exit code of each."""

from __future__ import annotations

import signal

NOTHING_KEPT = "nothing was put in place"


def interruption_behind(error: BaseException | None) -> KeyboardInterrupt | None:
    """The interruption behind an error, if any: a library that calls back into Python turns it into its own."""
    if error is None or isinstance(error, KeyboardInterrupt):
        return error
    return interruption_behind(error.__cause__ or error.__context__)


def exit_code(interruption: KeyboardInterrupt | None) -> int:
    """128 and the number of the signal, SIGINT where an interruption does not state it."""
    return 128 + int(interruption.args[0] if interruption is not None and interruption.args else signal.SIGINT)


def kept_of(interruption: KeyboardInterrupt | None) -> str:
    """What is left of the work, as whoever was interrupted says it behind the number of the signal."""
    return str(interruption.args[1]) if interruption is not None and len(interruption.args) > 1 else NOTHING_KEPT
