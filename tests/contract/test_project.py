"""The house rules that a linter cannot check."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("errormodel", "identification")
HEAVY = {"casadi", "cvxpy", "emcee", "jinja2", "matplotlib", "numpy", "pandas", "pint", "pyarrow", "scipy"}
LONGEST_FILE = 399  # lines
LOCAL_PATH = re.compile(rb"(?<![\w.~$}-])/(?:work|home|root|Users)/")


def package_files(package: str) -> list[Path]:
    return [file for file in (ROOT / package).rglob("*") if file.is_file() and "__pycache__" not in file.parts]


def project_files() -> list[Path]:
    """Files that git has, or would take."""
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout.split("\0")
    return [ROOT / name for name in names if name and (ROOT / name).is_file()]


def imported_packages(file: Path) -> set[str]:
    """Top-level names of all absolute imports of a file, wherever in it they stand."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"), str(file))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.partition(".")[0])
    return found


def test_errormodel_never_imports_identification():
    files = [file for file in package_files("errormodel") if file.suffix == ".py"]
    # ``python -m errormodel`` starts the command line; nothing imports that file
    files.remove(ROOT / "errormodel" / "__main__.py")
    assert files
    offenders = [str(file.relative_to(ROOT)) for file in files if "identification" in imported_packages(file)]
    assert not offenders


def test_command_line_starts_without_heavy_imports():
    code = "import sys, identification.command_line.main; print(*{name.partition('.')[0] for name in sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not HEAVY & set(done.stdout.split())


@pytest.mark.parametrize(
    ("words", "unused"),
    [
        (["describe", "vertical_three_axis"], {"scipy", "matplotlib", "GTC"}),
        (
            ["fit", "machines/examples/gantry", "machines/examples/gantry/survey.csv"],
            {
                "identification.diagnosis.pipeline",
                "identification.thermal_drift.drift_model",
                "multiprocessing",
                "cvxpy",
                "emcee",
            },
        ),
    ],
    ids=["describe", "fit"],
)
def test_a_command_loads_what_it_needs(words: list[str], unused: set[str], tmp_path: Path) -> None:
    """What takes as long to load as the command to run is loaded by those that use it."""
    out = ["--out", str(tmp_path / "out")] if words[0] == "fit" else []
    code = (
        "import sys; from identification.command_line.main import main; main(sys.argv[1:]); "
        "print('loaded', *sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *words, *out], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    loaded = set(done.stdout.splitlines()[-1].split())
    assert "loaded" in loaded
    assert not unused & loaded


def test_files_stay_short():
    lengths = {
        str(file.relative_to(ROOT)): len(file.read_text(encoding="utf-8").splitlines())
        for package in PACKAGES
        for file in package_files(package)
    }
    assert {name: length for name, length in lengths.items() if length > LONGEST_FILE} == {}


TIERS = {"unit", "contract", "system", "real", "proof"}


def test_tests_lie_in_their_tiers_and_stay_short():
    """Helpers hold no tests, tiers hold no helpers, and `tests` itself holds only what all tests share."""
    files = {file.relative_to(ROOT / "tests"): file for file in (ROOT / "tests").rglob("*.py")}
    assert {name.parent.as_posix() for name in files if name.name.startswith("test_")} == TIERS
    assert {name.name for name in files if name.parts[:-1] == ()} == {"conftest.py"}
    helpers = [name for name in files if name.parts[0] in TIERS - {"proof"} and not name.name.startswith("test_")]
    assert not helpers
    lengths = {str(name): len(file.read_text(encoding="utf-8").splitlines()) for name, file in files.items()}
    assert {name: length for name, length in lengths.items() if length > LONGEST_FILE} == {}


def test_no_local_paths():
    offenders = [str(file.relative_to(ROOT)) for file in project_files() if LOCAL_PATH.search(file.read_bytes())]
    assert not offenders
