"""Ctrl-C, SIGTERM, a closed terminal: a word on stderr, 130, 143 or 129, at any moment; nothing left, no process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.helpers.commands import MILL, done, tree
from tests.helpers.nightly import first_of

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
ROOT = Path(__file__).resolve().parents[2]
SOON_S = 20.0  # s; an idle computer takes one, tests share theirs with others


def started(program: str, *arguments: object) -> subprocess.Popen[str]:
    """A command in a session of its own, so that what it leaves behind can be counted."""
    return subprocess.Popen(
        [sys.executable, "-c", program, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, start_new_session=True, env=os.environ | {"PYTHONPATH": str(ROOT), "PYTHONFAULTHANDLER": "1"},
    )  # fmt: skip


def said_by(process: subprocess.Popen[str], soon: float = SOON_S) -> str:
    """What a process says on stderr until it ends; where it does not, the test fails with what it was at."""
    try:
        _, err = process.communicate(timeout=soon)  # hangs where a process of it holds stderr
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGABRT)
        _, err = process.communicate(timeout=SOON_S)
        pytest.fail(f"has not ended after {soon} s: {err}")
    return err


def left_of(session: int) -> list[str]:
    """Processes of a session that still run, by the command that every Unix has."""
    listed = subprocess.run(["ps", "-A", "-o", "sess=,pid="], capture_output=True, text=True, check=False).stdout
    return [line for line in listed.splitlines() if line.split()[0] == str(session)]


START = "from identification.command_line.start import entry; print('up', flush=True); entry()"


@pytest.mark.parametrize("delay", first_of([0.0, 0.4, 1.0, 0.1, 2.0], 3))
def test_a_word_and_130(delay: float, tmp_path: Path) -> None:
    done("simulate", MILL, 60, "--noise", 0.002, "--out", tmp_path / "s.csv")
    process = started(START, "diagnose", MILL, tmp_path / "s.csv", "--out", tmp_path / "out")
    assert process.stdout is not None
    process.stdout.readline()
    time.sleep(0.05 + delay)
    begun = time.monotonic()
    process.send_signal(signal.SIGINT)
    err = said_by(process)
    if process.returncode == 0:  # it was done before
        pytest.skip("the command was faster")
    assert process.returncode == 130, err
    assert "stopped" in err
    assert "Traceback" not in err
    assert time.monotonic() - begun < SOON_S
    assert not left_of(process.pid)
    assert [p.name for p in tmp_path.iterdir() if p.name not in (".errormodel.sha256", "s.csv")] == []


# What is imported first after the modules around the start of a command brings the signal.
LOADING = """
import __future__, os, runpy, signal, sys
class First:
    def find_spec(self, name, *_):
        if name.partition(".")[0] not in ("errormodel", "identification"):
            sys.meta_path.remove(self)
            try:
                os.kill(os.getpid(), signal.{name})
            finally:
                os.kill(os.getpid(), signal.{name})  # and again, by who has no patience
sys.argv = ["errormodel", "machines"]
for heavy in ("typing", "threading", "contextlib", "collections.abc"):
    sys.modules.pop(heavy, None)  # `runpy` may have loaded it
sys.meta_path.insert(0, First())
{start}
"""
STARTS = {
    "python -m": "runpy.run_module('errormodel', run_name='__main__')",
    "script": "from identification.command_line.start import entry; entry()",
}


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
@pytest.mark.parametrize("start", STARTS)
def test_a_word_while_modules_load(start: str, name: str) -> None:
    """Handlers come before all modules but those of the start of a command and `signal`."""
    process = started(LOADING.format(name=name, start=STARTS[start]))
    err = said_by(process)
    assert (process.returncode, err.strip()[:7]) == (128 + getattr(signal, name), "stopped"), err
    assert "Traceback" not in err


# Sleeps are short: a signal between the interpreter's last look and the call of the system waits until that returns.
DRAWING = f"""
import time, identification.report
identification.report.report = lambda *_: (print('up', flush=True), [time.sleep(0.1) for _ in range(600)])
{START.replace("print('up', flush=True)", "pass")}
"""


ENDING = ["SIGINT", "SIGTERM", "SIGHUP"]


@pytest.mark.parametrize("name", first_of(ENDING))
def test_a_report_that_is_stopped_leaves_nothing(name: str, tmp_path: Path) -> None:
    number = getattr(signal, name)
    done("simulate", MILL, 40, "--noise", 0.002, "--out", tmp_path / "s.csv")
    process = started(DRAWING, "fit", MILL, tmp_path / "s.csv", "--out", tmp_path / "out")
    assert process.stdout is not None
    while process.stdout.readline() != "up\n":
        pass
    assert [p for p in tmp_path.iterdir() if p.name.endswith(".part")]
    process.send_signal(number)
    err = said_by(process)
    assert (process.returncode, err.strip()[:7]) == (128 + number, "stopped")
    assert {p.name for p in tmp_path.iterdir()} == {".errormodel.sha256", "s.csv"}


LOST = """
import sys, time, types
from identification.command_line import start
start.PATIENCE_S = 0.2
main = types.ModuleType("identification.command_line.main")
def entry():
    print("up", flush=True)
    while True:
        try:
            time.sleep(0.1)
        except KeyboardInterrupt:  # as a library that calls back into Python may lose it
            pass
