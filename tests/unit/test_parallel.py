"""Jobs in parallel: results in order, errors of the first job that failed, the caller's context, any executor."""

from __future__ import annotations

import os
import threading
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from identification.runtime.parallel import parallel_map


@pytest.fixture(params=[1, 2, 4])
def cores(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(os, "cpu_count", lambda: request.param)
    return int(request.param)


def square(number: int) -> int:
    return number**2


@given(st.lists(st.integers(-1000, 1000), max_size=40))
def test_results_come_in_the_order_of_the_jobs(numbers: list[int]) -> None:
    assert parallel_map([partial(square, k) for k in numbers]) == [k**2 for k in numbers]


def test_jobs_run_at_the_same_time_on_as_many_cores_as_there_are(cores: int) -> None:
    """Jobs that wait for one another end only where all of them run at once."""
    meeting = threading.Barrier(cores, timeout=20.0)
    places = parallel_map([meeting.wait] * cores)
    assert sorted(places) == list(range(cores))


def test_the_first_job_that_failed_says_why_whichever_failed_first(cores: int) -> None:
    late = threading.Event()

    def slow() -> None:
        late.wait(0.2)
        raise ValueError("the first in the list")

    def quick() -> None:
        late.set()
        raise KeyError("the second in the list")

    with pytest.raises(ValueError, match="the first in the list"):
        parallel_map([lambda: None, slow, quick])
    assert cores > 1 or not late.is_set()  # what has not begun when a job fails never does


def test_jobs_may_have_jobs_of_their_own(cores: int) -> None:
    del cores

    def nested() -> list[int]:
        return parallel_map([partial(square, k) for k in range(5)])

    assert parallel_map([nested] * 6) == [[k**2 for k in range(5)]] * 6


def test_the_caller_decides_how_numpy_treats_a_division_by_zero(cores: int) -> None:
    del cores

    def divide() -> float:
        return float(np.float64(1.0) / np.float64(0.0))

    with np.errstate(divide="ignore"):
        assert parallel_map([divide] * 4) == [np.inf] * 4
    with np.errstate(divide="raise"), pytest.raises(FloatingPointError):
        parallel_map([divide] * 4)


def test_another_executor_takes_the_threads_place() -> None:
    """Processes that are spawned, as on macOS and Windows, stand for a cluster: functions travel by their names."""
    import multiprocessing

    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        assert parallel_map([partial(square, k) for k in range(8)], pool) == [k**2 for k in range(8)]
        assert os.getpid() not in parallel_map([os.getpid] * 2, pool)
