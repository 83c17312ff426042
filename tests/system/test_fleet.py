"""A command on every survey of a fleet: parts that are taken up, failures kept apart, the same bytes whoever works."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from errormodel.exceptions import InputError
from identification import fleet
from identification.fleets.listing import read_list
from tests.helpers.commands import MILL, done, run, tree, write
from tests.helpers.fleets import fleet_of, mill_fleet
from tests.helpers.nightly import first_of

ROOT = Path(__file__).resolve().parents[2]
MACHINES, ODD = 7, 4


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Surveys of seven mills, one of them with a scale that is off, and their fleet: ``list.csv out/``."""
    folder = tmp_path_factory.mktemp("fleet")
    mill_fleet(folder, MACHINES, odd=[ODD])
    done("fleet", folder / "list.csv", "--out", folder / "out", "--workers", 1)
    return folder


@pytest.fixture
def place(made: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    shutil.copytree(made, tmp_path / "w")
    return tmp_path / "w"


def times(out: Path) -> dict[str, int]:
    """When each part was written."""
    return {p.parent.name: p.stat().st_mtime_ns for p in out.glob("parts/*/[!.]*/part.json")}


# ---- what comes out


def test_the_odd_machine_is_found_and_said(made: Path) -> None:
    data = json.loads((made / "out/fleet.json").read_text())
    assert (data["schema"], data["machines"], data["surveys"], data["failed"]) == ("errormodel.fleet/1", 7, 7, 0)
    assert [v["id"] for v in data["visit_first"]] == [f"M{ODD:02d}"]
    assert "EXX (X.dx.1)" in data["visit_first"][0]["why"]
    assert any(c["name"] == "X.dx.1" and c["type"] == "mill" for c in data["common"])
    machines = pd.read_parquet(made / "out/machines.parquet")
    assert list(machines["id"][machines["out"]]) == [f"M{ODD:02d}"]
    assert list(machines["rank"]) == list(range(1, 8))
    assert set(machines["hall"]) == {"A", "B"}


def test_tables_agree_with_the_parts(made: Path) -> None:
    surveys = pd.read_parquet(made / "out/surveys.parquet")
    parameters = pd.read_parquet(made / "out/parameters.parquet")
    for _, row in surveys.iterrows():
        part = made / "out" / row["part"]
        fit = json.loads((part / "fit.json").read_text())
        own = parameters[parameters["row"] == row["row"]].set_index("parameter")
        known = {p["id"]: p for p in fit["parameters"] if p["id"] in own.index}
        assert len(known) > 15
        assert own.loc[list(known), "value"].tolist() == [p["value"] for p in known.values()]
        assert own.loc[list(known), "std"].tolist() == pytest.approx([p["std"] for p in known.values()], rel=1e-12)
        assert row["rms_um"] == fit["fitted"]["rms_um"]
        done("verify", part)
    for table in ("machines", "surveys", "parameters", "normal", "standing", "common"):
        assert len(pd.read_csv(made / f"out/{table}.csv")) == len(pd.read_parquet(made / f"out/{table}.parquet")) > 0
    done("verify", made / "out")


@pytest.mark.long
@pytest.mark.every_figure
def test_a_fleet_is_made_anew(made: Path) -> None:
    done("rerun", made / "out", "--inputs", made)


def test_the_page_shows_all_that_matters(made: Path) -> None:
    text = (made / "out/fleet.html").read_text()
    for words in (
        "7 machines of 1 type, 7 surveys: 1 is out",
        f"M{ODD:02d}",
        "EXX",
        "What is normal",
        "data:image/svg",
    ):
        assert words in text
    assert "http" not in re.sub(r"http://www\.w3\.org\S*|data:image[^\"]*", "", text)


@pytest.mark.long
@pytest.mark.every_figure
def test_a_part_is_what_the_command_writes(made: Path, tmp_path: Path) -> None:
    rows = (made / "list.csv").read_text().splitlines()[:2]
    write(tmp_path / "list.csv", "\n".join(rows).replace("data/", f"{made}/data/") + "\n")
    done("fleet", tmp_path / "list.csv", "--out", tmp_path / "out", "--workers", 1, "--reports")
    done("fit", MILL, made / "data/m0_0.csv", "--out", tmp_path / "fit")
    (part,) = (tmp_path / "out/parts/M00").iterdir()
    own, alone = tree(part), tree(tmp_path / "fit")
    assert own.keys() - alone.keys() == {"part.json"}
    assert {n: b for n, b in own.items() if n not in ("part.json", "manifest.json")} == {
        n: b for n, b in alone.items() if n != "manifest.json"
    }
    assert str(made) not in (part / "part.json").read_text()
    done("predict", part, made / "data/m1_0.csv", "--out", tmp_path / "p.csv")


# ---- whoever works


@pytest.mark.long
@pytest.mark.every_figure
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize(
    "words", first_of([("--workers", 2), ("--engine", "dask", "--workers", 2)], whole=True), ids=["processes", "dask"]
)
def test_the_same_bytes_whoever_works(words: tuple[object, ...], made: Path) -> None:
    again = made / f"again_{words[1]}"
    result = done("fleet", made / "list.csv", "--out", again, *words)
    assert tree(again) == tree(made / "out")
    assert ("Dask dashboard: http://" in result.out) == ("dask" in words)
    assert "100 %  7 of 7" in result.out


@pytest.mark.long
@pytest.mark.every_figure
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="children are found in /proc")
def test_a_worker_that_is_killed_costs_nothing(made: Path, tmp_path: Path) -> None:
    """Two workers; one is killed as soon as a part is there."""
    out = tmp_path / "out"
    process = started("fleet", made / "list.csv", "--out", out, "--workers", 2)
    wait_for(out, 1)
    workers = [c for c in children(process.pid) if b"spawn_main" in Path(f"/proc/{c}/cmdline").read_bytes()]
    assert len(workers) == 2
    os.kill(workers[0], signal.SIGKILL)
    said, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert tree(out) == tree(made / "out")
    assert "failed" not in said


