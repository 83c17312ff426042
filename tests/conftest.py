"""What every test shares: recordings that are not part of the project, and settings that make runs repeatable."""

from __future__ import annotations

import base64
import gc
import os
import shutil
import signal
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import Phase, settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from identification.report.pictures import Picture
    from tests.helpers.commands import Fill

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


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """All tests and modules stay until the end: no search for garbage looks at them, while they are made or later."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.collect()
        gc.freeze()


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


class Figures:
    """Figures of pages: which of them are drawn, and which become a file.

    Attributes
    ----------
    module : whose tests share their figures at the moment; none where pages are looked at or compared.
    looked_at : modules of which a test looks at figures: what their fixtures make has all of them.
    """

    # one for all: a page with it differs from every page with figures, whichever test came first
    STAND_IN = "data:image/svg+xml;base64," + base64.b64encode(b'<svg xmlns="http://www.w3.org/2000/svg"/>').decode()

    def __init__(self) -> None:
        self.module: Path | None = None
        self.looked_at: set[Path] = set()
        self._drawn: set[tuple[object, ...]] = set()
        self._rendered: set[str] = set()
        self._only_drawn = False

    def source(self, picture: Picture) -> str:
        """The picture of a page; where figures are shared, the stand-in, once the figure could be drawn."""
        if self.module is None:
            return picture.source()
        key = (self.module, picture.caption, picture.alt)
        if key not in self._drawn:
            self._only_drawn = picture.caption in self._rendered
            try:
                picture.source()
            finally:
                self._only_drawn = False
            self._drawn.add(key)
            self._rendered.add(picture.caption)
        return self.STAND_IN

    def install(self, patch: pytest.MonkeyPatch) -> None:
        from identification.plots import style
        from identification.report.page import Album

        place, render = Album.place, style.render

        def placed(album: Album, picture: Picture) -> str:
            return place(album, picture._replace(source=partial(self.source, picture)))

        def rendered(figure: Figure, kind: str, dpi: int = 150) -> bytes:
            return b"" if self._only_drawn else render(figure, kind, dpi)

        patch.setattr(Album, "place", placed)
        patch.setattr(style, "render", rendered)


FIGURES = Figures()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    FIGURES.looked_at |= {item.path for item in items if item.get_closest_marker("every_figure")}


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """For fixtures of the whole module, which are made first."""
    FIGURES.module = None if item.path in FIGURES.looked_at else item.path


@pytest.fixture(scope="session", autouse=True)
def figures_shared() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        FIGURES.install(patch)
        yield


@pytest.fixture(scope="session", autouse=True)
def nothing_flushed() -> Iterator[None]:
    """What a test writes need not outlive a loss of power: the disk is not waited for; a wrong handle still fails."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", os.fstat)
        yield


@pytest.fixture(autouse=True)
def figures_drawn_once(request: pytest.FixtureRequest) -> None:
    """In the pages of a module's tests, a figure of the same caption and description is drawn once.

    A stand-in takes its place, and Matplotlib makes a file of the first figure of a caption only. Figures are half the
    work of a fit's command, and hundreds of tests look at its numbers only. Tests that look at figures or compare pages
    have the mark `every_figure`.
    """
    FIGURES.module = None if request.node.get_closest_marker("every_figure") else request.node.path


@pytest.fixture(scope="session")
def with_mill(tmp_path_factory: pytest.TempPathFactory) -> Fill:
    """Put a small machine's survey with noise, and its fit, into a folder: ``s.csv fit/``; they are made once."""
    from tests.helpers.commands import fitted_mill

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FIGURES, "module", None)
        made = fitted_mill(tmp_path_factory.mktemp("mill"))
    return lambda folder: Path(shutil.copytree(made, folder, dirs_exist_ok=True))


@pytest.fixture(scope="session")
def demonstration(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """What the README's first command makes of the example, and what it prints; made once."""
    from tests.helpers.commands import done

    folder, example = tmp_path_factory.mktemp("demonstration") / "demo", ROOT / "machines/examples/gantry"
    return folder, done("diagnose", example, example / "survey.csv", "--out", folder).out


@pytest.fixture
def few_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compensation is judged at fewer poses than usual: quicker, and its figures are known less well."""
    monkeypatch.setattr("identification.compensation.compensate.SAMPLE_POSES", 300)
