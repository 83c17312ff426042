"""Memory that is free and yet counted: what the C library keeps of a process' heaps."""

from __future__ import annotations

import ctypes
import sys


def give_back() -> None:
    """Give the free pages of all heaps back to the system, after much was freed between what is still in use.

    By ``malloc_trim`` of the GNU C library, which keeps them; other libraries have no such function, and nothing is
    done there.
    """
    if sys.platform != "linux":
        return
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
