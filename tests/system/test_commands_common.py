"""What all commands share: forms of input, options, streams, exit codes, the same bytes again."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from errormodel.machine_file import read_machine, write_machine
from identification.command_line.main import app
from tests.helpers.commands import FIVE, MILL, Fill, done, write

ROOT = Path(__file__).resolve().parents[2]


def process(*arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "errormodel", *map(str, arguments)]
    env = os.environ | {"PYTHONPATH": str(ROOT)} | environment
    return subprocess.run(command, capture_output=True, text=True, errors="replace", env=env, check=False)


@pytest.fixture(scope="module")
def mill(with_mill: Fill, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return with_mill(tmp_path_factory.mktemp("mill"))


@pytest.mark.parametrize("form", ["bare", "yaml", "parts", "parquet", "folder"])
def test_every_command_takes_every_form_of_a_survey(form: str, mill: Path, tmp_path: Path) -> None:
    table = pd.read_csv(mill / "s.csv")
    text = "errormodel: 1\nfiles: [{path: s.csv}]\n"
    path = tmp_path / "in" / "s.csv"
    path.parent.mkdir()
    if form in ("bare", "yaml", "folder"):
        table.to_csv(path, index=False)
    if form == "yaml":
        path = write(tmp_path / "in/any.yaml", text)
    elif form == "folder":
        path = write(tmp_path / "in/survey.yaml", text).parent
    elif form == "parts":
        path = path.parent
        for k in range(3):
            table[20 * k : 20 * k + 20].to_csv(path / f"part{k}.csv", index=False)
    elif form == "parquet":
        path = path.parent
        table.to_parquet(path / "a.parquet")
    machine = mill / "fit"  # a folder with a machine.yaml
    assert "rank 30" in done("describe", machine, path).out
    done("simulate", machine, path, "--out", tmp_path / "sim.csv")
    done("fit", machine, path, "--out", tmp_path / "fit", "--quiet")
    done("predict", tmp_path / "fit", path, "--out", tmp_path / "p.csv")
    assert (tmp_path / "fit/parameters.csv").read_bytes() == (mill / "fit/parameters.csv").read_bytes()
    assert len(pd.read_csv(tmp_path / "p.csv")) == len(pd.read_csv(tmp_path / "sim.csv")) == 60


def test_the_same_input_gives_the_same_bytes_in_another_process(mill: Path, tmp_path: Path) -> None:
    """A fit: tests/contract/test_extras.py."""
    done("predict", mill / "fit", mill / "s.csv", "--out", tmp_path / "a.csv", "--quiet")
    asked = ("predict", mill / "fit", mill / "s.csv", "--out", tmp_path / "b.csv", "--quiet")
    result = process(*asked, PYTHONHASHSEED="8")
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")  # progress is no warning
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


@pytest.mark.parametrize("command", sorted(app.commands))
def test_every_command_helps_and_takes_the_common_options(command: str) -> None:
    for flag in ("--help", "-h"):
        text = done(command, flag).out
        assert "Usage: errormodel " + command in text
        for option in ("--quiet", "--seed", "--help"):
            assert option in text


def test_quiet_prints_nothing(mill: Path, tmp_path: Path) -> None:
    points = tmp_path / "far.csv"
    pd.read_csv(mill / "s.csv").assign(X=500.0).to_csv(points, index=False)
    for command in (
        ("machines",),
        ("describe", MILL, points),
        ("simulate", MILL, points, "--out", tmp_path / "o.csv"),
        ("predict", mill / "fit", points, "--out", tmp_path / "p.csv"),
    ):
        result = done(*command, "--quiet")
        assert (result.out, result.err) == ("", "")


def test_a_pose_outside_the_travels_is_noted_and_not_refused(mill: Path, tmp_path: Path) -> None:
    table = pd.read_csv(mill / "s.csv")
    table.loc[3, "mx"] += 400.0 - table.loc[3, "X"]
    table.loc[3, "X"] = 400.0
    table.to_csv(tmp_path / "far.csv", index=False)
    for command in (
        ("fit", MILL, tmp_path / "far.csv", "--out", tmp_path / "fit"),
        ("predict", mill / "fit", tmp_path / "far.csv", "--out", tmp_path / "p.csv"),
    ):
        notes = [line for line in done(*command).err.splitlines() if "outside the travel" in line]
        assert len(notes) == 1
        assert notes[0].startswith("note: 1 pose is outside the travel of X, -380 to 380 mm")
        assert "row 4" in notes[0]
    assert "outside the travel of X" in (tmp_path / "fit/report.html").read_text()


def test_the_library_is_listed_and_found_by_name(tmp_path: Path) -> None:
    names = [line.split()[0] for line in done("machines").out.splitlines()]
    assert FIVE in names
    model = replace(read_machine(MILL), name='A "new" <one>')
    write_machine(model, tmp_path / "machine.yaml")
    assert done("describe", tmp_path).out.startswith('A "new" <one>')


def test_names_are_printed_as_text_on_any_console(tmp_path: Path) -> None:
    """No escape sequence of a file reaches the terminal, and no code page breaks the output."""
    model = replace(read_machine(MILL), name="Fräse \u2211 \x1b[31m\u202e")
    write_machine(model, tmp_path / "machine.yaml")
    result = process("describe", tmp_path, PYTHONIOENCODING="cp1252:strict")
    assert (result.returncode, result.stderr) == (0, "")
    assert "\x1b" not in result.stdout
    assert done("describe", tmp_path).out.startswith("Fräse \u2211  [31m ")


def test_a_result_that_nobody_reads_to_its_end_is_no_error() -> None:
    """``errormodel describe ... | head -1``."""
    command = [sys.executable, "-m", "identification.command_line.main", "describe", FIVE]
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=env) as running:
        assert running.stdout is not None
        assert running.stderr is not None
        running.stdout.close()
        assert running.stderr.read() == b""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_full_disk_ends_in_a_sentence() -> None:
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "identification.command_line.main", "describe", MILL]
        ended = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert ended.returncode == 1
    assert ended.stderr == "error: the output: No space left on device. Free space there, or send it elsewhere\n"


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="the shell of POSIX")
@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_closed_stream_is_as_the_null_device(closed: str, tmp_path: Path) -> None:
    program = f"'{sys.executable}' -m errormodel"
    written = tmp_path / "p.csv"
    shell = f"{program} simulate {MILL} 3 --out '{written}' {closed} && exec {program} --version {closed}"
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    ended = subprocess.run(["sh", "-c", shell], env=env, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert len(written.read_text().splitlines()) == 4
    assert [p.name for p in tmp_path.iterdir() if p.suffix != ".sha256"] == ["p.csv"]