main.entry = entry
sys.modules[main.__name__] = main
start.entry()
"""


@pytest.mark.parametrize("name", ENDING)
def test_an_interruption_that_is_lost_ends_the_process_all_the_same(name: str) -> None:
    number = getattr(signal, name)
    process = started(LOST)
    assert process.stdout is not None
    process.stdout.readline()
    process.send_signal(number)
    err = said_by(process)
    assert (process.returncode, err.strip()[:7]) == (128 + number, "stopped")


OWN_ERRORS = {
    "raised while it is handled": "raise RuntimeError('called back') from None\n",
    "raised after it": "break\n    raise TypeError('incompatible arguments')\n",  # as in arguments of compiled code
}


@pytest.mark.parametrize("raised", OWN_ERRORS.values(), ids=OWN_ERRORS)
def test_an_interruption_that_a_library_makes_an_error_of_its_own_is_one(raised: str) -> None:
    wrapped = LOST.replace("pass\n", raised)
    process = started(wrapped.replace("PATIENCE_S = 0.2", "PATIENCE_S = 20.0"))
    assert process.stdout is not None
    process.stdout.readline()
    process.send_signal(signal.SIGINT)
    err = said_by(process)
    assert (process.returncode, err.strip()[:7]) == (130, "stopped")
    assert "Traceback" not in err


@pytest.mark.long
@pytest.mark.parametrize("name", ENDING)
def test_a_parent_that_ignores_them_goes_before(name: str, tmp_path: Path) -> None:
    """As nohup ignores that a terminal is closed."""
    ignoring = f"import signal; signal.signal(signal.{name}, signal.SIG_IGN); {START}"
    process = started(ignoring, "simulate", MILL, 5, "--out", tmp_path / "p.csv")
    assert process.stdout is not None
    process.stdout.readline()
    process.send_signal(getattr(signal, name))
    said_by(process, 60.0)
    assert process.returncode == 0
    assert tree(tmp_path)


AT_A_TERMINAL = """
import os, sys
os.close(os.open(os.ttyname(0), os.O_RDWR))  # which makes it the terminal of this session
up = int(sys.argv.pop(1))
"""
WRITING_THERE = f"""{AT_A_TERMINAL}
import time, identification.report
def report(*_):
    os.write(up, b"up")
    while True:
        print("at work", flush=True)  # an error once the terminal is closed
        time.sleep(0.01)
identification.report.report = report
from identification.command_line.start import entry
entry()
"""
LOST_THERE = AT_A_TERMINAL + LOST.replace('print("up", flush=True)', 'os.write(up, b"up")')


@pytest.mark.long
@pytest.mark.parametrize("program", [WRITING_THERE, LOST_THERE], ids=["writing there", "lost"])
def test_a_terminal_that_is_closed(program: str, tmp_path: Path) -> None:
    """Nobody takes the word there, which changes neither the exit code nor what is left."""
    done("simulate", MILL, 40, "--noise", 0.002, "--out", tmp_path / "s.csv")
    terminal, its = os.openpty()
    reading, writing = os.pipe()
    words = [writing, "fit", MILL, tmp_path / "s.csv", "--out", tmp_path / "out"]
    process = subprocess.Popen(
        [sys.executable, "-c", program, *map(str, words)], stdin=its, stdout=its, stderr=its, pass_fds=[writing],
        start_new_session=True, env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    os.close(its)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        assert pipe.read(2) == b"up"
        os.close(terminal)
        assert process.wait(timeout=SOON_S) == 129
    assert not left_of(process.pid)
    assert {p.name for p in tmp_path.iterdir()} == {".errormodel.sha256", "s.csv"}
