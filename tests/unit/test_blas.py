"""BLAS in one thread, that of SciPy too."""

from __future__ import annotations

from threadpoolctl import threadpool_info

from identification.runtime.blas import one_blas_thread


def threads() -> list[int]:
    return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]


def test_every_blas_has_one_thread_within_the_block_and_its_own_after_it() -> None:
    with one_blas_thread():
        within = threads()
    assert within
    assert set(within) == {1}
    before = threads()  # SciPy is loaded now
    with one_blas_thread():
        pass
    assert threads() == before
