"""A folder of results: sealed, exchanged whole or not at all, with what other commands keep in it."""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from errormodel.exceptions import InputError
from errormodel.files import sha256, write_bytes_atomic
from identification.results import results_folder, store
from identification.results.results_folder import ResultsFolder
from tests.helpers.commands import MILL, Fill, done, run, tree, write
from tests.helpers.nightly import first_of
from tests.helpers.windows_rules import obey

ROOT = Path(__file__).resolve().parents[2]
WINDOWS = pytest.param(
    ("windows",), marks=pytest.mark.skipif(sys.platform != "linux", reason="its rules kept on Linux")
)


@pytest.fixture(scope="module")
def made(with_mill: Fill, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``s.csv fit/`` and, of another survey, ``other.csv other/``."""
    folder = with_mill(tmp_path_factory.mktemp("made"))
    done("simulate", MILL, 60, "--noise", 0.002, "--seed", 7, "--out", folder / "other.csv")
    done("fit", MILL, folder / "other.csv", "--out", folder / "other")
    return folder


@pytest.fixture(scope="module")
def robust(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fit of the other survey with other options."""
    folder = tmp_path_factory.mktemp("robust") / "fit"
    done("fit", MILL, made / "other.csv", "--robust", "--out", folder)
    return folder


@pytest.fixture
def place(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(made, tmp_path / "w")
    monkeypatch.chdir(tmp_path / "w")
    return tmp_path / "w"


REFIT = ("fit", MILL, "other.csv", "--out", "fit")


def held(folder: Path) -> dict[str, bytes]:
    """Every file of a folder but the record of single files."""
    return {name: content for name, content in tree(folder).items() if not name.startswith(".")}


# ---- the manifest


def test_the_manifest_seals_every_file(place: Path) -> None:
    data = json.loads(Path("fit/manifest.json").read_text())
    assert (data["schema"], data["command"], data["options"]["seed"]) == ("errormodel.manifest/1", "fit", 0)
    files = {p.name for p in Path("fit").iterdir()} - {"manifest.json"}
    assert {*data["files"]} == files
    assert all(sha256(Path("fit") / name) == digest for name, digest in data["files"].items())
    assert {i["name"]: i["sha256"] for i in data["inputs"]}["s.csv"] == sha256(Path("s.csv"))


@pytest.mark.every_figure
def test_the_same_command_gives_the_same_bytes(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(place / "s.csv", Path("s.csv").read_bytes())
    before = tree(Path("fit"))
    done("fit", MILL, "s.csv", "--out", "fit")
    first = tree(Path("fit"))
    Path("below").mkdir()
    shutil.copy("s.csv", "below")
    monkeypatch.chdir("below")
    done("fit", MILL, "s.csv", "--out", "fit")
    assert tree(Path("fit")) == first
    assert {*before} == {*first}


@pytest.mark.parametrize("name", ["machine.yaml", "covariance.csv", "fit.json", "residuals.csv", "report.html"])
@pytest.mark.parametrize("command", ["predict", "compensate", "monitor"])
def test_a_folder_of_two_fits_is_refused(place: Path, robust: Path, name: str, command: str) -> None:
    write(Path("fit") / name, (robust / name).read_bytes() + b"\n" * (name == "machine.yaml"))
    before = tree(place)
    commands = {
        "predict": ("predict", "fit", "s.csv", "--out", "p.csv"),
        "compensate": ("compensate", "fit", "--controller", "csv", "--out", "t"),
        "monitor": ("monitor", "fit", "s.csv"),
    }
    result = run(*commands[command])
    assert result.code == 2
    assert f"fit/{name}" in result.err, result.err
    assert tree(place) == before


def test_verify_says_what_is_wrong(place: Path) -> None:
    assert "all 6 files are as `errormodel fit` wrote them" in done("verify", "fit").out
    write(Path("fit/notes.txt"), "mine")
    assert "not looked at: notes.txt" in done("verify", "fit").err
    shutil.copy("other/residuals.csv", "fit")
    Path("fit/report.html").unlink()
    result = run("verify", "fit")
    assert result.code == 2
    assert "residuals.csv: changed" in result.err
    assert "report.html: missing" in result.err
    Path("fit/manifest.json").unlink()
    assert run("verify", "fit").code == 2


def test_verify_looks_at_other_results_inside(place: Path) -> None:
    done("compensate", "fit", "--controller", "csv", "--points", 4, "--out", "fit/tables")
    assert "files of 1 other result in it" in done("verify", "fit").out
    table = next(p for p in Path("fit/tables").iterdir() if p.suffix == ".csv")
    write(table, table.read_bytes() + b"\n")
    result = run("verify", "fit")
    assert result.code == 2
    assert f"fit/tables: {table.name}: changed" in result.err


def test_an_edited_machine_is_neither_used_nor_lost(place: Path) -> None:
    path = Path("fit/machine.yaml")
    write(path, path.read_text().replace("errors:", "# mine\nerrors:"))
    text = path.read_text()
    result = run("predict", "fit", "s.csv", "--out", "p.csv")
    assert result.code == 2
    assert "errormodel fit fit/machine.yaml SURVEY --out NEW" in result.err
    result = run(*REFIT)
    assert result.code == 2
    assert "fit/machine.yaml: it was changed since" in result.err
    done("fit", "fit/machine.yaml", "s.csv", "--out", "new")
    done("predict", "new", "s.csv", "--out", "p.csv")
    assert path.read_text() == text


def test_a_manifest_of_a_version_to_come_is_refused(place: Path) -> None:
    path = Path("fit/manifest.json")
    write(path, path.read_text().replace("manifest/1", "manifest/9"))
    for command in (("predict", "fit", "s.csv", "--out", "p.csv"), REFIT):
        result = run(*command)
        assert result.code == 2
        assert "manifest/9" in result.err


# ---- replaced as a whole


def test_nothing_of_an_old_diagnosis_stays(place: Path) -> None:
    done("diagnose", MILL, "s.csv", "--out", "fit")
    assert Path("fit/diagnosis.json").exists()
    done(*REFIT)
    assert held(Path("fit")).keys() == held(Path("other")).keys()


def test_tables_of_two_controllers_never_lie_together(place: Path) -> None:
    done("compensate", "fit", "--controller", "linuxcnc-type0", "--out", "fit/tables")
    first = {*tree(Path("fit/tables"))}
    done("compensate", "fit", "--controller", "csv", "--out", "fit/tables")
    done("compensate", "fit", "--controller", "csv", "--out", "alone")
    assert {*tree(Path("fit/tables"))} == {*tree(Path("alone"))} != first


def test_what_other_commands_keep_stays(place: Path) -> None:
    done("monitor", "fit", "s.csv")
    done("compensate", "fit", "--controller", "csv", "--out", "fit/tables")
    done("predict", "fit", "s.csv", "--out", "fit/p.csv")
    write(Path("fit/chain/piece_0123456789ab_0000.npz"), b"piece")
    names = ("monitor.sqlite", "monitor.json", "monitor.html", "p.csv", "chain/piece_0123456789ab_0000.npz")
    before = {n: b for n, b in tree(Path("fit")).items() if n in names or n.startswith("tables/")}
    assert len(before) > len(names) + 3
    done("fit", MILL, "s.csv", "--out", "fit")
    result = done(*REFIT)
    after = tree(Path("fit"))
    assert {n: after[n] for n in before} == before
    assert "fit/tables stays, and was made from the fit that was here before" in result.err
    result = done("fit", MILL, "other.csv", "--out", "fit")
    write(Path("fit/tables/mine.txt"), "mine")  # a folder of another result is not touched, whatever it holds
    done("fit", MILL, "s.csv", "--out", "fit")
    assert Path("fit/tables/mine.txt").exists()


def test_the_history_goes_on_after_the_same_fit(place: Path) -> None:
    done("monitor", "fit", "s.csv")
    done("fit", MILL, "s.csv", "--out", "fit")
    assert "cycle 2" in done("monitor", "fit", "other.csv").out


@pytest.mark.parametrize("name", ["notes.txt", "machine.yml", "sub/notes.txt", ".git/config", "chain/mine.txt"])
def test_what_is_not_ours_is_named_and_stays(place: Path, name: str) -> None:
    write(Path("fit") / name, "mine")
    before = tree(place)
    result = run(*REFIT)
    assert result.code == 2
    assert "fit/" + name.split("/", maxsplit=1)[0] in result.err, result.err
    assert tree(place) == before


def test_folders_of_versions_without_a_manifest(place: Path) -> None:
    Path("fit/manifest.json").unlink()
    done("predict", "fit", "s.csv", "--out", "p.csv")
    edited = Path("fit/machine.yaml").read_text() + "# mine\n"
    shutil.copytree("fit", "edited")
    write(Path("edited/machine.yaml"), edited)
    result = run("fit", MILL, "s.csv", "--out", "edited")
    assert result.code == 2
    assert "edited/machine.yaml" in result.err
    assert Path("edited/machine.yaml").read_text() == edited
    done(*REFIT)
    assert Path("fit/manifest.json").exists()
    Path("half").mkdir()
    shutil.copy("fit/machine.yaml", "half")
    assert run("fit", MILL, "s.csv", "--out", "half").code == 2


# ---- killed, failing, two at once


FILES = ("fit.json", "machine.yaml", "covariance.csv", "parameters.csv", "residuals.csv")
STEPS = {name: getattr(os, name) for name in ("replace", "rename", "fsync")}


class Failing:
    """Calls of the system of which the one with a given number fails."""

    def __init__(self, step: int) -> None:
        self.step, self.count = step, 0

    def stand_in(self, name: str) -> Callable[..., object]:
        def call(*arguments: Any, **options: Any) -> object:
            self.count += 1
            if self.count == self.step + 1:
                raise OSError(28, "No space left on device")
            return STEPS[name](*arguments, **options)

        return call


@pytest.mark.parametrize("swap", [True, False])
def test_a_failure_at_any_step_leaves_a_whole_folder(place: Path, monkeypatch: pytest.MonkeyPatch, swap: bool) -> None:
    """Every rename, replacement and flush of a command fails in turn: the old results are there, or the new ones."""
    if not swap:
        monkeypatch.setattr(results_folder, "_swapped", lambda *_: False)
    done("predict", "fit", "s.csv", "--out", "fit/p.csv")  # something to carry over
    old, failures = tree(Path("fit")), 0
    shutil.copytree("fit", "kept")
    for step in range(60):
        shutil.rmtree("fit")
        shutil.copytree("kept", "fit")
        failing = Failing(step)
        with monkeypatch.context() as patch, suppress(InputError):
            for name in STEPS:
                patch.setattr(os, name, failing.stand_in(name))
            with ResultsFolder(Path("fit")).replaced() as part:
                for file in FILES:
                    write_bytes_atomic(Path("other", file).read_bytes(), part / file)
        here = tree(Path("fit"))
        if here != old:
            assert {*here} == {*FILES, "manifest.json", "p.csv", ".errormodel.sha256"}
            store.load(Path("fit"))
        failures += here == old
        assert not [p.name for p in place.iterdir() if p.name.startswith(".fit")]
        if failing.count <= step:
            break
    assert here != old
    assert failures >= len(FILES) + 1


SAVING = """
import itertools, sys, time
from pathlib import Path
from identification.results import results_folder
from identification.results.results_folder import ResultsFolder
if "plain" in sys.argv:
    results_folder._swapped = lambda *_: False
if "windows" in sys.argv:
    import pytest
    from tests.helpers.windows_rules import obey
    obey(pytest.MonkeyPatch())
for k in itertools.count(int(sys.argv[3])):
    source = Path(sys.argv[1 + k % 2])
    with ResultsFolder(Path("fit")).replaced() as part:
        for file in source.iterdir():
            if file.name != "manifest.json" and file.is_file():
                (part / file.name).write_bytes(file.read_bytes())
    print(k, flush=True)
    time.sleep(0.02)
"""


def saving(*arguments: object) -> subprocess.Popen[str]:
    """A process that saves two results in turn, for ever."""
    command = [sys.executable, "-c", SAVING, *map(str, arguments)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert process.stdout is not None
    process.stdout.readline()
    return process


def end(process: subprocess.Popen[str]) -> None:
    """Kill it, whatever it is at."""
    process.kill()
    process.wait()
    assert process.stdout is not None
    process.stdout.close()


def sorts(place: Path) -> list[dict[str, bytes]]:
    """The contents that a whole folder may have, manifests apart."""
    return [{n: b for n, b in tree(place / name).items() if n != "manifest.json"} for name in ("one", "two")]


@pytest.fixture
def two(place: Path) -> Path:
    """Two results of other files, ``one/ two/``, and a folder that is to hold one of them."""
    shutil.copytree("fit", "one")
    shutil.copytree("other", "two")
    write(Path("one/more.json"), "{}")  # which no reader of fits looks at
    return place


@pytest.mark.parametrize("system", first_of([(), ("plain",), WINDOWS], whole=True))
def test_killed_at_any_moment(two: Path, system: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    whole, rng = sorts(two), random.Random(1)
    if system == ("windows",):
        obey(monkeypatch)
    for _ in range(8):
        process = saving("one", "two", 0, *system)
        time.sleep(rng.uniform(0.0, 0.06))
        end(process)
        store.load(Path("fit"))  # which recovers a folder that was aside
        assert {n: b for n, b in tree(Path("fit")).items() if n != "manifest.json"} in whole
    done("fit", MILL, "s.csv", "--out", "fit")
    assert not [p for p in two.iterdir() if p.name.startswith(".fit")]  # nothing is left of those that were killed


@pytest.mark.parametrize("system", [(), WINDOWS])
def test_two_writers_and_a_reader(two: Path, system: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    whole = sorts(two)
    if system == ("windows",):
        obey(monkeypatch)
    processes = [saving("one", "two", k, *system) for k in (0, 1)]
    try:
        values = [store.load(Path(name)).values for name in ("one", "two")]
        for _ in range(20):
            assert store.load(Path("fit")).values in values
    finally:
        for process in processes:
            end(process)
    store.load(Path("fit"))  # which recovers a folder that was aside
    assert {n: b for n, b in tree(Path("fit")).items() if n != "manifest.json"} in whole


def test_a_folder_that_was_aside_is_put_back(place: Path) -> None:
    before = tree(Path("fit"))
    Path("fit").rename(".fit.old")
    done("predict", "fit", "s.csv", "--out", "p.csv")
    assert tree(Path("fit")) == before


@pytest.mark.parametrize("where", [".", "..", "fit/.."])
def test_where_one_stands_is_not_exchanged(place: Path, where: str, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("in/side").mkdir(parents=True)
    monkeypatch.chdir("in/side")
    Path("fit").mkdir()
    result = run("fit", MILL, place / "s.csv", "--out", where)
    assert result.code == 2
    assert "cannot be exchanged" in result.err


def test_a_failed_report_leaves_the_old_results(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = tree(place)
    monkeypatch.setattr("identification.report.report", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run(*REFIT)
    assert tree(place) == before


def test_what_was_replaced_is_said(with_mill: Fill, tmp_path: Path) -> None:
    """Tables of another controller, and a diagnosis that a fit takes the place of."""
    with_mill(tmp_path)
    tables = ("compensate", tmp_path / "fit", "--points", 5, "--out", tmp_path / "t", "--controller")
    assert "replaced" not in done(*tables, "linuxcnc-type0").err
    assert "replaced" not in done(*tables, "linuxcnc-type0").err
    said = done(*tables, "linuxcnc-type1").err
    assert f"replaced the tables of linuxcnc-type0 in {tmp_path / 't'}" in said
    done("diagnose", MILL, tmp_path / "s.csv", "--out", tmp_path / "d")
    said = done("fit", MILL, tmp_path / "s.csv", "--out", tmp_path / "d").err
    gone = "decisions.csv, diagnosis.json are gone"
    assert f"replaced the results of `errormodel diagnose` in {tmp_path / 'd'}: {gone}" in said
