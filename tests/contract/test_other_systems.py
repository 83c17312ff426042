"""What errormodel does where a system lacks something that Linux has: the same results, by other means."""

from __future__ import annotations

import ast
import errno
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from errormodel import files
from errormodel.files import write_bytes_atomic
from identification.results import results_folder
from tests.helpers.commands import MILL, done, run, tree
from tests.helpers.windows_rules import MISSING, MISSING_MODULES, obey

ROOT = Path(__file__).resolve().parents[2]
POSIX = {("os", name) for name in MISSING} | {("signal", name) for name in ("SIGKILL", "SIGHUP", "SIGSTOP", "SIGALRM")}
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="rules of other systems, kept on Linux")
WORK: tuple[tuple[object, ...], ...] = (
    ("simulate", MILL, 60, "--noise", 0.002, "--out", "s.csv"),
    ("fit", MILL, "s.csv", "--out", "fit"),
    ("monitor", "fit", "s.csv"),
    ("compensate", "fit", "--controller", "csv", "--points", 4, "--out", "fit/tables"),
    ("predict", "fit", "s.csv", "--out", "p.csv"),
    ("fit", MILL, "s.csv", "--out", "fit"),  # which takes the tables and the history along
)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of `WORK` on this system as it is."""
    folder = tmp_path_factory.mktemp("plain")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for words in WORK:
            done(*words)
    return folder


def differing(place: Path, plain: Path) -> set[str]:
    """Names of files that are not as they were; the database of a history has places of its own."""
    here, there = tree(place), tree(plain)
    return {n for n in {*here, *there} if here.get(n) != there.get(n) and not n.endswith(".sqlite")}


def at_import(node: ast.AST) -> Iterator[ast.AST]:
    """What is executed when a module is imported: all but the bodies of functions, decorators included."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            parts: list[ast.AST] = [*child.decorator_list, *child.args.defaults, *child.args.kw_defaults]
            yield from (n for part in parts if part is not None for n in ast.walk(part))
        elif not isinstance(child, ast.Lambda):
            yield child
            yield from at_import(child)


def of_posix(node: ast.AST) -> str | None:
    """Name of what Windows lacks."""
    if isinstance(node, ast.Import | ast.ImportFrom):
        names = {a.name for a in node.names} if isinstance(node, ast.Import) else {node.module}
        return next((str(n) for n in names if n in MISSING_MODULES), None)
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        return node.attr if (node.value.id, node.attr) in POSIX else None
    return None


def test_modules_are_imported_on_every_system() -> None:
    """Of errormodel and of its tests: one module that Windows cannot import ends a whole run of tests there."""
    words = (*MISSING_MODULES, *(name for _, name in POSIX))
    paths = [f for top in ("errormodel", "identification", "tests") for f in (ROOT / top).rglob("*.py")]
    texts = {f: f.read_text(encoding="utf-8") for f in paths if f.parent.name != "benchmarks"}  # some are for Linux
    some = {f: ast.parse(text) for f, text in texts.items() if any(word in text for word in words)}
    found = {(f.name, name) for f, tree in some.items() for node in at_import(tree) if (name := of_posix(node))}
    assert len(some) > 4
    assert found == set()
    decorated = ast.parse("@mark(signal.SIGKILL)\ndef f():\n    import fcntl")
    assert {of_posix(n) for n in at_import(decorated)} == {None, "SIGKILL"}


@pytest.mark.long
@LINUX
def test_windows_rules_for_files_change_no_byte(plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    obey(monkeypatch)
    for words in WORK:
        done(*words)
    assert differing(tmp_path, plain) == set()


@LINUX
@pytest.mark.parametrize("pending", [True, False], ids=["it is waited for", "the folder is read-only"])
def test_a_lock_that_windows_is_about_to_remove(pending: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """While a scanner looks at the removed file it can neither be opened nor made: no reason to do without the lock."""
    obey(monkeypatch)
    path, opening, asked, held = tmp_path / files.LOCK_FILE, os.open, [0], list[int]()
    if pending:
        path.touch()

    def refused(name: Any, *more: Any) -> int:
        asked[0] += 1
        if asked[0] < 4 or not pending:
            raise PermissionError(errno.EACCES, "Permission denied", str(name))
        return opening(name, *more)

    monkeypatch.setattr(os, "open", refused)
    monkeypatch.setattr(files, "taken", lambda handle: not held.append(handle))
    with files.locked(tmp_path):
        assert (asked, len(held)) == (([4], 1) if pending else ([1], 0))


@LINUX
@pytest.mark.parametrize("name", ["p.csv", "fit/machine.yaml"])
def test_a_file_that_a_spreadsheet_holds_open(
    name: str, plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither it nor the folder that it is in can be replaced: a sentence, and all that was there."""
    place = shutil.copytree(plain, tmp_path / "w")
    monkeypatch.chdir(place)
    before = tree(place)
    obey(monkeypatch)
    with Path(name).open("rb"):
        ended = run(*(WORK[4] if name == "p.csv" else WORK[1]))
    assert ended.code == 2
    assert "cannot be written: Access is denied" in ended.err
    assert tree(place) == before


def _refused(code: int) -> Callable[..., None]:
    def call(*_: object, **__: object) -> None:
        raise OSError(code, os.strerror(code))

    return call


@pytest.mark.skipif(sys.platform == "win32", reason="functions of POSIX")
def test_file_systems_without_locks_links_flushes_and_exchange(
    plain: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import fcntl

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(fcntl, "flock", _refused(errno.ENOTSUP))
    monkeypatch.setattr(os, "link", _refused(errno.EPERM))
    monkeypatch.setattr(os, "fsync", _refused(errno.EINVAL))
    monkeypatch.setattr(results_folder, "_swapped", lambda *_: False)
    for words in WORK:
        done(*words)
    assert differing(tmp_path, plain) == set()


@LINUX
@pytest.mark.parametrize("possible", [True, False])
def test_macos_flushes_past_the_cache_of_the_drive(
    possible: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And is content with less where a file system, such as that of a stick, cannot."""
    import fcntl

    asked: list[str] = []

    def control(handle: int, what: int) -> None:
        asked.append(f"full {what}")
        if not possible:
            raise OSError(errno.ENOTSUP, "Operation not supported")

    monkeypatch.setattr(files, "sys", SimpleNamespace(platform="darwin"))
    monkeypatch.setattr(fcntl, "F_FULLFSYNC", 51, raising=False)
    monkeypatch.setattr(fcntl, "fcntl", control)
    monkeypatch.setattr(os, "fsync", lambda handle: asked.append("fsync"))
    write_bytes_atomic(b"x", tmp_path / "a")
    assert asked == ["full 51", "full 51"] if possible else ["full 51", "fsync"] * 2  # the file, and its folder
    assert (tmp_path / "a").read_bytes() == b"x"
