"""The limit of address space of a process (``ulimit -v``): too low a one is refused before anything is loaded."""

from __future__ import annotations

import os

from errormodel.exceptions import InputError

# OpenBLAS, of NumPy and again of SciPy, tries for ever to allocate where the limit is too low: nothing ends that, not
# even SIGTERM. Fits and diagnoses of 60 rows on two cores end well from 2.0 GB on; half as much again, by judgement.
# Nearly all of that is reserved and not used (0.25 GB is).
LEAST_B = 2.8e9
LEAST_PER_THREAD_B = 0.1e9  # 0.08 GB measured for a thread of both, of which there is one a core
MOST_THREADS = 64  # of OpenBLAS as NumPy and SciPy have it


def check_limit() -> None:
    """Check that the address space is large enough for any command.

    Raises
    ------
    InputError
        The soft limit is below what a command needs.
    """
    try:
        import resource
    except ImportError:  # on Windows, which has no such limit
        return
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    need = LEAST_B + LEAST_PER_THREAD_B * _threads()
    if limit != resource.RLIM_INFINITY and limit < need:
        found = (
            f"there is too little: the address space is limited to {limit / 1e9:.2f} GB (ulimit -v {limit // 1024}), "
            f"and the libraries of a command may wait for ever with less than {need / 1e9:.1f} GB"
        )
        raise InputError("memory", found, f"Set ulimit -v {-(-need // 1024):.0f} or more, or unlimited")


def _threads() -> int:
    """Threads of OpenBLAS: one a core, or as the environment says."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    told = os.environ.get("OPENBLAS_NUM_THREADS", "")
    return min(int(told) if told.isdecimal() and int(told) else cores, cores, MOST_THREADS)
