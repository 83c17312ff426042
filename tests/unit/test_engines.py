"""Jobs on processes and on Dask: all results whoever dies, failures named, the same whatever the engine."""

from __future__ import annotations

import builtins
import os
import time
from pathlib import Path
from typing import Any

import pytest

from errormodel.exceptions import InputError
from identification.runtime.engines import Crew, WorkerDiedError
from tests.helpers.nightly import first_of

CREWS = [Crew("local", 1), Crew("local", 2), Crew("dask", 2)]
# Dask's own clean-up, of sockets and tasks that its loop had not ended when the cluster closed
pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


def job(given: tuple[str, int, str]) -> int:
    """A job that does as its word says: fails, kills its worker each time or once, or gives a square."""
    word, number, folder = given
    if word == "fails":
        raise ValueError(f"job {number}")
    mark = Path(folder) / f"{number}"
    if word == "kills" or (word == "kills once" and not mark.exists()):
        mark.touch()
        os._exit(9)
    time.sleep(0.02)
    return number**2


def results(crew: Crew, jobs: list[tuple[str, int, str]]) -> dict[int, Any]:
    done: dict[int, Any] = {}
    for k, result in crew.each(job, jobs):
        assert k not in done
        done[k] = result
    return done


@pytest.mark.parametrize("crew", first_of(CREWS, 2), ids=lambda c: f"{c.engine}-{c.workers}")
def test_every_job_has_its_result_and_a_failure_stops_no_other(crew: Crew) -> None:
    done = results(crew, [("fails" if k == 3 else "", k, "") for k in range(9)])
    assert {k: v for k, v in done.items() if k != 3} == {k: k**2 for k in range(9) if k != 3}
    assert isinstance(done[3], ValueError)
    assert str(done[3]) == "job 3"
    assert results(crew, []) == {}


@pytest.mark.long
@pytest.mark.parametrize("ahead", [2, 12])
@pytest.mark.parametrize("crew", CREWS[1:], ids=lambda c: f"{c.engine}-{c.workers}")
def test_workers_may_die(crew: Crew, ahead: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One job kills its worker once, another whenever it runs: only that one fails, not those that wait behind it."""
    monkeypatch.setattr("identification.runtime.engines.AHEAD", ahead)
    words = {2: "kills once", 5: "kills"}
    done = results(crew, [(words.get(k, ""), k, str(tmp_path)) for k in range(12)])
    assert {k: v for k, v in done.items() if k != 5} == {k: k**2 for k in range(12) if k != 5}
    assert isinstance(done[5], WorkerDiedError)
    assert "its worker died" in str(done[5])


def test_a_cluster_whose_workers_do_not_start_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    import distributed

    whole = distributed.LocalCluster
    monkeypatch.setattr(distributed, "LocalCluster", lambda **options: whole(**options | {"n_workers": 0}))
    monkeypatch.setattr("identification.runtime.engines.NO_WORKER_S", 1.0)
    done = results(Crew("dask", 2), [("", k, "") for k in range(3)])
    assert [str(done[k]) for k in range(3)] == ["no worker of Dask has started for 1 s"] * 3


def test_the_dashboard_has_an_address() -> None:
    said: list[str] = []
    assert list(Crew("dask", 1, None, said.append).each(job, [("", 3, "")])) == [(0, 9)]
    assert len(said) == 1
    assert said[0].startswith("Dask dashboard: http://")


def test_a_scheduler_that_is_there_is_used() -> None:
    import distributed

    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0") as cluster:
        crew = Crew("dask", None, cluster.scheduler_address)
        crew.check()
        assert results(crew, [("", k, "") for k in range(4)]) == {k: k**2 for k in range(4)}


@pytest.mark.parametrize(
    ("crew", "message"),
    [
        (Crew("spark"), "--engine: 'spark'. Write one of local, dask"),  # type: ignore[arg-type]
        (Crew("local", 0), "--workers: 0"),
        (Crew("local", scheduler="tcp://x:1"), "Write --engine dask"),
        (Crew("dask", 2, "tcp://x:1"), "Leave out --workers or --scheduler"),
    ],
)
def test_wrong_choices_are_refused_before_any_work(crew: Crew, message: str) -> None:
    with pytest.raises(InputError, match=message):
        crew.check()


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("identification.runtime.engines.CONNECT_S", 0.5)
    with pytest.raises(InputError, match=r"tcp://127\.0\.0\.1:9: no Dask scheduler answers there"):
        list(Crew("dask", None, "tcp://127.0.0.1:9").each(job, [("", 1, "")]))


def test_without_dask_a_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *more: Any) -> Any:
        if name.startswith(("distributed", "dask")):
            raise ImportError(name)
        return real(name, *more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"Dask is not installed\. Install it \(pip install 'errormodel\[fleet\]'\)"):
        Crew("dask").check()
