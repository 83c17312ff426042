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
    folder = Path(os.environ.get(variable) or default)
    if not folder.is_dir():
        pytest.skip(f"recordings not found at {folder}; set {variable}")
    return folder.resolve()


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of measurements of real machines, one folder each."""
    return _recordings("ERRORMODEL_DATA", ROOT.parent / "shared" / "real")


@pytest.fixture(scope="session")
def practice_data() -> Path:
    """Folder of simulated recordings with known causes, one folder each."""
    return _recordings("ERRORMODEL_PRACTICE", ROOT.parent / "shared" / "practice")
