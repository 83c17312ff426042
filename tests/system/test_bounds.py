"""Whatever is read ends soon: no pipe is waited for, nothing is read beyond its bound, too little memory is said."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from errormodel import library
from tests.helpers.commands import MILL, done, run, write

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="pipes, names and limits of POSIX")
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    done("simulate", MILL, 60, "--noise", 0.002, "--out", folder / "s.csv")
    return folder


@pytest.fixture
def place(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def table(columns: int, rows: int = 1) -> str:
    names = ",".join(f"c{k}" for k in range(columns))
    return f"X,Y,Z,mx,my,mz,{names}\n" + rows * f"1,2,3,1,2,3,{','.join(['1'] * columns)}\n"


def machine(more: str) -> str:
    return library()[MILL].read_text(encoding="utf-8") + more


def shapes(count: int) -> str:
    head = "errormodel: 1\nchain:\n  - {joint: X, type: prismatic, axis: x, travel: [0, 500]}\n"
    return head + "".join(f"  - {{shape: T{k}}}\n" for k in range(count))


LARGE: dict[str, tuple[str, Callable[[], str], str]] = {
    "a million columns": ("w.csv", lambda: table(1_000_000), "w.csv, header: more than 10000 columns"),
    "20 000 columns": ("w.csv", lambda: table(20_000, 20), "w.csv, header: more than 10000 columns"),
    "a header without an end": ("w.csv", lambda: "X" * 3_000_000, "w.csv"),
    "30 000 effects": (
        "m.yaml", lambda: machine("effects:\n" + 30_000 * "  - {effect: backlash, joint: X}\n"), "m.yaml: longer"),
    "300 effects": (
        "m.yaml", lambda: machine("effects:\n" + 300 * "  - {effect: backlash, joint: X}\n"), "at most 200"),
    "1000 shapes": ("m.yaml", lambda: shapes(1000), "at most 150"),
    "a name of 1000 letters": ("m.yaml", lambda: "name: " + "N" * 1000 + "\n" + shapes(1), "at most 200 characters"),
    "a deep list": ("m.yaml", lambda: "name: " + "[" * 10_000 + "]" * 10_000, "nested too deep"),
    "many keys": ("m.yaml", lambda: "".join(f"a{k}: 1\n" for k in range(10_000)), "m.yaml, line"),
    "a number of 300 digits": ("m.yaml", lambda: machine("").replace("[-380, 380]", "[-1.0e+300, 380]"), "travel"),
}  # fmt: skip


@pytest.mark.parametrize("name", LARGE)
def test_large_input_is_refused(name: str, place: Path) -> None:
    file, content, words = LARGE[name]
    write(Path(file), content())
    result = run("describe", file) if file == "m.yaml" else run("fit", MILL, file, "--out", "out")
    assert result.code == 2, result.out[:500]
    assert words in result.err, result.err


@POSIX
@pytest.mark.parametrize(
    "words",
    [
        ("fit", MILL, "pipe.csv", "--out", "out"),
        ("fit", MILL, "pipe.yaml", "--out", "out"),
        ("fit", MILL, "s.csv", "--priors", "pipe.yaml", "--out", "out"),
        ("describe", "pipe.yaml"),
        ("simulate", MILL, "pipe.csv", "--out", "p.csv"),
        ("simulate", MILL, 5, "--parameters", "pipe.yaml", "--out", "p.csv"),
        ("plan", MILL, "--points", 20, "--setup", "pipe.yaml"),
        ("fit", MILL, "linked.csv", "--out", "out"),
        ("fit", MILL, "survey.yaml", "--out", "out"),
        ("predict", "fit", "pipe.csv", "--out", "p.csv"),
        ("describe", "/dev/zero"),
    ],
)
def test_pipes_and_devices_are_not_waited_for(words: tuple[object, ...], place: Path) -> None:
    for name in ("pipe.csv", "pipe.yaml"):
        os.mkfifo(name)
    Path("linked.csv").symlink_to("pipe.csv")
    write(Path("survey.yaml"), "errormodel: 1\nfiles: [{path: pipe.csv}]\n")
    result = run(*words)
    assert result.code == 2
    assert "which may never end. Write what it gives to a file" in result.err, result.err


@POSIX
def test_names_that_are_not_utf_8(place: Path) -> None:
    bad = os.fsdecode(b"a\xff")
    Path(f"{bad}.csv").write_bytes(Path("s.csv").read_bytes())
    for words in (
        ("fit", MILL, f"{bad}.csv", "--out", "out"),
        ("fit", MILL, "s.csv", "--out", bad),
        ("simulate", MILL, 5, "--out", f"{bad}2.csv"),
    ):
        result = run(*words)
        assert result.code == 2
        assert "not UTF-8" in result.err
    assert {p.name for p in place.iterdir()} == {"s.csv", f"{bad}.csv", ".errormodel.sha256"}


@pytest.mark.parametrize("text", ['name: "\\ud800"', '"\\udc00": 1', "notes: ['\\ud800', \"\\uDFFF\"]"])
def test_halves_of_characters(text: str, place: Path) -> None:
    write(Path("m.yaml"), f"{text}\n{shapes(1)}")
    result = run("describe", "m.yaml", "--json", "d.json")
    assert result.code == 2
    assert "half of a character" in result.err
    assert not Path("d.json").exists()


@pytest.mark.parametrize("sigma", ["1e-300", "1e-12", "1e5", "1e300"])
def test_uncertainties_that_no_instrument_has(sigma: str, place: Path) -> None:
    rows = Path("s.csv").read_text().splitlines()
    write(Path("t.csv"), "\n".join([f"{rows[0]},sigma", *(f"{r},{sigma}" for r in rows[1:])]))
    result = run("fit", MILL, "t.csv", "--out", "out")
    assert result.code == 2
    assert "t.csv, row 1 (line 2), column sigma" in result.err
    for block in (f"{{type: cmm, sigma: [{sigma}, 0]}}", f"{{type: interferometer, sigma: [{sigma}, 0]}}"):
        write(Path("s.yaml"), f"errormodel: 1\nfiles: [{{path: s.csv}}]\ninstrument: {block}\n")
        result = run("fit", MILL, "s.yaml", "--out", "out")
        assert result.code == 2, result.out
        assert "sigma" in result.err or "which no instrument has" in result.err
    assert run("plan", MILL, "--points", 20, "--noise", sigma).code == 2


@pytest.mark.parametrize("command", ["fit", "diagnose"])
@pytest.mark.parametrize("columns", [("sigma",), ("sigma_x", "sigma_y", "sigma_z")])
def test_an_uncertainty_beyond_the_size_of_the_machine(command: str, columns: tuple[str, ...], place: Path) -> None:
    rows = Path("s.csv").read_text().splitlines()
    values = ",1e4" * len(columns)
    write(Path("t.csv"), "\n".join([",".join([rows[0], *columns]), *(r + values for r in rows[1:])]))
    result = run(command, MILL, "t.csv", "--out", "out")
    assert result.code == 2, result.out
    assert "t.csv: the declared standard uncertainty of a coordinate is 1e+04 mm" in result.err
    assert "Check the unit of sigma" in result.err


LIMITED = "ulimit -v {kb}; exec {python} -m errormodel {words}"


@POSIX
@pytest.mark.skipif(sys.platform != "linux", reason="a limit of memory that is kept")
@pytest.mark.parametrize(
    ("words", "code"), [("machines", 2), (f"fit {MILL} s.csv --out out", 2), ("fit --help", 0), ("--version", 0)]
)
def test_a_limit_of_memory_that_is_too_low_is_refused_at_once(words: str, code: int, place: Path) -> None:
    """OpenBLAS would try for ever to allocate, and no signal but SIGKILL would end that."""
    line = LIMITED.format(kb=600_000, python=sys.executable, words=words)
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    ended = subprocess.run(["bash", "-c", line], capture_output=True, text=True, env=env, check=False, timeout=30)
    assert ended.returncode == code, ended.stderr
    if code:
        assert "limited to 0.61 GB (ulimit -v 600000)" in ended.stderr
        assert "Set ulimit -v " in ended.stderr
    assert not Path("out").exists()


LACKS = [MemoryError(), ImportError("x.so: failed to map segment"), RuntimeError("can't start new thread")]


@pytest.mark.parametrize("error", LACKS)
def test_too_little_memory_is_said(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    def lacking() -> None:
        raise error

    monkeypatch.setattr("errormodel.library", lacking, raising=False)
    ended = run("machines")
    assert (ended.code, ended.err.count("\n")) == (2, 1)
    assert "memory: there is too little" in ended.err


def test_fifty_copies_of_a_row_are_no_recording(place: Path) -> None:
    """Copies have no noise of their own: what they agree in is not a model that is adequate."""
    rows = Path("s.csv").read_text().splitlines()
    for kept in ([rows[5]] * 50, [rows[k] for k in (1, 5, 9)] * 20):
        write(Path("c.csv"), "\n".join([rows[0], *kept]))
        result = run("fit", MILL, "c.csv", "--out", "out")
        assert result.code == 2
        assert "rows repeat what earlier rows measured to the last digit" in result.err
        result = run("diagnose", MILL, "c.csv", "--out", "out")
        assert result.code == 2
        assert "adequate" not in result.out