@pytest.mark.long
@pytest.mark.every_figure
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("name", first_of(["SIGINT", "SIGKILL"]), ids=["Ctrl-C", "killed"])
def test_a_run_that_was_stopped_goes_on_where_it_was(name: str, made: Path, tmp_path: Path) -> None:
    how = signal.Signals[name]
    out = tmp_path / "out"
    process = started("fleet", made / "list.csv", "--out", out, "--workers", 2)
    wait_for(out, 2)
    process.send_signal(how)
    _, said = process.communicate(timeout=60)  # hangs where a worker of it goes on
    assert process.returncode == (130 if how == signal.SIGINT else -how)
    before = times(out)
    if how == signal.SIGINT:
        assert re.search(rf"stopped: {len(before)} of 7 parts are kept in .*same command goes on", said)
    assert 2 <= len(before) < MACHINES
    result = done("fleet", made / "list.csv", "--out", out, "--workers", 1)
    assert f"{len(before)} parts were finished before, and taken up" in result.out
    assert {k: t for k, t in times(out).items() if k in before} == before
    assert tree(out) == tree(made / "out")


def started(*arguments: object) -> subprocess.Popen[str]:
    # interrupted like a command in a terminal, where these tests themselves run in the background and are not
    start = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    start += "from identification.command_line.start import entry; entry()"
    return subprocess.Popen(
        [sys.executable, "-c", start, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip


def wait_for(out: Path, parts: int) -> None:
    until = time.monotonic() + 240
    while len(times(out)) < parts:
        assert time.monotonic() < until
        time.sleep(0.02)


def children(process: int) -> list[int]:
    lists = Path(f"/proc/{process}/task").glob("*/children")
    return [int(c) for text in (p.read_text() for p in lists) for c in text.split()]


# ---- what is taken up


@pytest.mark.every_figure
def test_what_is_finished_is_taken_up_and_what_changed_is_made_anew(place: Path) -> None:
    out = place / "out"
    before, results = times(out), tree(out)
    shutil.rmtree(out / "parts/M03")
    (changed,) = (out / "parts/M02").glob("*/residuals.csv")
    write(changed, changed.read_text() + "\n")
    survey = place / "data/m1_0.csv"
    write(survey, "\n".join(survey.read_text().splitlines()[:-1]) + "\n")
    write(place / "list.csv", (place / "list.csv").read_text().replace(",A\n", ",C\n"))  # labels may change
    refused = run("fleet", place / "list.csv", "--out", out, "--workers", 1)
    assert refused.code == 2
    assert "residuals.csv: it was changed since errormodel wrote it" in refused.err
    assert times(out) == {k: t for k, t in before.items() if not k.startswith("m3_0")}  # before any work
    shutil.rmtree(changed.parent)
    result = done("fleet", place / "list.csv", "--out", out, "--workers", 1)
    assert "4 parts were finished before" in result.out
    after = times(out)
    assert sorted(k.partition("-")[0] for k in after if after[k] != before[k]) == ["m1_0", "m2_0", "m3_0"]
    again = tree(out)
    same = [n for n in again if n.startswith(("parts/M02/", "parts/M03/"))]
    assert same
    assert all(again[n] == results[n] for n in same)
    assert set(pd.read_csv(out / "machines.csv")["hall"]) == {"B", "C"}


# ---- failures


@pytest.mark.every_figure
def test_a_survey_that_fails_stops_no_other(place: Path) -> None:
    survey = place / "data/m2_0.csv"
    good = survey.read_bytes()
    write(survey, re.sub(rb"(?m)^(-?[\d.]+),", b"abc,", good, count=1))
    (place / "data/m5_0.csv").rename(place / "data/m5.csv")
    result = run("fleet", place / "list.csv", "--out", place / "new", "--workers", 1)
    assert result.code == 1
    assert "2 of 7 surveys failed" in result.out
    assert "row 3, M02: data/m2_0.csv, row" in result.out
    assert "no such file" in result.out
    table = pd.read_csv(place / "new/failures.csv")
    assert list(table["id"]) == ["M02", "M05"]
    assert not table["message"].str.contains(str(place), regex=False).any()
    assert table["wrong_input"].all()
    assert (pd.read_csv(place / "new/surveys.csv")["status"] == "failed").sum() == 2
    machines = pd.read_csv(place / "new/machines.csv").set_index("id")
    assert list(machines.index[machines["state"] == "no result"]) == ["M02", "M05"]
    assert "Surveys that failed" in (place / "new/fleet.html").read_text()
    write(survey, good)
    (place / "data/m5.csv").rename(place / "data/m5_0.csv")
    assert "5 parts were finished" in done("fleet", place / "list.csv", "--out", place / "new", "--workers", 1).out
    assert tree(place / "new") == tree(place / "out")


def test_a_run_that_is_stopped_leaves_the_failures_known_until_then(made: Path, tmp_path: Path) -> None:
    rows = (made / "list.csv").read_text().replace("data/", f"{made}/data/").splitlines()[:4]
    write(tmp_path / "list.csv", "\n".join(rows).replace("m1_0", "m1_9").replace("m2_0", "m2_9") + "\n")
    seen = []

    def stop(text: str) -> None:
        seen.append(pd.read_csv(tmp_path / "out/parts/failures.csv"))  # there before anything else is said
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stopped:
        fleet(tmp_path / "list.csv", tmp_path / "out", warn=stop)
    known = tmp_path / "out/parts/failures.csv"
    assert stopped.value.args[1].endswith(f"; 1 failed, named in {known}")
    assert list(seen[0]["id"]) == ["M01"]
    first = known.read_text()
    write(known, "mine\n")
    with pytest.raises(InputError, match=r"failures.csv|parts"):
        fleet(tmp_path / "list.csv", tmp_path / "out")
    write(known, first)
    fleet(tmp_path / "list.csv", tmp_path / "out")
    assert not known.exists()
    whole = (tmp_path / "out/failures.csv").read_text()
    assert whole.startswith(first)
    assert len(whole.splitlines()) == 3


def test_a_fleet_of_which_all_fails_says_so(tmp_path: Path) -> None:
    write(tmp_path / "list.csv", "machine,survey\nno_such_machine,a.csv\n")
    result = run("fleet", tmp_path / "list.csv", "--out", tmp_path / "out", "--workers", 1)
    assert result.code == 1
    assert "1 of 1 survey failed" in result.out
    assert "no_such_machine" in result.out
    assert "Traceback" not in result.err
    assert "note: row 1, no_such_machine: " in result.err  # as it happens


LISTS = {
    "no column": ("machine,surveys\na,b\n", "list.csv, header: no column 'survey'.*Did you mean 'surveys'"),
    "empty": ("machine,survey\na,b\na,\n", r"list.csv, row 2 \(line 3\), column survey: an empty cell"),
    "no row": ("machine,survey\n", "list.csv: no row"),
    "twice": ("machine,survey\na,b\na,b\n", r"row 2 \(line 3\), column survey: 'b' stands for a in row 1"),
    "twice, otherwise": ("machine,survey\na,b.csv\na,x/../b.csv\n", r"row 2 \(line 3\), column survey: .* row 1"),
    "date": ("machine,survey,date\na,b,31.3.2026\n", r"column date: '31.3.2026'. Write a date as 2026-03-31"),
    "no such day": ("machine,survey,date\na,b,2026-13-31\n", r"column date: '2026-13-31'"),
    "types": ("machine,survey,id,type\na,b,1,T\na,c,1,U\n", r"row 2 \(line 3\), column type: 'U', and 'T'.*row 1"),
    "label": ("machine,survey,rank\na,b,1\n", "header: a column 'rank', which the tables of results have, too"),
    "header": ("machine,survey,machine\na,b,c\n", "header"),
}


@pytest.mark.parametrize("what", LISTS)
def test_a_list_that_is_wrong_is_refused_with_row_and_column(what: str, tmp_path: Path) -> None:
    text, message = LISTS[what]
    write(tmp_path / "list.csv", text)
    result = run("fleet", tmp_path / "list.csv", "--out", tmp_path / "out")
    assert (result.code, result.out) == (2, "")
    assert re.search(message, result.err), result.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--scheduler", "tcp://x:1"), "Write --engine dask"),
        (("--rate", "0.7"), "between 0 and 0.5"),
        (("--command", "iso", "--standard", "230-9"), "230-9"),
        (("--workers", "0"), "--workers"),
    ],
)
def test_an_option_that_is_wrong_is_refused(words: tuple[str, ...], message: str, made: Path, tmp_path: Path) -> None:
    result = run("fleet", made / "list.csv", "--out", tmp_path / "out", *words)
    assert result.code == 2
    assert message in result.err
    assert not (tmp_path / "out").exists()


