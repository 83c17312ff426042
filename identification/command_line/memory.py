"""The limit of address space of a process (``ulimit -v``): too low a one is refused before anything is loaded."""

from __future__ import annotations

from errormodel.exceptions import InputError

# OpenBLAS, of NumPy and again of SciPy, tries for ever to allocate where the limit is too low (0.6 GB): nothing ends
# that, not even SIGTERM. Fits of 60 rows on two cores end well from 0.8 GB on.
LEAST_B = 0.8e9


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
    if limit != resource.RLIM_INFINITY and limit < LEAST_B:
        found = (
            f"there is too little: the address space is limited to {limit / 1e9:.2f} GB (ulimit -v {limit // 1024}), "
            f"and the libraries of a command may wait for ever with less than {LEAST_B / 1e9:.1f} GB"
        )
        raise InputError("memory", found, f"Set ulimit -v {-(-LEAST_B // 1024):.0f} or more, or unlimited")
