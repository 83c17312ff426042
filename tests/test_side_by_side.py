"""Jobs in workers: results in order, exceptions where they can be seen, workers that are lost."""

from __future__ import annotations

import os
import signal
import time
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from identification.runtime import process_pool as module
from identification.runtime.process_pool import Ground, side_by_side

HERE = os.getpid()


@pytest.fixture(params=[1, 2, 4], autouse=True)
def cores(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module.os, "sched_getaffinity", lambda _: set(range(request.param)), raising=False)


def square(number: int) -> int:
    return number**2


def test_results_come_in_the_order_of_the_jobs() -> None:
    assert side_by_side([partial(square, k) for k in range(50)]) == [k**2 for k in range(50)]


def test_no_jobs() -> None:
    assert side_by_side([]) == []


def test_an_exception_rises_here() -> None:
    def bad() -> int:
        raise ValueError("the job says why")

    with pytest.raises(ValueError, match="the job says why"):
        side_by_side([partial(square, 2), bad, partial(square, 3), bad])


def test_what_a_lost_worker_took_is_done_here() -> None:
    def dangerous(number: int) -> int:
        if os.getpid() != HERE:
            os.kill(os.getpid(), signal.SIGKILL)
        return number

    assert side_by_side([partial(dangerous, k) for k in range(8)]) == list(range(8))


def test_who_is_busy_is_waited_for_and_who_sleeps_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PATIENCE", 0.5)

    def busy(number: int) -> int:
        if os.getpid() == HERE:
            time.sleep(1.0)  # workers have begun by then
        end = time.process_time() + 1.5 * (os.getpid() != HERE)
        while time.process_time() < end:
            pass
        return os.getpid()

    def asleep(number: int) -> int:
        time.sleep(1.0 if os.getpid() == HERE else 600.0)
        return number

    workers = set(side_by_side([partial(busy, k) for k in range(2)]))
    assert len(workers) == min(module.cores(), 2)
    assert side_by_side([partial(asleep, k) for k in range(3)]) == [0, 1, 2]


def test_in_a_worker_all_is_done_there() -> None:
    """Daemonic processes, as those of a pool or of Dask, may not have children."""

    def nested() -> list[int]:
        return side_by_side([partial(square, k) for k in range(5)])

    assert side_by_side([nested] * 4) == [[k**2 for k in range(5)]] * 4


def test_a_result_that_cannot_travel_is_made_here() -> None:
    made = side_by_side([lambda: lambda: 1, lambda: lambda: 2])
    assert [f() for f in made] == [1, 2]


def test_arrays_on_the_ground_do_not_travel_and_are_the_same() -> None:
    ground = Ground(1 << 20, 4)

    def lay(part: int) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        room = ground.empty(part, (3, 50), np.float32)
        room[:] = part + np.arange(50)
        wide = ground.empty(part, (1 << 20,), np.float32)  # more than there is: laid elsewhere, and travels
        wide[:] = part
        return room, room[1:], wide[::1000]

    for part, (room, some, wide) in enumerate(side_by_side([partial(lay, k) for k in range(4)], ground)):
        assert np.array_equal(room, np.tile(part + np.arange(50, dtype=np.float32), (3, 1)))
        assert np.array_equal(some, room[1:])
        assert np.array_equal(wide, np.full(wide.shape, part))
        assert (ground.place(room) is None) == (module.cores() == 1)
        room[1] = -1  # one memory, not a copy
        assert (some[0] == -1).all()
