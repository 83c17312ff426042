"""What every test shares: recordings that are not part of the project, and settings that make runs repeatable."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

ROOT = Path(__file__).resolve().parent.parent

# One thread a worker (pytest-xdist fills the cores), set before anything imports NumPy; no window for a figure.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MPLBACKEND", "Agg")

settings.register_profile("local", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "local")


def _recordings(variable: str, default: Path) -> Path:
    return _present(Path(os.environ.get(variable) or default), variable).resolve()


def _present(folder: Path, variable: str) -> Path:
    if not folder.is_dir():
        pytest.skip(f"recordings not found at {folder}; set {variable}")
    return folder


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of measurements of real machines, one folder each."""
    return _recordings("ERRORMODEL_DATA", ROOT.parent / "shared" / "real")


@pytest.fixture(scope="session")
def practice_data() -> Path:
    """Folder of simulated recordings with known causes, one folder each."""
    return _recordings("ERRORMODEL_PRACTICE", ROOT.parent / "shared" / "practice")


@pytest.fixture(scope="session")
def ur10(real_data: Path) -> Path:
    """Folder of the arm: two series of poses seen by a tracker."""
    return _present(real_data / "ur10", "ERRORMODEL_DATA")


@pytest.fixture(scope="session")
def printers(real_data: Path) -> Path:
    """Folder of two printers: a fixed switch found again and again while they heat."""
    return _present(real_data / "printer-frame", "ERRORMODEL_DATA")


@pytest.fixture
def few_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compensation is judged at fewer poses than usual: quicker, and its figures are known less well."""
    monkeypatch.setattr("identification.compensation.compensate.SAMPLE_POSES", 300)
