"""The same input gives the same bytes wherever the command is run; no cell of a table runs as a formula."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from errormodel.files import without_apostrophes, write_csv
from tests.helpers.commands import MILL, done, tree, write
from tests.helpers.nightly import first_of

pytestmark = pytest.mark.every_figure

ROOT = Path(__file__).resolve().parents[2]
FORMULAS = ("=1+1", "+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\t=1+1", " =HYPERLINK(1)", "'=1", "''+x", "-a")
HARMLESS = ("-5", "+3.5", "a=b", "1e-3", "run 1", "'a", "")


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    done("simulate", MILL, 60, "--noise", 0.002, "--out", "data/s.csv")
    write(Path("data/survey.yaml"), "errormodel: 1\nfiles:\n  - {path: s.csv}\n  - {path: sub/t.csv, role: test}\n")
    done("simulate", MILL, 20, "--noise", 0.002, "--seed", 4, "--out", "data/sub/t.csv")
    done("describe", MILL)
    return tmp_path


@pytest.mark.long
@pytest.mark.parametrize(
    ("command", "survey"), first_of([("fit", "survey.yaml"), ("fit", "sub"), ("diagnose", "s.csv")])
)
def test_from_another_folder(command: str, survey: str, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done(command, MILL, f"data/{survey}", "--out", "one")
    monkeypatch.chdir("data")
    done(command, MILL, survey, "--out", "../two")
    Path("deep/er").mkdir(parents=True)
    monkeypatch.chdir("deep/er")
    done(command, MILL, f"../../{survey}", "--out", place / "three")
    done(command, MILL, place / "data" / survey, "--out", place / "four")
    results = [tree(place / name) for name in ("one", "two", "three", "four")]
    assert results[0] == results[1] == results[2] == results[3]
    for name, content in results[0].items():
        assert str(place).encode() not in content, name
    for name in ("one", "four"):
        done("compensate", place / name, "--controller", "csv", "--points", 3, "--out", place / f"t_{name}")
        commands = place / "data/sub/t.csv"
        done("predict", place / name, commands, "--out", place / f"p_{name}.csv")
    assert (place / "p_one.csv").read_bytes() == (place / "p_four.csv").read_bytes()
    one, four = (tree(place / f"t_{name}") for name in ("one", "four"))
    assert {n: b for n, b in one.items() if n != "manifest.json"} == {
        n: b for n, b in four.items() if n != "manifest.json"
    }


@pytest.mark.long
def test_a_label_that_is_a_formula(place: Path) -> None:
    table = pd.read_csv("data/s.csv")
    table["run"] = [FORMULAS[k % 4] for k in range(len(table))]
    table.to_csv("data/f.csv", index=False)
    done("fit", MILL, "data/f.csv", "--out", "fit")
    cells = pd.read_csv("fit/residuals.csv")["run"]
    assert set(cells) == {f"'{label}" for label in FORMULAS[:4]}
    done("predict", "fit", "data/f.csv", "--out", "p.csv")
    done("predict", "fit", "p.csv", "--out", "again.csv")  # labels are read as they were before
    assert Path("p.csv").read_bytes() == Path("again.csv").read_bytes()
    done("compensate", "fit", "--controller", "csv", "--points", 3, "--out", "t")
    shutil.rmtree("t")


@given(st.lists(st.one_of(st.sampled_from((*FORMULAS, *HARMLESS)), st.text("=+-@' \tab1.", max_size=6)), min_size=1))
def test_apostrophes_come_and_go(tmp_path_factory: pytest.TempPathFactory, cells: list[str]) -> None:
    path = tmp_path_factory.mktemp("cells") / "t.csv"
    write_csv(pd.DataFrame({"run": cells, "x": 1.5}), path)
    read = pd.read_csv(path, dtype={"run": str}, keep_default_na=False)["run"]
    for cell in read:
        number = True
        try:
            float(cell)
        except ValueError:
            number = False
        assert number or cell.strip()[:1] not in ("=", "+", "-", "@") or not cell
    plain = [c for c in cells if not c.startswith("'")]
    assert [c for c, old in zip(without_apostrophes(read), cells, strict=True) if not old.startswith("'")] == plain


def test_cells_of_blanks_take_no_time() -> None:
    """The square of their length would be a minute."""
    begun = time.process_time()
    cells = pd.Series(["'" + " " * 200_000 + "x", "'" * 200_000 + "x"])
    assert list(without_apostrophes(cells)) == list(cells)
    assert time.process_time() - begun < 5.0


COMMANDS = f"""\
fit {MILL} ../data/s.csv --out fit
predict fit ../data/s.csv --out p.csv
compensate fit --controller siemens-cec --points 4 --out tables
"""
GERMAN = f"""
import locale
from identification.command_line.main import main
locale.setlocale(locale.LC_ALL, "")
assert locale.localeconv()["decimal_point"] == ","
for words in {COMMANDS.splitlines()}:
    try:
        main(words.split())
    except SystemExit as end:
        assert not end.code, words
"""


@pytest.mark.long
@pytest.mark.skipif(shutil.which("localedef") is None, reason="makes a locale with decimal commas")
def test_where_commas_are_decimal(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a program that sets the locale of its user and calls the commands."""
    made = ["localedef", "-i", "de_DE", "-f", "UTF-8", str(place / "de_DE.UTF-8")]
    if subprocess.run(made, check=False, capture_output=True).returncode > 1:
        pytest.skip("the system has no definition of a German locale")
    locale = {"PYTHONPATH": str(ROOT), "LOCPATH": str(place), "LC_ALL": "de_DE.UTF-8"}
    for name in ("german", "plain"):
        (place / name).mkdir()
    ended = subprocess.run(
        [sys.executable, "-c", GERMAN], cwd=place / "german", env=os.environ | locale, check=False, capture_output=True
    )
    assert ended.returncode == 0, ended.stderr.decode()
    monkeypatch.chdir(place / "plain")
    for words in COMMANDS.splitlines():
        done(*words.split())
    assert tree(place / "german") == tree(place / "plain")
