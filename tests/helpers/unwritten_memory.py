"""Memory that the project asks for and has not written to: signalling NaNs, which fail whatever computes with them."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np

SIGNALLING = {np.dtype(np.float32): 0x7FA00000, np.dtype(np.float64): 0x7FF4000000000000}  # as unsigned numbers


def signal_reads() -> None:
    """From now on `numpy.empty` and `numpy.empty_like` give the project's own modules signalling NaNs."""
    np.empty, np.empty_like = _signalling(np.empty), _signalling(np.empty_like)  # type: ignore[assignment]


def _signalling(make: Callable[..., Any]) -> Callable[..., Any]:
    def made(*args: Any, **options: Any) -> Any:
        out = make(*args, **options)
        caller = sys._getframe(1).f_globals.get("__name__", "").partition(".")[0]
        if caller in ("errormodel", "identification") and out.dtype in SIGNALLING and out.flags.c_contiguous:
            out.view(f"u{out.itemsize}")[...] = SIGNALLING[out.dtype]
        return out

    return made
