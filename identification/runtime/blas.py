"""Threads of BLAS, for work on many matrices of middle size."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Run BLAS in one thread within the block.

    Threads that share such small work wait for each other most of the time, at full use of their cores.
    """
    import scipy.linalg  # noqa: F401  (SciPy has a BLAS of its own, and only what is loaded can be limited)
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, "blas"):
        yield
