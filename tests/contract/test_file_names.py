"""Names of files: those that are made are possible on every system, whatever joints are called; others are refused."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from errormodel.controllers import registry
from errormodel.controllers.base import Controller
from errormodel.files import impossible_on_windows
from identification.results import output_file
from tests.helpers import importing
from tests.helpers.commands import MILL, done, run, tree, write
from tests.helpers.nightly import first_of

ROOT = Path(__file__).resolve().parents[2]
TABLES = sorted(name for name, made in registry().items() if issubclass(made, Controller))
OFTEN = ("csv", "heidenhain", "isg", "linuxcnc-type1")  # two with a file for each axis, two with names of their own


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The fit of a mill with joints `aux`, `y` and `Y`, and a sensor `T_con`."""
    place = tmp_path_factory.mktemp("names")
    text = (ROOT / "machines" / f"{MILL}.yaml").read_text(encoding="utf-8")
    for old, new in (("X", "aux"), ("Y", "y"), ("Z", "Y")):
        text = re.sub(rf"\b{old}\b", new, text)
    write(place / "m.yaml", text)
    done("simulate", place / "m.yaml", 60, "--noise", 0.002, "--out", place / "s.csv")
    done("fit", place / "m.yaml", place / "s.csv", "--out", place / "fit")
    return place


@pytest.mark.parametrize("controller", first_of([*OFTEN, *(n for n in TABLES if n not in OFTEN)], len(OFTEN)))
def test_tables_have_names_for_every_system(controller: str, fitted: Path, tmp_path: Path) -> None:
    """A control's files go through a computer with Windows more often than not."""
    ended = run("compensate", fitted / "fit", "--controller", controller, "--points", 4, "--out", tmp_path / "t")
    if ended.code:
        assert ended.code == 2
        pytest.skip(ended.err)
    names = [*tree(tmp_path / "t"), *tree(fitted / "fit")]
    assert names
    assert {n: why for n in names for part in n.split("/") if (why := impossible_on_windows(part))} == {}
    ours = [n.casefold() for n in tree(tmp_path / "t")]
    assert len(set(ours)) == len(ours)
    assert all(n.isascii() and len(n) < 80 for n in names)  # room for the folder in the 260 characters of a path


@pytest.mark.parametrize(
    ("name", "possible"),
    [
        ("aux", False), ("AUX.csv", False), ("nul.tar.gz", False), ("com1.txt", False), ("LPT9", False),
        ("con .txt", False), ("CONOUT$", False), ("fit.", False), ("fit ", False),
        ("a:b.csv", False), ("what?.csv", False), ("a\tb", False),
        ("auxiliary.csv", True), ("com10.txt", True), ("console", True), (".", True), ("..", True), ("fit 2", True),
        ("Fräse.csv", True), (".hidden", True),
    ],
)  # fmt: skip
def test_names_that_windows_has(name: str, possible: bool) -> None:
    assert (impossible_on_windows(name) is None) is possible


@pytest.mark.parametrize("name", ["aux.csv", "results/con/p.csv", "p.csv."])
def test_such_an_output_is_refused_there(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(output_file, "WINDOWS", True)
    ended = run("simulate", MILL, 5, "--out", name)
    assert ended.code == 2
    assert "Windows" in ended.err
    assert tree(tmp_path) == {}
    done("simulate", MILL, 5, "--out", tmp_path / "p.csv")


def test_a_name_that_another_system_has_not_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(output_file, "WINDOWS", False)
    ended = run("simulate", MILL, 5, "--out", "a\nb.csv")
    assert (ended.code, ended.err.count("\n")) == (2, 1), ended.err
    assert r"the control character '\n'" in ended.err
    assert tree(tmp_path) == {}
    if sys.platform != "win32":
        assert done("simulate", MILL, 5, "--out", "aux.csv").err.startswith("note: aux.csv: a name that Windows keeps")


def test_raw_files_whose_names_differ_in_case_only(tmp_path: Path) -> None:
    """They are kept in one folder, which may be carried to a system where they would be one file."""
    readings = importing.spatialanalyzer(importing.points(importing.poses()))
    for name in ("a/Tracker.txt", "b/tracker.TXT"):
        write(tmp_path / name, readings)
    raws = (tmp_path / "a/Tracker.txt", tmp_path / "b/tracker.TXT")
    ended = run("import", *raws, "--machine", MILL, "--out", tmp_path / "s")
    assert ended.code == 2
    assert "two files of one name" in ended.err
    assert not (tmp_path / "s").exists()


def test_a_new_survey_beside_an_old_one_of_another_case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a folder does not distinguish case, the same file is found by either name, and nothing read is replaced."""
    monkeypatch.chdir(tmp_path)
    done("simulate", MILL, 5, "--out", "S.csv")
    if Path("s.csv").exists():  # such a folder
        assert run("simulate", MILL, "S.csv", "--out", "s.csv").code == 2
    else:
        done("simulate", MILL, "S.csv", "--out", "s.csv")
        assert len(tree(tmp_path)) == 3
