"""Threads of BLAS, for work on many matrices of middle size."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any


@cache
def _libraries() -> Any:
    """The BLAS of NumPy and that of SciPy: to look for them takes as long as a fit of thousands of rows."""
    import scipy.linalg  # noqa: F401  (only what is loaded can be limited)
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Run BLAS in one thread within the block.

    Threads that share such small work wait for each other most of the time, at full use of their cores.
    """
    with _libraries().limit(limits=1, user_api="blas"):
        yield
