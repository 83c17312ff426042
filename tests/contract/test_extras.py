"""Without the packages of the extras everything else works, with the same bytes; what needs one says so."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from errormodel.extras import EXTRAS, optional
from tests.helpers.commands import MILL, Fill, tree, write

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
# a process in which the packages of all extras are absent
WITHOUT = """
import sys
for name in {names!r}:
    sys.modules[name] = None
from identification.command_line.main import main
main(sys.argv[1:])
"""
PCD = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n0 0 0\n"
PROFILER = (
    "joint: Y\npositions: [350]\nlever: [-900, 0, -2051]\nmount: {translation: [3, 0, -174], rotation: [0, 0, 0]}\n"
)


def without(*words: object, place: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    code = WITHOUT.format(names=list(EXTRAS))
    command = [sys.executable, "-c", code, *map(str, words)]
    env = os.environ | {"PYTHONPATH": str(ROOT)} | environment
    return subprocess.run(command, cwd=place, capture_output=True, text=True, check=False, env=env)


def test_every_extra_is_one_of_the_project() -> None:
    """Its package is in the extra, and not in what everybody installs."""
    always = {re.split(r"[^\w.-]", r)[0].lower() for r in PROJECT["dependencies"]}
    for module, extra in EXTRAS.items():
        name = module.replace("_", "-")
        assert name not in always
        listed = " ".join(PROJECT["optional-dependencies"][extra])
        assert name in listed or (name == "xarray" and "xarray" in listed)


def test_results_are_the_same_without_extras_in_another_process(with_mill: Fill, tmp_path: Path) -> None:
    with_mill(tmp_path)
    here = tree(tmp_path / "fit")
    (tmp_path / "w").mkdir()
    words = ("fit", MILL, "../s.csv", "--out", "fit", "--quiet")
    ended = without(*words, place=tmp_path / "w", PYTHONHASHSEED="7")
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")
    assert tree(tmp_path / "w/fit") == here


@pytest.mark.long
@pytest.mark.parametrize(
    ("words", "package", "extra"),
    [
        (("fit", MILL, "s.parquet", "--out", "fit"), "pyarrow", "big"),
        (("register", "cold", "warm", "--profiler", "p.yaml", "--out", "y.csv"), "small-gicp", "clouds"),
        (("import", "sheet.xlsx", "--machine", MILL, "--out", "made"), "python-calamine", "xlsx"),
    ],
)
def test_what_needs_an_extra_says_so(words: tuple[str, ...], package: str, extra: str, tmp_path: Path) -> None:
    write(tmp_path / "s.parquet", b"PAR1")
    write(tmp_path / "sheet.xlsx", b"PK\x03\x04 xl/workbook")
    write(tmp_path / "p.yaml", PROFILER)
    for folder in ("cold", "warm"):
        write(tmp_path / folder / "artefact_01.pcd", PCD)
    before = tree(tmp_path)
    ended = without(*words, place=tmp_path)
    assert ended.returncode == 2, ended.stderr
    said = ended.stderr.splitlines()[-1]
    assert f"for which {package} is needed. Install it with: pip install 'errormodel[{extra}]'" in said
    assert "Traceback" not in ended.stderr
    assert tree(tmp_path) == before


def test_a_package_that_cannot_be_loaded_is_not_called_absent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "pypcd4.py", "import no_such_module_anywhere\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "pypcd4", raising=False)
    with pytest.raises(Exception, match=r"cannot be loaded \(No module named 'no_such_module_anywhere'\)"):
        optional("pypcd4", "a.pcd", "a point cloud")
    sys.modules.pop("pypcd4", None)


def test_macs_with_intel_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    """The extra can be installed there, without the package that is not built for them."""
    from packaging.requirements import Requirement

    monkeypatch.setitem(sys.modules, "small_gicp", None)
    monkeypatch.setattr("errormodel.extras.sys.platform", "darwin")
    monkeypatch.setattr("errormodel.extras.platform.machine", lambda: "x86_64")
    with pytest.raises(Exception, match="Macs with Intel processors: use another computer"):
        optional("small_gicp", "register", "a comparison of point clouds")
    (needed,) = [r for r in PROJECT["optional-dependencies"]["clouds"] if r.startswith("small-gicp")]
    marker = Requirement(needed).marker
    assert marker is not None
    assert not marker.evaluate({"sys_platform": "darwin", "platform_machine": "x86_64"})
    assert marker.evaluate({"sys_platform": "darwin", "platform_machine": "arm64"})
    assert marker.evaluate({"sys_platform": "linux", "platform_machine": "x86_64"})


def test_a_number_is_the_same_whatever_else_its_column_holds(tmp_path: Path) -> None:
    """A word for no value, a blank line or groups of digits elsewhere change no number in its last digit."""
    from errormodel.formats import open_tables

    rng = np.random.default_rng(3)
    numbers = [f"{x:.17g}" for x in rng.normal(size=300) * 10.0 ** rng.integers(-9, 9, 300)]
    exact = [float(n) for n in numbers]
    for extra in ("", "NaN", "n.a.", "1 234 567.5", "not a number"):
        cells = [*numbers, extra, "7"]
        text = "a,b\n" + "".join(f"{c},1\n" for c in cells)
        (table,) = open_tables(write(tmp_path / "t.csv", text), "t.csv")
        frame, _ = table.read(["a"], [])
        assert [float(cell) for cell in frame["a"][:300]] == exact  # text, where one cell is no number