def test_no_folder_of_others_is_replaced(made: Path, tmp_path: Path) -> None:
    write(tmp_path / "out/parts/mine.txt", "mine")
    result = run("fleet", made / "list.csv", "--out", tmp_path / "out", "--workers", 1)
    assert result.code == 2
    assert "errormodel did not write it" in result.err
    assert tree(tmp_path / "out") == {"parts/mine.txt": b"mine"}


# ---- lists and places


def test_a_list_is_parquet_or_in_a_store(made: Path, tmp_path: Path) -> None:
    import fsspec

    table = pd.read_csv(made / "list.csv", dtype=str)
    table.to_parquet(tmp_path / "list.parquet", index=False)
    assert read_list(tmp_path / "list.parquet").rows == read_list(made / "list.csv").rows
    store = fsspec.filesystem("memory")
    yaml = "errormodel: 1\nfiles: [{path: m0_0.csv}]\n"
    store.pipe("/shop/data/m0_0.csv", (made / "data/m0_0.csv").read_bytes())
    store.pipe("/shop/data/survey.yaml", yaml.encode())
    store.pipe("/shop/mill.yaml", (ROOT / f"machines/{MILL}.yaml").read_bytes())
    listed = "machine,survey,id\nmill.yaml,data/m0_0.csv,a\nmill.yaml,data/survey.yaml,b\nmill.yaml,data/none.csv,c\n"
    store.pipe("/shop/list.csv", listed.encode())
    result = fleet("memory://shop/list.csv", tmp_path / "out")
    assert list(result.surveys["status"]) == ["done", "done", "failed"]
    assert "no such file" in result.failures["message"].iloc[0]
    here = pd.read_parquet(made / "out/parameters.parquet")
    own = here.loc[here["id"] == "M00", "value"].tolist()
    for identity in "ab":
        assert result.parameters.loc[result.parameters["id"] == identity, "value"].tolist() == own
    again = fleet("memory://shop/list.csv", tmp_path / "out")
    assert again.taken == 2


@pytest.mark.long
def test_monitor_watches_on_a_copy_and_by_date(made: Path, tmp_path: Path) -> None:
    (fit,) = (made / "out/parts/M00").iterdir()
    shutil.copytree(fit, tmp_path / "fit")
    before = tree(tmp_path / "fit")
    lines = [f"fit,{made}/data/m{k}_0.csv,M00,2026-0{4 - n}-01" for n, k in enumerate((ODD, 2, 1, 0))]
    result = fleet_of(tmp_path, "machine,survey,id,date\n" + "\n".join(lines) + "\n", "--command", "monitor")
    assert result.code == 0, result.err
    assert tree(tmp_path / "fit") == before
    table = pd.read_csv(tmp_path / "out/surveys.csv")
    assert list(table["verdict"][1:]) == ["learning"] * 3
    assert table["part"].nunique() == 1
