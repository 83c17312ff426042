"""`errormodel monitor`: the normal range of each parameter, alarms, the history, and what may be wrong with a cycle."""

from __future__ import annotations

import json
import shutil
import sqlite3
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from errormodel.files import write_csv
from errormodel.machine_file import read_machine
from errormodel.survey import read_survey
from identification.estimation.fit import fit_machine
from identification.monitoring import monitor as stage
from identification.monitoring.alarms import look_at
from identification.monitoring.control_limits import USEFUL_CYCLES
from identification.monitoring.history import Record, opened
from identification.monitoring.quantities import NOISE_ID, Cycle, measured, watched
from identification.results import store
from tests.helpers.commands import MILL, Done, Fill, done, run, tree
from tests.helpers.machine_files import GANTRY
from tests.helpers.pages import Page

SCATTER = {"dy": 5e-3, "ea": 1e-4, "ec": 1.8e-5}  # mm, rad, of a reading
STEADY = {"dy": 0.028, "ea": 3.5e-4, "ec": 6.4e-5}


def cycle_table(seed: int, fault: dict[str, float] | None = None, points: int = 18) -> pd.DataFrame:
    """Readings of encoders and inertial unit along Y in one cycle."""
    rng = np.random.default_rng(seed)
    table = pd.DataFrame({"joint": "Y", "Y": np.linspace(-345, 30, points), "time": np.arange(points) / 2})
    for name, value in STEADY.items():
        level = value + (fault or {}).get(name, 0.0) + rng.normal(0, SCATTER[name] / 9)
        table[name] = level + rng.normal(0, SCATTER[name], points)
        table[f"u_{name}"] = SCATTER[name]
    return table


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a fit, with the history of 14 quiet cycles beside it in `with/`, without one in `bare/`."""
    work = tmp_path_factory.mktemp("gantry")
    (work / "gantry.yaml").write_text(GANTRY)
    write_csv(cycle_table(0), work / "first.csv")
    done("fit", work / "gantry.yaml", work / "first.csv", "--out", work / "bare", "--quiet")
    shutil.copytree(work / "bare", work / "with")
    for seed in range(1, 15):
        look(work / "with", cycle_table(seed), work / f"{seed}.csv")
    return work


def look(folder: Path, table: pd.DataFrame, path: Path, accept: bool = False) -> stage.Monitored:
    """What `monitor` does, without the page."""
    write_csv(table, path)
    kept = store.load(folder)
    return stage.monitored(folder, kept, read_survey(path, kept.chain.machine), 0.01, accept)


@pytest.fixture
def folder(fitted: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(fitted / "with", tmp_path / "fit"))


def monitor(folder: Path, table: pd.DataFrame, *options: str, name: str = "cycle.csv") -> Done:
    write_csv(table, folder.parent / name)
    return run("monitor", folder, folder.parent / name, *options)


# the command


@pytest.mark.long
def test_a_quiet_cycle_is_normal_and_the_same_survey_is_known_again(folder):
    first = monitor(folder, cycle_table(50))
    assert first.code == 0, first.err
    assert "cycle 15\n" in first.out
    assert "normal, beside 14 cycles; false alarms in 1 % of cycles at most" in first.out
    before = json.loads((folder / "monitor.json").read_text())
    again = monitor(folder, cycle_table(50), name="another_name.csv")
    assert "cycle 15, which the history has already" in again.out
    after = json.loads((folder / "monitor.json").read_text())
    assert len(after["history"]) == 15
    assert after["parameters"] == before["parameters"]


def test_racking_raises_an_alarm_in_words_and_stays_out_of_the_range_until_accepted(folder):
    racked = cycle_table(51, {"ec": 6e-5})
    result = monitor(folder, racked)
    assert result.code == 1  # for scripts
    assert not result.err
    assert "ALARM, not taken into the normal range (--accept): ECY (zero[Y, run 1].ec) left its range" in result.out
    headline = "Cycle 15: alarm. ECY (zero[Y, run 1].ec) left its range."
    assert headline in (folder / "monitor.html").read_text(encoding="utf-8")
    assert "ECY (zero[Y, run 1].ec) left its normal range: 12" in result.out
    assert "racking: compare both encoders" in result.out
    data = json.loads((folder / "monitor.json").read_text())
    assert (data["schema"], data["status"], data["accepted"]) == ("errormodel.monitor/1", "alarm", False)
    assert [a["kind"] for a in data["alarms"]] == ["range"]
    entry = next(p for p in data["parameters"] if p["id"] == "zero[Y, run 1].ec")
    assert entry["value"] > entry["high"] > STEADY["ec"] > entry["low"]
    assert entry["p_value"] < data["p_limit"] == 0.005

    assert "normal, beside 14 cycles" in monitor(folder, cycle_table(52), name="next.csv").out
    accepted = monitor(folder, racked, "--accept")
    assert accepted.code == 0
    assert "ALARM, accepted into the normal range" in accepted.out
    assert monitor(folder, racked).code == 0  # it is normal from now on
    assert "beside 16 cycles" in monitor(folder, cycle_table(53), name="later.csv").out

    page = Page((folder / "monitor.html").read_text(encoding="utf-8"))
    assert page.headings["h1"] == "Small H-gantry"
    assert [row[2] for row in page.tables["cycles-table"][1:]][-3:] == ["alarm, accepted", "normal", "normal"]
    assert all(e.get("src", "data:").startswith("data:") for _, e in page.elements)


def test_first_cycles_only_teach(fitted, tmp_path):
    folder = Path(shutil.copytree(fitted / "bare", tmp_path / "fit"))
    for seed in (1, 2, 3):
        out = monitor(folder, cycle_table(seed, {"ec": 1e-3 * (seed == 3)}), name=f"{seed}.csv").out
        assert f"learning: {seed - 1} earlier cycles; a range needs 3, and a useful one {USEFUL_CYCLES}" in out
    data = json.loads((folder / "monitor.json").read_text())
    assert (data["status"], data["alarms"], data["together_p_value"]) == ("learning", [], None)


def test_the_same_cycles_give_the_same_bytes(fitted, tmp_path):
    for name in ("a", "b"):
        folder = Path(shutil.copytree(fitted / "with", tmp_path / name / "fit"))
        write_csv(cycle_table(60, {"dy": 0.03}), tmp_path / "cycle.csv")
        assert run("monitor", folder, tmp_path / "cycle.csv").code == 1
    a, b = (tree(tmp_path / name / "fit") for name in ("a", "b"))
    for name in ("monitor.json", "monitor.html"):
        assert a[name] == b[name]


def test_slow_wear_is_a_drift_before_it_leaves_the_range(folder):
    kinds = []
    for number in range(1, 16):
        result = look(folder, cycle_table(100 + number, {"ea": 6e-6 * number}), folder.parent / f"w{number}.csv")
        kinds += [str(a["kind"]) for a in result.alarms]
        if kinds:
            break
    assert kinds[0] == "drift"
    assert "EAY (zero[Y, run 1].ea) drifts up" in str(result.alarms[0]["statement"])


def test_one_more_failure_leaves_history_and_pages_as_they_were(folder, monkeypatch):
    before = tree(folder)
    monkeypatch.setattr("identification.report.monitor.monitor_page", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        monitor(folder, cycle_table(61))
    after = tree(folder)
    assert after["monitor.sqlite"] == before["monitor.sqlite"]


# what is watched


def test_a_cycle_with_other_poses_and_another_frame_shows_the_same_groups(with_mill: Fill, tmp_path: Path):
    (tmp_path / "truth.yaml").write_text(
        "parameters: {X.dx.1: 0.03, Y.ea.1: 60e-6, saddle.ec: -60e-6, column.ea: 45e-6}\n"
        "frame: {translation: [1850, -420, 300], rotation: [0, 0, 40]}\n"
    )
    with_mill(tmp_path)
    how = ("--parameters", tmp_path / "truth.yaml", "--noise", 0.0005, "--seed", 7, "--out", tmp_path / "c.csv")
    done("simulate", MILL, 80, *how)
    kept = store.load(tmp_path / "fit")
    what = watched(kept)
    cycle = measured(what, fit_machine(kept.chain.machine, read_survey(tmp_path / "c.csv", kept.chain.machine)))
    assert not any("frame" in w.group for w in what)
    assert np.isfinite(cycle.values).all()
    truth = {"X.dx.1": 0.03, "Y.ea.1": 60e-6, "saddle.ec": -60e-6, "column.ea": 45e-6}
    expected = np.array([sum(c * truth.get(m, 0.0) for m, c in w.members.items()) for w in what[:-1]])
    away = (cycle.values[:-1] - expected) / cycle.std[:-1]
    assert np.abs(away).max() < 4.5
    assert any(expected != 0)
    assert cycle.values[-1] == pytest.approx(np.log(0.0005), abs=0.2)  # the scatter


def test_a_cycle_that_lacks_a_column_or_heights_says_what_it_does_not_show(folder):
    lacking = monitor(folder, cycle_table(70).drop(columns=["ec", "u_ec"]))
    assert "not shown by this cycle: 2 of 7 quantities (Y.ec.1, zero[Y, run 1].ec)" in lacking.out
    empty = cycle_table(71)
    empty.loc[3:5, "ea"] = np.nan  # a few readings less are no loss
    result = monitor(folder, empty, name="gaps.csv")
    assert result.code == 0
    assert "not shown" not in result.out


def test_rows_in_another_order_than_that_of_time_are_no_jump_of_the_clock(folder):
    shuffled = cycle_table(73).sample(frac=1, random_state=1)
    halves = cycle_table(74).iloc[[*range(9, 18), *range(9)]]
    for name, table in (("shuffled.csv", shuffled), ("halves.csv", halves)):
        look(folder, table, folder.parent / name)


def test_runs_may_be_labelled_otherwise(folder):
    out = monitor(folder, cycle_table(72).assign(run="tuesday")).out
    assert "not shown" not in out


def test_words_lead_to_the_cause(tmp_path):
    (tmp_path / "m.yaml").write_text(
        GANTRY.replace("shapes: none", "shapes: all") + "effects:\n  - {effect: backlash, joint: X}\n"
    )
    done("simulate", tmp_path / "m.yaml", 60, "--noise", 0.002, "--out", tmp_path / "s.csv")
    done("fit", tmp_path / "m.yaml", tmp_path / "s.csv", "--out", tmp_path / "fit")
    kept = store.load(tmp_path / "fit")
    words = {w.id: look_at(kept.chain, w) for w in watched(kept)}
    assert words["X.dx.backlash"].startswith("the backlash of X; to be sure: ")
    assert "scale or screw of Y" in words["Y.dy.1"]
    assert "twist of Y" in words["Y.eb.1"]
    assert "racking" in words["Y.ec.1"]
    assert "errormodel diagnose" in words[NOISE_ID]


def test_the_scatter_has_its_unit(fitted, tmp_path):
    done("simulate", MILL, 60, "--noise", 0.002, "--out", tmp_path / "s.csv")
    done("fit", MILL, tmp_path / "s.csv", "--out", tmp_path / "fit")
    noise = watched(store.load(tmp_path / "fit"))[-1]
    assert noise.shown_unit == "µm"
    assert noise.shown(np.log(0.002)) == pytest.approx(2.0)
    declared = watched(store.load(fitted / "bare"))[-1]  # of a declared uncertainty it is a ratio
    assert (declared.shown_unit, declared.shown(0.0)) == ("", 1.0)


# the history


def record(digest: str) -> Record:
    return Record(0, digest, "s.csv", "normal", False, (), Cycle(np.array([1.0, np.nan]), np.full((2, 2), np.nan)))


def test_cycles_from_several_runs_at_once_are_all_kept(tmp_path):
    def add(number: int) -> None:
        with opened(tmp_path / "h.sqlite", "model") as history:
            history.add(record(str(number)))
            history.commit()

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(add, range(24)))
    with opened(tmp_path / "h.sqlite", "model") as history:
        assert [r.number for r in history.records] == list(range(1, 25))
        assert {r.digest for r in history.records} == {str(n) for n in range(24)}
        assert np.isnan(history.records[0].cycle.values[1])


def test_another_run_is_waited_for_and_said(folder, monkeypatch):
    monkeypatch.setattr("identification.monitoring.history.LOCK_TIMEOUT_S", 0.1)
    held = sqlite3.connect(folder / "monitor.sqlite", isolation_level=None)
    held.execute("begin immediate")
    result = monitor(folder, cycle_table(62))
    held.close()
    assert result.code == 1
    assert "another run has held the history" in result.err


def garbage(path: Path) -> None:
    path.write_bytes(b"cycle;value\n1;2\n" * 200)


def torn(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:5000])


def overwritten(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[4096:12288] = bytes(8192)
    path.write_bytes(bytes(data))


def changed(sql: str) -> Callable[[Path], None]:
    def change(path: Path) -> None:
        with sqlite3.connect(path) as connection:
            connection.execute(sql)
        connection.close()

    return change


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        (lambda path: path.write_bytes(b""), "it is an empty file: the cycles that were learned are not in it"),
        (changed("drop table cycles"), "it has no table cycles: the cycles that were learned are not in it"),
        (changed("delete from about where key = 'model'"), "learned with another model than the fit in this folder"),
        (garbage, "it is damaged, or no history"),
        (torn, "damaged"),
        (overwritten, "damaged"),
        (changed("update cycles set estimates = x'0011' where number = 3"), "it cannot be read as a history"),
        (
            changed("update about set value = 'x' where key = 'model'"),
            "learned with another model than the fit in this folder",
        ),
    ],
)
def test_a_history_that_is_none_is_refused(folder, harm: Callable[[Path], None], said: str):
    harm(folder / "monitor.sqlite")
    before = tree(folder)
    result = monitor(folder, cycle_table(63))
    assert result.code == 2
    assert said in result.err
    assert "Move it away" in result.err
    assert [line for line in result.err.splitlines() if "note" not in line] == result.err.splitlines()[-1:]
    assert tree(folder) == before


def test_a_fit_of_another_machine_does_not_continue_the_history(folder):
    (folder.parent / "other.yaml").write_text(GANTRY.replace("polynomial: 1", "polynomial: 2"))
    write_csv(cycle_table(0), folder.parent / "first.csv")
    done("fit", folder.parent / "other.yaml", folder.parent / "first.csv", "--out", folder)
    result = monitor(folder, cycle_table(64))
    assert result.code == 2
    assert "learned with another model" in result.err


# a cycle that is wrong


def clock_back(table: pd.DataFrame) -> pd.DataFrame:
    return table.assign(time=np.where(table.index < 9, table["time"], table["time"] - 3))


def clock_ahead(table: pd.DataFrame) -> pd.DataFrame:
    return table.assign(time=np.where(table.index < 9, table["time"], table["time"] + 4e5))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (clock_back, "row 10, column time: the clock jumps back by 2.5 s"),
        (clock_ahead, "row 10, column time: the clock jumps ahead by 400000 s"),
        (lambda t: t.drop(columns="Y"), "no column for the joint 'Y'"),
        (lambda t: t.drop(columns=["dy", "ea", "ec"]), "no measured column"),
        (lambda t: t.assign(dy=np.nan, ea=np.nan, ec=np.nan), "nothing measured in any row"),
        (lambda t: t.head(1), "1 row with 3 measured values"),
        (lambda t: t.assign(joint="Z"), "Z"),
        (lambda t: t.assign(ea="tilted"), "tilted"),
    ],
)
def test_a_wrong_cycle_is_refused_and_nothing_is_written(folder, change, said):
    before = tree(folder)
    result = monitor(folder, change(cycle_table(65)))
    assert result.code == 2, result.out
    assert said in result.err
    assert tree(folder) == before


def test_a_survey_of_another_machine_is_refused(with_mill: Fill, tmp_path: Path):
    """One whose joints are called the same, but which goes elsewhere; and one with swapped columns."""
    with_mill(tmp_path)
    before = tree(tmp_path / "fit")
    other = (tmp_path / "fit" / "machine.yaml").read_text()
    machine = read_machine(tmp_path / "fit" / "machine.yaml")
    done("simulate", MILL, 60, "--seed", 3, "--noise", 0.002, "--out", tmp_path / "c.csv")
    table = pd.read_csv(tmp_path / "c.csv")
    assert other
    assert {"X", "Y", "Z"} == {j.name for j in machine.joints}
    swapped = table.rename(columns={"X": "Y", "Y": "X"})
    bent = table.assign(mx=table["mx"] + 2e-5 * (table["X"] - 300) ** 2)
    for name, wrong in (("swapped", swapped), ("bent", bent)):
        write_csv(wrong, tmp_path / f"{name}.csv")
        result = run("monitor", tmp_path / "fit", tmp_path / f"{name}.csv")
        assert result.code == 2, (name, result.out)
        assert "this machine" in result.err or "sound recordings" in result.err, result.err
    assert tree(tmp_path / "fit") == before


def test_what_is_no_fit_or_no_rate_is_refused(folder, tmp_path):
    write_csv(cycle_table(66), tmp_path / "c.csv")
    assert "Give the folder that `errormodel fit" in run("monitor", tmp_path, tmp_path / "c.csv").err
    result = run("monitor", folder, tmp_path / "c.csv", "--rate", 1.5)
    assert result.code == 2
    assert "--rate: 1.5" in result.err
