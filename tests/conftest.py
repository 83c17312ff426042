"""What every test shares: recordings that are not part of the project, and settings that make runs repeatable."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import Phase, settings

if TYPE_CHECKING:
    from identification.report.pictures import Picture

ROOT = Path(__file__).resolve().parent.parent

# One thread a worker (pytest-xdist fills the cores), set before anything imports NumPy; no window for a figure.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MPLBACKEND", "Agg")

# A shell makes what runs in its background deaf to an interruption; commands that tests interrupt would inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# What fails says how it is run again. Workers of a whole run show an example as it was found: to make one smaller may
# take five minutes, and is done where its test is run alone with `-n 0`.
FOUND = [phase for phase in Phase if phase not in (Phase.shrink, Phase.explain)]
settings.register_profile("local", deadline=None, print_blob=True)
settings.register_profile("worker", settings.get_profile("local"), phases=FOUND)
settings.register_profile("ci", settings.get_profile("worker"), derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "worker" if "PYTEST_XDIST_WORKER" in os.environ else "local")


def pytest_configure() -> None:
    """What reads memory before it has written to it, fails: by chance it would fail one run in a hundred."""
    from tests.helpers.unwritten_memory import signal_reads

    signal_reads()


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


@pytest.fixture(scope="session")
def drawn() -> dict[tuple[object, ...], str]:
    """Figures that tests have drawn, by module, caption and description."""
    return {}


@pytest.fixture(autouse=True)
def figures_drawn_once(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, drawn: dict[tuple[object, ...], str]
) -> None:
    """In the pages of a module's tests, a figure of the same caption and description is drawn once.

    Figures are half the work of a fit's command, and hundreds of tests look at its numbers only. Tests that look at
    figures or compare pages have the mark `every_figure`.
    """
    if request.node.get_closest_marker("every_figure"):
        return
    from identification.report.page import Album

    place = Album.place

    def placed(self: Album, picture: Picture) -> str:
        def source() -> str:
            key = (request.node.path, picture.caption, picture.alt)
            if key not in drawn:
                drawn[key] = picture.source()
            return drawn[key]

        return place(self, picture._replace(source=source))

    monkeypatch.setattr(Album, "place", placed)


@pytest.fixture
def few_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compensation is judged at fewer poses than usual: quicker, and its figures are known less well."""
    monkeypatch.setattr("identification.compensation.compensate.SAMPLE_POSES", 300)
