"""Commands that write, killed at a file operation or at a moment, and what must hold then.

A command runs in a process forked from this one, where everything is imported already. It is killed (SIGKILL, as by the
system or by a power failure without its effect on the disk) or halted (SIGSTOP, which leaves the same files) just
before its n-th operation on a file of the place, or after a time.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import sqlite3
import sys
import tempfile
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from identification.report.page import Album
from tests.helpers import crossbeam, importing, thermal_cmm
from tests.helpers.commands import FIVE, MILL, done, run, tree
from tests.helpers.robots import joint, robot

WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT
OPERATIONS = {"os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.link", "os.chmod", "os.truncate", "sqlite3.connect"}
RECORDS = (".errormodel.sha256", ".errormodel.lock")  # lists of the files that were written: of any state
KNOWN = b", which the history has already"  # what `monitor` says of a cycle that a killed run had taken in
KILLED_INDEED = 20  # one point of each kind in so many: at the others the command is halted and looked at
PATIENCE_S = 1800.0  # s that a command may take on a busy computer


@dataclass(frozen=True)
class Case:
    """A command, and the one before it whose results it replaces.

    Attributes
    ----------
    first, second : words
    target : str
        The file or folder that both write.
    whole : bool
        Whether the target changes as a whole; otherwise each of its files does.
    together : names
        Files of the target that are of one run, as far as they are there.
    """

    first: tuple[object, ...]
    second: tuple[object, ...]
    target: str
    whole: bool = True
    together: tuple[str, ...] = ()


SURVEYS = ("one.csv", "two.csv")
PAGES = ("watched/monitor.json", "watched/monitor.html")
BRIDGE = "bridge_cmm"


def _each(target: str, words: Callable[[str, str], tuple[object, ...]], whole: bool = True) -> Case:
    """The same command of two surveys and their fits."""
    one, two = (words(survey, survey.removesuffix(".csv")) for survey in SURVEYS)
    return Case((*one, "--out", target), (*two, "--out", target), target, whole)


CASES = {
    "fit": _each("fitted", lambda survey, _: ("fit", MILL, survey)),
    "bayes": _each("posterior", lambda survey, _: ("fit", MILL, survey, "--bayes")),
    "diagnose": _each("found", lambda survey, _: ("diagnose", MILL, survey)),
    "thermal": _each("drift", lambda survey, _: ("thermal", BRIDGE, survey.replace(".csv", "_thermal.yaml"))),
    "predict": _each("p.csv", lambda _, fit: ("predict", fit, "one.csv")),
    "compensate": _each("tables", lambda _, fit: ("compensate", fit, "--controller", "csv", "--points", 4)),
    "iso": _each("certificate", lambda _, fit: ("iso", "parameters", fit)),
    "import": _each(
        "taken",
        lambda survey, _: ("import", survey.replace("csv", "txt"), "--machine", MILL, "--commands", "poses.csv"),
    ),
    "simulate": _each(
        "made.csv", lambda survey, _: ("simulate", MILL, 20 + len(survey), "--seed", int(survey == "two.csv"))
    ),
    "plan": _each("plan.csv", lambda survey, _: ("plan", MILL, "--points", 14, "--seed", int(survey == "two.csv"))),
    "monitor": Case(
        ("monitor", "watched", "one.csv"), ("monitor", "watched", "two.csv"), "watched", whole=False, together=PAGES
    ),
    "fleet": _each("fleet", lambda _, fit: ("fleet", f"{fit}_list.csv", "--workers", 1), whole=False),
    "register": _each(
        "warm.csv",
        lambda survey, _: ("register", "cold", "warm_a" if survey == "one.csv" else "warm_b", "--profiler", "p.yaml"),
    ),
    "machine": _each("arm.yaml", lambda survey, _: ("machine", survey.replace(".csv", ".urdf"))),
    "export": _each("arm.urdf", lambda _, fit: ("export", fit, "--format", "urdf")),
    "describe": Case(
        ("describe", MILL, "--json", "d.json"), ("describe", MILL, "one.csv", "--json", "d.json"), "d.json"
    ),
    "drawing": Case(("describe", MILL, "--drawing", "d.svg"), ("describe", FIVE, "--drawing", "d.svg"), "d.svg"),
    "template": Case(("template", MILL, "--out", "t.csv"), ("template", FIVE, "--out", "t.csv"), "t.csv"),
    "explain": Case(("explain", "diag", "--out", "e.svg"), ("explain", "diag", "scale-ppm", "--out", "e.svg"), "e.svg"),
}


def prepare(place: Path, names: Collection[str] = tuple(CASES)) -> None:
    """Two surveys, their fits, and what else the cases of these names need."""
    for seed, survey in enumerate(SURVEYS):
        name = survey.removesuffix(".csv")
        done("simulate", MILL, 40, "--noise", 0.002, "--seed", seed, "--out", place / survey)
        done("fit", MILL, place / survey, "--out", place / name, "--quiet")
        measured = importing.points(importing.poses(), seed=seed)
        (place / f"{name}.txt").write_text(importing.spatialanalyzer(measured))
        (place / f"{name}_list.csv").write_text(f"machine,survey,id\n{MILL},one.csv,A\n{MILL},{survey},B\n")
        (place / f"{name}.urdf").write_text(robot(joint("J1", "base", name, more='<axis xyz="0 0 1"/>')))
        if "thermal" in names:
            _cycles(place, name, seed)
    importing.poses().to_csv(place / "poses.csv", index=False)
    shutil.copytree(place / "one", place / "watched")
    if "explain" in names:
        done("diagnose", MILL, place / "one.csv", "--out", place / "diag", "--quiet")
    if "register" in names:
        _clouds(place)


def _cycles(place: Path, name: str, seed: int) -> None:
    """Two thermal cycles of one axis, and the survey of both."""
    roles = {"fit": thermal_cmm.drift_recordings(seed), "test": thermal_cmm.other_cycle(seed)}
    for role, table in roles.items():
        table[table["joint"] == "Y"].drop(columns=["X", "Z"]).to_csv(place / f"{name}_{role}.csv", index=False)
    files = ", ".join(f"{{path: {name}_{role}.csv, role: {role}}}" for role in roles)
    (place / f"{name}_thermal.yaml").write_text(f"errormodel: 1\nfiles: [{files}]\n")


def _clouds(place: Path) -> None:
    """One artefact, cold and warm twice, and its ``p.yaml``."""
    rng, artefact = np.random.default_rng(1), crossbeam.Artefact.random(0)
    x, y = (np.arange(200) - 100) * 0.2, np.arange(-20.0, 20.0, 1.0)
    for name, minutes in {"cold": 0, "warm_a": 30, "warm_b": 180}.items():
        scan = crossbeam.scan(artefact, crossbeam.displaced(crossbeam.warm_up(350.0, minutes)), y, x, rng=rng)
        crossbeam.write_csv(scan, place / name / "artefact_01.csv")
    mount = f"{{translation: {list(crossbeam.MOUNT[:3])}, rotation: {list(crossbeam.MOUNT[3:])}}}"
    text = f"joint: Y\npositions: [350.0]\nlever: [-900, 0, -2051]\nmount: {mount}\n"
    (place / "p.yaml").write_text(text)


def forked(
    words: tuple[object, ...],
    place: Path,
    *,
    full: int | None = None,
    steps: Collection[int] = (),
    moments: Collection[float] = (),
    look: Callable[[str], bool] = lambda when: False,
) -> tuple[int, int]:
    """Run a command in `place` in a process of its own.

    Parameters
    ----------
    full : bytes from which writing a file fails, as on a full disk.
    steps : operations on files of the place, from 1, before each of which the command is halted.
    moments : seconds after which it is.
    look : called with the moment in words while the command is halted: the place is as a kill would leave it. Where it
        gives True, the command is killed.

    Returns
    -------
    The exit code, negative where a signal ended it; and the number of its operations (0 where it was killed).
    """
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.close(reading)
        code = 70
        try:
            if full is not None:
                import resource  # not on every system

                resource.setrlimit(resource.RLIMIT_FSIZE, (full, full))
            code = _run_counted(words, place, {*steps}, writing)
        finally:
            os._exit(code)
    os.close(writing)
    before, after, asked = iter(sorted(steps)), sorted(moments), ""
    begun = time.monotonic()
    while True:
        ended, status = os.waitpid(child, os.WNOHANG | os.WUNTRACED)
        now = time.monotonic()
        if ended and os.WIFSTOPPED(status):
            killed = look(asked or f"operation {next(before, '?')}")
            asked = ""
            os.kill(child, signal.SIGKILL if killed else signal.SIGCONT)
            begun += time.monotonic() - now
        elif ended:
            break
        elif now - begun > PATIENCE_S:
            os.kill(child, signal.SIGKILL)
        elif after and not asked and now - begun >= after[0]:
            asked = f"{after.pop(0):.3f} s"
            os.kill(child, signal.SIGSTOP)
        else:
            time.sleep(0.001)
    with os.fdopen(reading) as pipe:
        count = pipe.read()
    return os.waitstatus_to_exitcode(status), int(count or 0)


def _run_counted(words: tuple[object, ...], place: Path, steps: Collection[int], writing: int) -> int:
    os.chdir(place)
    own, inside, count = os.getpid(), str(place.resolve()), 0

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        nonlocal count
        if os.getpid() != own or not (event in OPERATIONS or (event == "open" and _writes(arguments))):
            return
        if not any(_is_in(inside, a) for a in arguments[:2]):
            return
        count += 1
        if count in steps:
            os.kill(own, signal.SIGSTOP)

    sys.addaudithook(hook)
    # nothing is written while a page's figures are drawn, which is most of the time of a fit
    Album.place = lambda self, picture: "data:,"  # type: ignore[method-assign]
    code = run(*words).code
    os.write(writing, str(count).encode())
    return code


def _writes(arguments: tuple[object, ...]) -> bool:
    return isinstance(arguments[2], int) and bool(arguments[2] & WRITING)


def _is_in(inside: str, path: object) -> bool:
    return isinstance(path, str | bytes | os.PathLike) and os.path.realpath(os.fsdecode(path)).startswith(inside)


def state(place: Path) -> dict[str, object]:
    """Every file that is not a record, by its path; a history by what is in it."""
    out: dict[str, object] = {}
    for name, content in tree(place).items():
        file = name.rpartition("/")[2]
        if file.startswith("monitor.sqlite"):
            if file == "monitor.sqlite":
                with closing(sqlite3.connect(place / name)) as history:  # which takes back what was not committed
                    out[name] = history.execute("select number, digest, status from cycles").fetchall()
        elif file not in RECORDS:
            out[name] = content.replace(KNOWN, b"")
    return out


def leftovers(place: Path) -> list[str]:
    """Unfinished files and folders, which a killed run may leave and the next one removes."""
    return sorted(p.name for p in place.rglob(".*") if p.name not in RECORDS)


def of_target(content: dict[str, object], case: Case) -> dict[str, object]:
    return {n: c for n, c in content.items() if n == case.target or n.startswith(f"{case.target}/")}


def faults(case: Case, place: Path, old: dict[str, object], new: dict[str, object]) -> Iterator[str]:
    """What is wrong in a place where the second command of a case was killed, in words; it is finished then."""
    if Path(place / case.target).is_dir() and case.whole:
        ended = run("verify", place / case.target)
        if ended.code:
            yield f"verify: {ended.err.strip()}"
    here = {n: c for n, c in state(place).items() if not any(part.startswith(".") for part in n.split("/"))}
    here = {n: c for n, c in here.items() if not n.startswith(f"{case.target}/chain/")}  # resumed by the next run
    apart = of_target(here, case)
    if case.whole and apart not in (of_target(old, case), of_target(new, case)):
        yield f"{case.target} is neither the old nor the new result"
    for name, content in apart.items():
        if content not in (old.get(name), new.get(name)):
            yield f"{name} is neither the old nor the new one"
    there = [name for name in case.together if name in apart]
    if not any(all(apart[n] == of.get(n) for n in there) for of in (old, new)):
        yield f"{' and '.join(there)} are of two runs"
    outside = {n: c for n, c in here.items() if n not in apart}
    if outside != {n: c for n, c in old.items() if n not in of_target(old, case)}:
        yield "a file outside the results was touched"
    code, _ = forked(case.second, place)
    if code:
        yield f"the next run ends with exit code {code}"
    elif state(place) != new:
        changed = [n for n in {*state(place), *new} if state(place).get(n) != new.get(n)]
        yield f"the next run gives another result: {', '.join(sorted(changed))}"
    if leftovers(place):
        yield f"the next run leaves {', '.join(leftovers(place))}"


@dataclass
class Left:
    """What kills of a case left, by content; `of`: the moments in words, and which content each of them left."""

    folder: Path
    known: dict[frozenset[tuple[str, bytes | None]], Path] = field(default_factory=dict)
    of: list[tuple[str, Path]] = field(default_factory=list)

    def take(self, place: Path, when: str) -> None:
        """What lies in a place now."""
        folders = {str(p.relative_to(place)): None for p in place.rglob("*") if p.is_dir()}
        files = frozenset((tree(place) | folders).items())
        if files not in self.known:
            self.known[files] = shutil.copytree(place, self.folder / str(len(self.known)))
        self.of.append((when, self.known[files]))


class Kill(NamedTuple):
    """A kill or a full disk: when, and what was wrong; `files`: which of the different contents it left."""

    when: str
    faults: list[str]
    files: Path | None = None


def killed(name: str, prepared: Path, count: int, seed: int = 0) -> Iterator[Kill]:
    """Kill a case `count` times, at file operations drawn without replacement and at moments; before, full disks.

    One run is halted at each of these points, when the files are those that a kill there would leave; some kills are
    made indeed, each of a run of its own. What they leave is examined once: most of those while the command computes
    leave the same files.
    """
    case, rng = CASES[name], random.Random(f"{name} {seed}")
    with tempfile.TemporaryDirectory() as folder:
        before, place, left = Path(folder) / "before", Path(folder) / "w", Left(Path(folder) / "left")
        shutil.copytree(prepared, before)
        code, _ = forked(case.first, before)
        assert code == 0, f"{name}: the first command failed"
        old = state(before)
        shutil.copytree(before, place)
        begun = time.monotonic()
        code, operations = forked(case.second, place)
        duration = time.monotonic() - begun
        assert code == 0, f"{name}: the second command failed"
        assert operations, f"{name}: no file operation was seen"
        new = state(place)
        assert old != new, f"{name}: both commands give the same"
        steps = rng.sample(range(1, operations + 1), min(operations, -(-count // 2)))
        sizes = sorted({len(c) - 1 for n, c in new.items() if isinstance(c, bytes) and old.get(n) != c})
        moments = [rng.uniform(0, duration) for _ in range(count - len(steps))]

        def again() -> None:
            shutil.rmtree(place)
            shutil.copytree(before, place)

        def halted(when: str) -> bool:
            left.take(place, f"{when} of {operations}" if "operation" in when else f"{when} of {duration:.3f} s")
            return False

        for size in sizes[:: -(-len(sizes) // count)]:
            again()
            code, _ = forked(case.second, place, full=size)
            wrong = [] if code in (1, 2) else [f"exit code {code}"]
            wrong += ["it leaves something"] if case.whole and state(place) != old else []
            # a fleet goes on where a part of it fails: its tables say so, and are others than without the failure
            wrong += [f for f in faults(case, place, old, new) if case.whole or "neither the old nor" not in f]
            yield Kill(f"{name}, full from {size} bytes", wrong)
        indeed = -(-count // KILLED_INDEED)
        for at, after in [*(([n], []) for n in steps[:indeed]), *(([], [t]) for t in moments[:indeed])]:
            again()
            forked(case.second, place, steps=at, moments=after, look=lambda when: True)
            left.take(place, f"killed at operation {at[0]} of {operations}" if at else f"killed after {after[0]:.3f} s")
        again()
        code, _ = forked(case.second, place, steps=steps[indeed:], moments=moments[indeed:], look=halted)
        assert code == 0, f"{name}: the second command failed where it was halted"
        found: dict[Path, list[str]] = {}
        for when, files in left.of:
            if files not in found:
                shutil.rmtree(place)
                shutil.copytree(files, place)
                found[files] = list(faults(case, place, old, new))
            yield Kill(f"{name}, {when}", found[files], files)
