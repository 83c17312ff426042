"""How long work says what it is at: a caller gives what surrounds each part, a terminal's status or nothing."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

Progress = Callable[[str], AbstractContextManager[None]]
"""Called with the name of a part; entered while it runs."""


def silent(text: str) -> AbstractContextManager[None]:
    """Say nothing."""
    return nullcontext()


Steps = Callable[[str], AbstractContextManager[Callable[[float, str], None]]]
"""Called with the name of work that knows how far it is; yields what takes the share done, 0 to 1, and a remark."""


def uncounted(text: str) -> AbstractContextManager[Callable[[float, str], None]]:
    """Say nothing."""
    return nullcontext(lambda _share, _remark: None)
