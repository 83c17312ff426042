"""``errormodel rerun``: the inputs found by name and digest, the results made anew and compared."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from errormodel.files import sha256
from tests.helpers.commands import MILL, Fill, done, run, tree, write

pytestmark = pytest.mark.every_figure


@pytest.fixture(scope="module")
def made(with_mill: Fill, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return with_mill(tmp_path_factory.mktemp("made"))


@pytest.fixture
def place(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(made, tmp_path / "w")
    monkeypatch.chdir(tmp_path / "w")
    return tmp_path / "w"


def test_the_same_bytes(place: Path) -> None:
    done("compensate", "fit", "--controller", "csv", "--points", 4, "--tool", 0, 0, -90, "--out", "tables")
    before = tree(place)
    for folder in ("fit", "tables"):
        assert f"{folder}: made anew" in done("rerun", folder).out
    assert tree(place) == before


@pytest.mark.long
def test_options_and_files_of_options(place: Path) -> None:
    write(Path("known/p.yaml"), "errormodel: 1\npriors:\n  X.dx.1: {low: -1, high: 1}\n")
    done("fit", MILL, "s.csv", "--robust", "--priors", "known/p.yaml", "--out", "r")
    done("rerun", "r")
    Path("known/p.yaml").unlink()
    result = run("rerun", "r")
    assert result.code == 2
    assert "p.yaml: no such input in" in result.err


@pytest.mark.long
def test_a_survey_with_its_files_and_a_folder(place: Path) -> None:
    write(Path("deep/er/survey.yaml"), "errormodel: 1\nfiles:\n  - {path: a.csv}\n")
    shutil.copy("s.csv", "deep/er/a.csv")
    done("fit", "fit", "deep/er/survey.yaml", "--out", "new")
    done("rerun", "new")
    write(Path("deep/er/a.csv"), Path("s.csv").read_text().replace("0.0,0.0,-100.0", "0.0,0.0,-100.5", 1))
    result = run("rerun", "new")
    assert result.code == 1
    assert "input a.csv: another content" in result.err


def test_inputs_elsewhere_and_changed(place: Path, tmp_path: Path) -> None:
    Path("s.csv").rename(tmp_path / "s.csv")
    result = run("rerun", "fit")
    assert result.code == 2
    assert "s.csv: no such input in" in result.err
    done("rerun", "fit", "--inputs", tmp_path)
    write(tmp_path / "s.csv", (tmp_path / "s.csv").read_text() + "\n")
    result = run("rerun", "fit", "--inputs", tmp_path)
    assert result.code == 2
    assert "s.csv: it was changed since the results were made" in result.err


def test_a_result_that_differs_is_named_with_how_much(place: Path) -> None:
    path = Path("fit/covariance.csv")
    first = path.read_text().split("\n")[1].split(",")[0]
    write(path, path.read_text().replace(first, repr(float(first) * 1.02), 1))
    data = json.loads(Path("fit/manifest.json").read_text())
    data["files"]["covariance.csv"] = sha256(path)
    write(Path("fit/manifest.json"), json.dumps(data))
    result = run("rerun", "fit")
    assert result.code == 1
    assert "covariance.csv: numbers that differ by up to 0.02 of their size" in result.err


@pytest.mark.parametrize("lost", ["fit/report.html", "fit/manifest.json"])
def test_what_is_not_whole_is_refused(place: Path, lost: str) -> None:
    Path(lost).unlink()
    assert run("rerun", "fit").code == 2


def test_a_manifest_without_arguments(place: Path) -> None:
    data = json.loads(Path("fit/manifest.json").read_text())
    del data["arguments"]
    write(Path("fit/manifest.json"), json.dumps(data))
    assert "does not say how to make it anew" in run("rerun", "fit").err
